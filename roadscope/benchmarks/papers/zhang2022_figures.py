"""Figures 3 and 5 to 11 of Zhang 2022 from our experiments.

Trajectories are those of the first test seed. A case of the removal has the first seed in which
people walk in view.
"""

from __future__ import annotations

from functools import cache, partial
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from roadscope.benchmarks.papers.drawing import (
    caption,
    draw_clusters,
    draw_points,
    legend_above,
    seen_from_above,
)
from roadscope.benchmarks.papers.reproduction import FIRST_SEED
from roadscope.benchmarks.papers.zhang2022 import (
    AS_PRINTED,
    LEGO_LOAM,
    LONG_ROUTE,
    SCAN_TO_SCAN,
    WITH_MAP,
    OdometryRun,
    kept_runs,
)
from roadscope.benchmarks.papers.zhang2022_removal import predicted_motion
from roadscope.benchmarks.papers.zhang2022_scene import REMOVAL_CASES, SCANS_APART, sense_corridor
from roadscope.core import LidarScan
from roadscope.core.palette import PAPER_COLOURS, PAPER_TRUTH
from roadscope.odometry.clusters.segments import segments_of
from roadscope.odometry.zhang import ZhangOdometry, dynamic_returns

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class MethodStyle(NamedTuple):
    """How a method is drawn: its colour, and what tells it apart without colour."""

    colour: str
    line: str
    marker: str


SHOWN = {
    SCAN_TO_SCAN: MethodStyle(PAPER_COLOURS[0], "-", "o"),
    WITH_MAP: MethodStyle(PAPER_COLOURS[2], "--", "^"),
    AS_PRINTED: MethodStyle(PAPER_COLOURS[3], "-.", "s"),
    LEGO_LOAM: MethodStyle(PAPER_COLOURS[1], ":", "x"),
}
"""The methods of the trajectories and how they are drawn."""
STRETCHED = ("straight",)
"""Experiments whose y is stretched, because the robot drives along x."""
VIEW_M, ACROSS_M = 12.0, 3.5
"""Half the side of the views from above, and half their height where the corridor is straight."""
CORNER = "3, moving at a corner"
"""The case whose corridor is not straight."""
LEAST_IN_VIEW = 100
"""Returns of walking people that a picture of a removal must have in view."""
REMOVAL_METHOD = f"{SCAN_TO_SCAN}, {SCANS_APART / 10:.0f} s apart"


class RemovedCase(NamedTuple):
    """The last scan of a case: which returns the method takes for dynamic, and which are.

    before_from_now: (4, 4), the predicted motion from the earlier scan.
    """

    seed: int
    scan: LidarScan
    before_from_now: np.ndarray
    removed: np.ndarray
    moving: np.ndarray


@cache
def _case(name: str) -> RemovedCase:
    """Return a case with the first seed that has walking people in view."""
    for seed in count(FIRST_SEED):
        sweeps = list(sense_corridor(REMOVAL_CASES[name], seed))
        before, now = sweeps[-1 - SCANS_APART], sweeps[-1]
        in_view = np.abs(now.scan.points[:, :2]).max(axis=1) < VIEW_M
        if (now.moving & in_view).sum() >= LEAST_IN_VIEW:
            break
    motion = predicted_motion(sweeps, SCANS_APART)
    removed = dynamic_returns(ZhangOdometry(), before.scan, now.scan, motion)
    return RemovedCase(seed, now.scan, motion, removed, now.moving)


def clusters_from_above(figure: Figure) -> None:
    """Figure 3: a scan before and after its clustering, cut by the search angle as measured."""
    figure.set_size_inches(10.0, 6.5)
    name = next(iter(REMOVAL_CASES))
    case, rule = _case(name), ZhangOdometry()
    segments = rule.cut(segments_of(case.scan, rule.clustering), case.before_from_now)
    before, after = figure.subplots(2, 1, sharex=True)
    draw_points(before, case.scan.points, label="ground")
    draw_points(before, segments.points, PAPER_COLOURS[0], "above the ground")
    seen_from_above(before, f"before: case {name}")
    draw_clusters(after, segments.points, segments.labels)
    angle = f"{rule.clustering.angle_deg:.0f} deg"
    title = f"after: {len(segments.sizes)} clusters of at most {angle}, outliers grey"
    seen_from_above(after, title)
    for axes in (before, after):
        axes.set(xlim=(-VIEW_M, VIEW_M), ylim=(-ACROSS_M, ACROSS_M))
    legend_above(figure, [before], marker_scale=4)
    caption(figure, f"{SCAN_TO_SCAN}; colours of clusters repeat", (case.seed,))


