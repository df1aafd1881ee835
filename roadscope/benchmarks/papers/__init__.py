"""Papers whose experiments can be repeated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names
from roadscope.core import SpecError
from roadscope.core.names import unknown

if TYPE_CHECKING:
    from roadscope.benchmarks.papers.drawing import Draw
    from roadscope.benchmarks.papers.reproduction import Reproduction

PAPERS = ("li2021", "lu2018", "zhang2017", "zhang2022")
"""Modules beside this one, each with a record `REPRODUCTION`."""


def module_of(paper: str) -> str:
    """Return the module that repeats a paper; `SpecError` for an unknown paper."""
    if paper not in PAPERS:
        raise SpecError(unknown("paper", paper, PAPERS))
    return f"{__name__}.{paper}"


def reproduce(
    paper: str,
    seeds: int = 30,
    progress: Callable[[int, int], None] | None = None,
    *,
    jobs: int = 1,
) -> Reproduction:
    """Repeat the experiments of a paper and judge its claims.

    paper: one of `PAPERS`; `SpecError` for another. seeds: how many stand behind every interval.
    progress: called with parts done and parts in all. jobs: processes that share the parts.
    What an earlier run has measured is not measured again.
    """
    from roadscope.benchmarks.papers.reproduction import reproduce_module

    return reproduce_module(module_of(paper), seeds, progress, jobs=jobs)


def draw_figures(
    paper: str, folder: Path, progress: Callable[[int, int], None] | None = None
) -> list[Path]:
    """Draw one picture for every figure of a paper's experiments; return the files.

    They show the first test seed. progress: called with figures drawn and figures in all.
    """
    from roadscope.benchmarks.papers.drawing import draw_all

    return draw_all(paper, figures_of(paper), folder, progress)


def figures_of(paper: str) -> Mapping[str, Draw]:
    """Return the functions that draw the figures of a paper, by the figure's name."""
    figures: Mapping[str, Draw] = import_module(f"{module_of(paper)}_figures").FIGURES
    return figures


def note_of(paper: str, experiment: str) -> str | None:
    """Return what must be known to read the tables of one of a paper's experiments."""
    from roadscope.benchmarks.papers.reproduction import paper_of

    return paper_of(module_of(paper)).note_of(experiment)


_PARTS = {
    "li2021": "BY_BELIEF CALIBRATION CAMERA CAMERA_FAILS CLAIMS CLASS CONDITIONS CYCLISTS DISTANCE "
    "EQUAL_FALSE_ALARMS EVERY_SCORE FALSE HIDDEN IMAGES IMITATED LIDAR LIDAR_FAILS MORE_BOTH "
    "MORE_ONE PEDESTRIANS TARGETS VEHICLES WITH_BOTH crowds_only fuse named_quantities table_1 "
    "with_camera without_camera",
    "li2021_pairs": "SensorPair sense_pairs",
    "lu2018": "FEWER_CLUSTERS FORCED IDENTITY KEPT LESS_CLUTTER NO_WRONG SHOWN_METHODS "
    "TRACKER_FIGURES WRONG",
    "lu2018_measures": "NO_TRACK TargetHistories axis_errors clutter_associations first_missing "
    "first_tracked identity_changes identity_kept majority natural_misses reassociated_at_once "
    "reassociated_in track_targets wrong_associations",
    "lu2018_scene": "KINDS lux sense_experiment",
    "printed_tables": "MOST_COLUMNS reproduction_tables verdict_table",
    "reproduction": "FAILS FIRST_SEED FigureKey HOLDS ClaimRange OPEN POINTS Paper ReproductionRow "
    "Verdict YES_OR_NO by_figure differences judge judge_share measure_paper paper_of "
    "reproduce_module summarise write_reproduction",
    "zhang2017_claims": "BEATEN DriveMethod FALLING LIMITS_MS POSE_UNKNOWNS consistent nees_band "
    "our_claims paper_claims time_claims",
    "zhang2017_methods": "FROM_PARTS HEADING LATERAL LONGITUDINAL METHODS MULTI NO_ANSWER "
    "ON_EVERY_DRIVE OURS POSITION RANSAC READINGS SINGLE TURNED errors estimate ford_fusion "
    "medians_and_shares nees rmse",
    "zhang2017_scene": "DRIVES FOLLOWED_M RobotLidar drive_of sense_drive sense_sweeps",
    "zhang2017_tables": "COUNTS FOLLOWING INSIDE NEES PAPER PAPER_TIMES_MS READING RMSE SIMULATED "
    "TIMES frames_name",
    "zhang2022": "AS_PRINTED CLAIMED END EXPERIMENTS LEGO_LOAM LONG_ROUTE MEAN "
    "MEDIANS OTHER_FIGURES OTHER_READINGS OdometryRun READING_EXPERIMENTS "
    "READING_FIGURES SCAN_TO_SCAN WITH_MAP methods_of "
    "other_figures paper_figure printed_figures run_odometries",
    "zhang2022_removal": "AFTER BEFORE PRECISION RECALL REMOVAL RemovalVariant TIME_MS removal",
    "zhang2022_scene": "LOOP MiddleLine REMOVAL_CASES STRAIGHT STRAIGHT_M building sense_corridor",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
