"""Papers whose experiments can be repeated."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names
from roadscope.core import SpecError
from roadscope.core.names import unknown

if TYPE_CHECKING:
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

    module = f"{module_of(paper)}_figures"
    return draw_all(paper, import_module(module).FIGURES, folder, progress)


def note_of(paper: str, experiment: str) -> str | None:
    """Return what must be known to read the tables of one of a paper's experiments."""
    from roadscope.benchmarks.papers.reproduction import paper_of

    return paper_of(module_of(paper)).note_of(experiment)


_PARTS = {
    "li2021_pairs": "SensorPair sense_pairs",
    "lu2018_measures": "NO_TRACK TargetHistories track_targets",
    "lu2018_scene": "KINDS sense_experiment",
    "printed_tables": "MOST_COLUMNS reproduction_tables verdict_table",
    "reproduction": "FAILS FigureKey HOLDS ClaimRange OPEN POINTS ReproductionRow Verdict "
    "YES_OR_NO by_figure differences judge judge_share measure_paper reproduce_module summarise "
    "write_reproduction",
    "zhang2017_claims": "DriveMethod POSE_UNKNOWNS consistent nees_band our_claims paper_claims "
    "time_claims",
    "zhang2017_methods": "FROM_PARTS HEADING LATERAL LONGITUDINAL METHODS MULTI NO_ANSWER "
    "ON_EVERY_DRIVE OURS POSITION RANSAC READINGS SINGLE TURNED errors estimate ford_fusion "
    "medians_and_shares nees rmse",
    "zhang2017_scene": "DRIVES FOLLOWED_M RobotLidar drive_of sense_drive sense_sweeps",
    "zhang2017_tables": "INSIDE NEES PAPER PAPER_TIMES_MS SIMULATED frames_name",
    "zhang2022": "AFTER AS_PRINTED BEFORE CLAIMED END EXPERIMENTS LEGO_LOAM LONG_ROUTE "
    "OTHER_FIGURES OTHER_READINGS OdometryRun PRECISION READING_EXPERIMENTS READING_FIGURES RECALL "
    "REMOVAL RemovalVariant SCAN_TO_SCAN TIME_MS WITH_MAP paper_figure removal",
    "zhang2022_scene": "LOOP MiddleLine REMOVAL_CASES STRAIGHT STRAIGHT_M building sense_corridor",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