def _draw_truth(axes: Axes, case: RemovedCase) -> None:
    draw_points(axes, case.scan.points[~case.moving], label="standing")
    draw_points(axes, case.scan.points[case.moving], PAPER_TRUTH, "walking people (truth)")


def _draw_removal(axes: Axes, case: RemovedCase) -> None:
    draw_points(axes, case.scan.points[~case.removed], label="static")
    draw_points(axes, case.scan.points[case.removed], PAPER_COLOURS[1], "dynamic by the method")


def _draw_rest(axes: Axes, case: RemovedCase) -> None:
    draw_points(axes, case.scan.points[~case.removed], label="what is left")
    left = case.moving & ~case.removed
    draw_points(axes, case.scan.points[left], PAPER_TRUTH, "walking people that are left (truth)")


def four_cases(draw: Callable[[Axes, RemovedCase], None], shown: str, figure: Figure) -> None:
    """Figures 5 to 7: the four cases from above, as they are, as judged, and what is left."""
    figure.set_size_inches(12.0, 6.3)
    cases = {name: _case(name) for name in REMOVAL_CASES}
    places: dict[str, Axes] = figure.subplot_mosaic(
        [[name, CORNER] for name in REMOVAL_CASES if name != CORNER]
    )
    for name, case in cases.items():
        draw(places[name], case)
        seen_from_above(places[name], f"case {name} (seed {case.seed})")
        across_m = VIEW_M if name == CORNER else ACROSS_M
        places[name].set(xlim=(-VIEW_M, VIEW_M), ylim=(-across_m, across_m))
    legend_above(figure, places.values(), marker_scale=4)
    why = f"the first with {LEAST_IN_VIEW} returns of walking people in view"
    caption(figure, f"{why}; {shown}", sorted({case.seed for case in cases.values()}))


def standing_positions(figure: Figure, scans: int | None = None) -> None:
    """Figure 8: positions while the robot stands among people, and their errors over time.

    scans: the first so many, all if None.
    """
    places = figure.subplots(1, 2)
    runs = kept_runs("standing", tuple(SHOWN), FIRST_SEED, scans)
    for method, run in runs.items():
        style = SHOWN[method]
        x, y = run.estimated_m[:, :2].T
        places[0].plot(
            x, y, style.marker, color=style.colour, markersize=3, fillstyle="none", label=method
        )
    places[0].plot(0.0, 0.0, "+", color=PAPER_TRUTH, markersize=14, label="truth")
    seen_from_above(places[0], "positions while standing")
    _fill(places[0])
    _errors_over_time(places[1], runs)
    legend_above(figure, places)
    caption(figure, "; ".join(SHOWN))


def _fill(axes: Axes) -> None:
    """Let axes with equal scales fill their place: they show more than the data need."""
    axes.set_aspect("equal", adjustable="datalim")


def _errors_over_time(axes: Axes, runs: Mapping[str, OdometryRun]) -> None:
    for method, run in runs.items():
        times_s, style = 0.1 * np.arange(len(run.errors_m)), SHOWN[method]
        axes.plot(times_s, run.errors_m, style.line, color=style.colour, label=method)
    axes.set(xlabel="time (s)", ylabel="error of the position (m)")


def path_and_errors(experiment: str, figure: Figure, scans: int | None = None) -> None:
    """Figures 9 to 11: the path from above, and the errors of the position over time.

    scans: the first so many, all if None.
    """
    places = figure.subplots(1, 2)
    runs = kept_runs(experiment, tuple(SHOWN), FIRST_SEED, scans)
    true_m = next(iter(runs.values())).true_m
    places[0].plot(*true_m[:, :2].T, color=PAPER_TRUTH, linewidth=4, alpha=0.3, label="truth")
    for method, run in runs.items():
        style = SHOWN[method]
        places[0].plot(*run.estimated_m[:, :2].T, style.line, color=style.colour, label=method)
    places[0].plot(0.0, 0.0, "o", color=PAPER_TRUTH, markersize=5, label="start")
    seen_from_above(places[0], experiment)
    _fill(places[0])
    if experiment in STRETCHED:
        places[0].set(title=f"{experiment}, y stretched", aspect="auto")
    _errors_over_time(places[1], runs)
    legend_above(figure, places)
    caption(figure, "; ".join(SHOWN))


FIGURES = {
    "figure-03": clusters_from_above,
    "figure-05": partial(four_cases, _draw_truth, "the truth alone"),
    "figure-06": partial(four_cases, _draw_removal, REMOVAL_METHOD),
    "figure-07": partial(four_cases, _draw_rest, REMOVAL_METHOD),
    "figure-08": standing_positions,
    "figure-09": partial(path_and_errors, "straight"),
    "figure-10": partial(path_and_errors, "loop"),
    "figure-11": partial(path_and_errors, LONG_ROUTE),
}
"""By the paper's number."""
