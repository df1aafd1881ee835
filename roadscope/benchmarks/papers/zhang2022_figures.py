"""Figures 3 and 5 to 11 of Zhang 2022 from our experiments with the first test seed."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from roadscope.benchmarks.papers.drawing import draw_clusters, draw_points, seen_from_above
from roadscope.benchmarks.papers.reproduction import FIRST_SEED
from roadscope.benchmarks.papers.zhang2022 import (
    AS_PRINTED,
    LEGO_LOAM,
    LONG_ROUTE,
    SCAN_TO_SCAN,
    WITH_MAP,
    OdometryRun,
    kept_runs,
    predicted_motion,
)
from roadscope.benchmarks.papers.zhang2022_scene import REMOVAL_CASES, SCANS_APART, sense_corridor
from roadscope.core import LidarScan
from roadscope.core.palette import PAPER_COLOURS, PAPER_FAINT, PAPER_TRUTH
from roadscope.odometry.clusters.segments import segments_of
from roadscope.odometry.zhang import ZhangOdometry, dynamic_returns

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = {
    SCAN_TO_SCAN: PAPER_COLOURS[0],
    WITH_MAP: PAPER_COLOURS[2],
    AS_PRINTED: PAPER_COLOURS[3],
    LEGO_LOAM: PAPER_COLOURS[1],
}
"""The methods of the trajectories and their colours."""
VIEW_M = 12.0
"""Half the side of the views from above."""


class RemovedCase(NamedTuple):
    """The last scan of a case: which returns the method takes for dynamic, and which are."""

    scan: LidarScan
    removed: np.ndarray
    moving: np.ndarray


@cache
def _case(name: str) -> RemovedCase:
    sweeps = list(sense_corridor(REMOVAL_CASES[name], FIRST_SEED))
    before, now = sweeps[-1 - SCANS_APART], sweeps[-1]
    motion = predicted_motion(sweeps, SCANS_APART)
    removed = dynamic_returns(ZhangOdometry(), before.scan, now.scan, motion)
    return RemovedCase(now.scan, removed, now.moving)


def _runs(experiment: str) -> dict[str, OdometryRun]:
    return kept_runs(experiment, tuple(SHOWN), FIRST_SEED)


def clusters_from_above(figure: Figure) -> None:
    """Figure 3: the clusters of a scan without its ground."""
    scan = _case(next(iter(REMOVAL_CASES))).scan
    segments = segments_of(scan, ZhangOdometry().clustering)
    axes = figure.subplots()
    draw_clusters(axes, segments.points, segments.labels)
    count = len(segments.sizes)
    _corridor_view(axes, f"{count} clusters above the ground, outliers grey")


def _corridor_view(axes: Axes, title: str) -> None:
    seen_from_above(axes, title)
    axes.set(xlim=(-VIEW_M, VIEW_M), ylim=(-VIEW_M, VIEW_M))


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


def four_cases(draw: Callable[[Axes, RemovedCase], None], figure: Figure) -> None:
    """Figures 5 to 7: the four cases from above, as they are, as judged, and what is left."""
    figure.set_size_inches(9.0, 9.0)
    places = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, name in zip(places.flat, REMOVAL_CASES, strict=True):
        draw(axes, _case(name))
        _corridor_view(axes, f"case {name}")
    figure.legend(
        *places.flat[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=2,
        markerscale=4,
    )


def standing_positions(figure: Figure) -> None:
    """Figure 8: positions while the robot stands among people, and their errors over time."""
    places = figure.subplots(1, 2)
    for method, run in _runs("standing").items():
        draw_points(places[0], run.estimated_m, SHOWN[method], method)
    places[0].plot(0.0, 0.0, "+", color=PAPER_TRUTH, markersize=12, label="truth")
    seen_from_above(places[0], "positions while standing")
    _errors_over_time(places[1], "standing")
    places[0].legend(markerscale=3)


def _errors_over_time(axes: Axes, experiment: str) -> None:
    for method, run in _runs(experiment).items():
        times_s = 0.1 * np.arange(len(run.errors_m))
        axes.plot(times_s, run.errors_m, color=SHOWN[method], label=method)
    axes.set(xlabel="time (s)", ylabel="error of the position (m)")


def path_and_errors(experiment: str, figure: Figure) -> None:
    """Figures 9 to 11: the path from above, and the errors of the position over time."""
    places = figure.subplots(1, 2)
    runs = _runs(experiment)
    true_m = next(iter(runs.values())).true_m
    places[0].plot(
        true_m[:, 0], true_m[:, 1], color=PAPER_TRUTH, linewidth=3, alpha=0.4, label="truth"
    )
    for method, run in runs.items():
        x, y = run.estimated_m[:, :2].T
        places[0].plot(x, y, color=SHOWN[method], linewidth=1, label=method)
    places[0].plot(0.0, 0.0, "o", color=PAPER_FAINT, label="start")
    seen_from_above(places[0], experiment)
    places[0].legend()
    _errors_over_time(places[1], experiment)


FIGURES = {
    "figure-03": clusters_from_above,
    "figure-05": partial(four_cases, _draw_truth),
    "figure-06": partial(four_cases, _draw_removal),
    "figure-07": partial(four_cases, _draw_rest),
    "figure-08": standing_positions,
    "figure-09": partial(path_and_errors, "straight"),
    "figure-10": partial(path_and_errors, "loop"),
    "figure-11": partial(path_and_errors, LONG_ROUTE),
}
"""By the paper's number."""
