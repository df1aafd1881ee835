"""Figures 2, 3, 7, 8 and 10 of Zhang 2017 from our experiments with the first test seed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.papers.drawing import (
    caption,
    draw_box,
    draw_points,
    legend_above,
    seen_from_above,
)
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
from roadscope.detectors.pose.filter_kernels import Line, axis_response, near_face_share
from roadscope.detectors.pose.matched_filter import filter_options
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
BIN_M = 0.05
"""Width of the bins that are drawn. Those of the fit, 0.02 m, hold too few returns for the eye."""
STRETCHED = {"straight": 2.2}
"""Drives whose y is stretched, because the car goes along x, and half the height that is drawn (m)
around the car's y."""


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
    axes.axhline(100.0, color=PAPER_COLOURS[1], linewidth=1.5, linestyle="--", label="100 returns")
    axes.set(xlabel="distance of the car (m)", ylabel="returns of the car, means", yscale="log")
    legend_above(figure, [axes])
    caption(figure, "all frames of the straight and of following the car")


def projections_and_template(figure: Figure) -> None:
    """Figure 3: the returns of one scan along both axes of the car, and the filter's template."""
    figure.set_size_inches(10.0, 5.0)
    sweep = _sensed("curve").sweeps[PROJECTED_FRAME]
    x, y, yaw = sweep.truth
    c, s = np.cos(yaw), np.sin(yaw)
    local = (sweep.points_xy - [x, y]) @ np.array([[c, -s], [s, c]])
    sight = sweep.points_xy.mean(axis=0) - sweep.origin_xy
    scene = [["above", "long", "short"], ["above", "long template", "short template"]]
    grid: dict[str, Axes] = figure.subplot_mosaic(scene)
    draw_points(grid["above"], sweep.points_xy, PAPER_COLOURS[0], "returns")
    draw_box(grid["above"], sweep.truth, np.array([LENGTH_M, WIDTH_M]), PAPER_TRUTH, "truth")
    seen_from_above(grid["above"], f"curve, frame {PROJECTED_FRAME + 1}: {len(local)} returns")
    grid["above"].legend(loc="lower right", markerscale=3)
    for name, values, axis, along_m, across_m in (
        ("long", local[:, 0], np.array([c, s]), LENGTH_M, WIDTH_M),
        ("short", local[:, 1], np.array([-s, c]), WIDTH_M, LENGTH_M),
    ):
        below = grid[f"{name} template"]
        _projection(grid[name], values, along_m)
        _template(below, axis, sight, along_m=along_m, across_m=across_m)
        grid[name].set_title(f"{name} axis")
        grid[name].sharex(below)
        grid[name].tick_params(labelbottom=False)
        below.set_xlabel(f"place on the {name} axis (m)")
    grid["long"].set_ylabel("share of the returns in a bin")
    grid["long template"].set_ylabel("template: score of a return")
    caption(figure, f"{SINGLE}; both axes as at the true heading")


def _projection(axes: Axes, values: np.ndarray, size_m: float) -> None:
    """Draw a histogram with each return shared by two bins."""
    edge = size_m / 2 + 1.0
    centres = np.arange(-edge, edge + BIN_M, BIN_M)
    share = (values - centres[0]) / BIN_M
    lower = np.clip(np.floor(share).astype(int), 0, len(centres) - 2)
    weights = share - lower
    counts = np.bincount(lower, 1 - weights, len(centres))
    counts += np.bincount(lower + 1, weights, len(centres))
    axes.bar(centres, counts / len(values), width=BIN_M, color=PAPER_COLOURS[0])


def _template(
    axes: Axes, axis: np.ndarray, sight: np.ndarray, *, along_m: float, across_m: float
) -> None:
    """Draw the template of the matched filter with the car's centre at 0 (eq. 4 to 8).

    axis: (2,) unit vector. sight: (2,) from the sensor to the returns. along_m, across_m: size of
    the car along the axis and across it.

    The response to a single return at 0 is the template, turned round: it scores all places of the
    car's centre.
    """
    settings, _ = filter_options(LENGTH_M, WIDTH_M)
    line = Line(float(axis[0]), float(axis[1]), 0.0, bool(axis @ sight >= 0))
    share = near_face_share(sight, line, along_m, across_m, settings.power)
    half = round((along_m / 2 + 1.0) / settings.bin_m)
    # The filter needs as many bins on either side as a smoothed return at the edge reaches.
    spare = round(along_m / settings.bin_m)
    bins = 2 * (half + spare) + 1
    response = axis_response(np.zeros((1, 2)), line, along_m, share, settings, bins)
    places_m = settings.bin_m * np.arange(-half, half + 1)
    axes.plot(places_m, response[::-1][spare:-spare], color=PAPER_COLOURS[1])
    axes.axhline(0.0, color=PAPER_TRUTH, linewidth=0.5)
    for end_m in (-along_m / 2, along_m / 2):
        axes.axvline(end_m, color=PAPER_TRUTH, linewidth=0.8, linestyle=":")
    axes.set_title(f"near edge has {100 * share:.0f} % of the returns", fontsize=8)


def poses_over_frames(drive: str, figure: Figure) -> None:
    """Figures 7 and 8: estimated poses of a simulated drive from above, and errors over frames."""
    figure.set_size_inches(10.0, 8.0)
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
        grid["position"].plot(frames, np.hypot(along, across), color=colour)
        grid["heading"].plot(frames, np.degrees(np.abs(turned)), color=colour)
    title = f"{drive}: every {BOXES_EVERY}th frame"
    seen_from_above(grid["above"], title)
    if drive in STRETCHED:
        y = run.truth[0, 1]
        grid["above"].set(title=f"{title}, y stretched", aspect="auto")
        grid["above"].set_ylim(y - STRETCHED[drive], y + STRETCHED[drive])
    grid["position"].set(xlabel="frame", ylabel="error of the position (m)", yscale="log")
    grid["heading"].set(xlabel="frame", ylabel="error of the heading (deg)", yscale="log")
    few = [k + 1 for k, each in enumerate(run.sweeps) if each.target.sum() < FEWEST_RETURNS]
    name = f"fewer than {FEWEST_RETURNS} returns, not scored"
    for axes in (grid["position"], grid["heading"]):
        for frame in few:
            bar = axes.axvspan(frame - 0.5, frame + 0.5, color=PAPER_FAINT, label=name)
            bar.set(linewidth=0, alpha=0.4, zorder=0)
    legend_above(figure, grid.values())
    caption(figure, "; ".join(SHOWN))


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
    legend_above(figure, places)
    caption(figure, "; ".join(SHOWN))


FIGURES = {
    "figure-02": returns_against_distance,
    "figure-03": projections_and_template,
    "figure-07": partial(poses_over_frames, "straight"),
    "figure-08": partial(poses_over_frames, "curve"),
    "figure-10": errors_against_distance,
}
"""By the paper's number."""
