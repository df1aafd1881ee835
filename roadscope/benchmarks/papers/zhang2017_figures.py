"""Figures 2, 3, 7, 8 and 10 of Zhang 2017 from our experiments with the first test seed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.papers.drawing import draw_box, draw_points, seen_from_above
from roadscope.benchmarks.papers.reproduction import FIRST_SEED
from roadscope.benchmarks.papers.zhang2017 import FOLLOWED_FRAMES
from roadscope.benchmarks.papers.zhang2017_claims import following
from roadscope.benchmarks.papers.zhang2017_methods import (
    FEWEST_RETURNS,
    HEADING,
    METHODS,
    MULTI,
    POSITION,
    RANSAC,
    SINGLE,
    errors,
    estimate,
    rmse,
)
from roadscope.benchmarks.papers.zhang2017_scene import FOLLOWED_M, SensedDrive, sense_drive
from roadscope.core.palette import PAPER_COLOURS, PAPER_FAINT, PAPER_TRUTH
from roadscope.envs.world.saloon_body import LENGTH_M, WIDTH_M

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OURS = "ours, 7 frames"
SHOWN = {
    SINGLE: PAPER_COLOURS[0],
    MULTI: PAPER_COLOURS[1],
    RANSAC: PAPER_COLOURS[2],
    OURS: PAPER_COLOURS[3],
}
"""The methods of the figures and their colours."""
PROJECTED_FRAME = 4
"""Frame of the curve whose returns are projected: flank and rear are seen."""
BOXES_EVERY = 6
"""Frames between two rectangles in a drawing of a drive."""
SIGMA_M, BIN_M = 0.04, 0.05
"""Smoothing of the template's edges and width of the bins that are drawn: the fit's own defaults
for an HDL-32E, twice its range noise, and about that."""


@cache
def _sensed(drive: str) -> SensedDrive:
    frames = FOLLOWED_FRAMES if drive.startswith("following") else None
    return sense_drive(drive, FIRST_SEED, frames=frames)


@cache
def _errors(drive: str, method: str) -> np.ndarray:
    """Return the (K, 3) errors along, across (metres) and in heading (radians)."""
    run = _sensed(drive)
    return errors(run, estimate(METHODS[method], run)[0])


def returns_against_distance(figure: Figure) -> None:
    """Figure 2: how many returns of the car there are, by distance."""
    runs = [_sensed(name) for name in ("straight", *(following(m) for m in FOLLOWED_M))]
    pairs = [
        (np.hypot(*(each.truth[:2] - each.origin_xy)), each.target.sum())
        for run in runs
        for each in run.sweeps
    ]
    distances_m, counts = np.array(pairs, np.float64).T
    edges_m = np.arange(0.0, distances_m.max() + 5.0, 5.0)
    bins = np.digitize(distances_m, edges_m)
    present = np.unique(bins)
    means = [counts[bins == k].mean() for k in present]
    axes = figure.subplots()
    axes.bar(edges_m[present - 1], means, width=4.5, align="edge", color=PAPER_COLOURS[0])
    axes.axhline(100.0, color=PAPER_TRUTH, linewidth=1, linestyle="--", label="100 returns")
    axes.set(xlabel="distance of the car (m)", ylabel="returns of the car, means", yscale="log")
    axes.legend()


def projections_and_template(figure: Figure) -> None:
    """Figure 3: the returns of one scan along both axes of the car, and the smoothed template."""
    sweep = _sensed("curve").sweeps[PROJECTED_FRAME]
    x, y, yaw = sweep.truth
    c, s = np.cos(yaw), np.sin(yaw)
    local = (sweep.points_xy - [x, y]) @ np.array([[c, -s], [s, c]])
    places = figure.subplots(1, 3)
    draw_points(places[0], sweep.points_xy, PAPER_COLOURS[0], "returns")
    draw_box(places[0], sweep.truth, np.array([LENGTH_M, WIDTH_M]), PAPER_TRUTH, "truth")
    seen_from_above(places[0], f"curve, frame {PROJECTED_FRAME + 1}: {len(local)} returns")
    places[0].legend(loc="best")
    for axes, column, size, name in (
        (places[1], 0, LENGTH_M, "long axis"),
        (places[2], 1, WIDTH_M, "short axis"),
    ):
        _projection(axes, local[:, column], size)
        axes.set(xlabel=f"place on the {name} (m)", title=f"projection on the {name}")
    places[1].set_ylabel("share of the returns in a bin")
    figure.legend(*places[1].get_legend_handles_labels(), loc="outside lower center", ncols=2)


def _projection(axes: Axes, values: np.ndarray, size_m: float) -> None:
    """Draw a histogram with each return shared by two bins, and a step with smoothed edges."""
    from scipy.special import erf

    edge = size_m / 2 + 1.0
    centres = np.arange(-edge, edge + BIN_M, BIN_M)
    share = (values - centres[0]) / BIN_M
    lower = np.clip(np.floor(share).astype(int), 0, len(centres) - 2)
    weights = share - lower
    counts = np.bincount(lower, 1 - weights, len(centres))
    counts += np.bincount(lower + 1, weights, len(centres))
    axes.bar(centres, counts / len(values), width=BIN_M, color=PAPER_COLOURS[0], label="returns")
    scale = np.sqrt(2.0) * SIGMA_M
    step = erf((centres + size_m / 2) / scale) - erf((centres - size_m / 2) / scale)
    height = (counts / len(values)).max()
    axes.plot(centres, step / 2 * height, color=PAPER_COLOURS[1], label="smoothed step")


def poses_over_frames(drive: str, figure: Figure) -> None:
    """Figures 7 and 8: estimated poses of a simulated drive from above, and errors over frames."""
    figure.set_size_inches(10.0, 7.0)
    run = _sensed(drive)
    grid: dict[str, Axes] = figure.subplot_mosaic([["above", "above"], ["position", "heading"]])
    size = np.array([LENGTH_M, WIDTH_M])
    for k, truth in enumerate(run.truth[::BOXES_EVERY]):
        draw_box(grid["above"], truth, size, PAPER_TRUTH, "truth" if k == 0 else "")
    for method, colour in SHOWN.items():
        poses, _ = estimate(METHODS[method], run)
        answered = [pose for pose in poses[::BOXES_EVERY] if pose is not None]
        for k, pose in enumerate(answered):
            at = np.array([pose.x, pose.y, pose.yaw])
            draw_box(grid["above"], at, size, colour, method if k == 0 else "")
        along, across, turned = _errors(drive, method).T
        frames = np.arange(1, len(along) + 1)
        grid["position"].plot(frames, np.hypot(along, across), color=colour, label=method)
        grid["heading"].plot(frames, np.degrees(np.abs(turned)), color=colour, label=method)
    seen_from_above(grid["above"], f"{drive}: every {BOXES_EVERY}th frame")
    names = grid["above"].get_legend_handles_labels()
    figure.legend(*names, loc="outside lower center", ncols=5)
    grid["position"].set(xlabel="frame", ylabel="error of the position (m)", yscale="log")
    grid["heading"].set(xlabel="frame", ylabel="error of the heading (deg)", yscale="log")
    few = [k + 1 for k, each in enumerate(run.sweeps) if each.target.sum() < FEWEST_RETURNS]
    for axes in (grid["position"], grid["heading"]):
        for frame in few:
            axes.axvline(frame, color=PAPER_FAINT, linewidth=4, alpha=0.4, zorder=0)


def errors_against_distance(figure: Figure) -> None:
    """Figure 10: RMSE of position and heading against the distance while following."""
    figures: dict[str, list[Mapping[str, float]]] = {
        method: [
            rmse(_sensed(following(metres)), _errors(following(metres), method))
            for metres in FOLLOWED_M
        ]
        for method in SHOWN
    }
    places = figure.subplots(1, 2)
    for axes, column, unit in ((places[0], POSITION, "m"), (places[1], HEADING, "deg")):
        for method, rows in figures.items():
            values = [row[column] for row in rows]
            axes.plot(FOLLOWED_M, values, "o-", color=SHOWN[method], label=method)
        axes.set(xlabel="distance (m)", ylabel=f"RMSE of {column} ({unit})", yscale="log")
        axes.set_xticks(FOLLOWED_M)
    places[0].legend()


FIGURES = {
    "figure-02": returns_against_distance,
    "figure-03": projections_and_template,
    "figure-07": partial(poses_over_frames, "straight"),
    "figure-08": partial(poses_over_frames, "curve"),
    "figure-10": errors_against_distance,
}
"""By the paper's number."""
