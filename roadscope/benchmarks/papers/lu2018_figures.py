"""Figures 7 to 14 of Lu 2018 from our experiments with the first test seed."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.papers.drawing import (
    draw_box,
    draw_clusters,
    draw_points,
    seen_from_above,
)
from roadscope.benchmarks.papers.lu2018 import OCCLUSION, THREE, TRACKERS, TWO, detect
from roadscope.benchmarks.papers.lu2018_measures import TargetHistories, track_targets
from roadscope.benchmarks.papers.lu2018_scene import SensedExperiment, sense_experiment
from roadscope.benchmarks.papers.reproduction import FIRST_SEED
from roadscope.core import Detections
from roadscope.core.palette import PAPER_COLOURS, PAPER_TRUTH
from roadscope.detectors.clustering import CLUSTERINGS
from roadscope.detectors.shape.cluster import contours
from roadscope.detectors.shape.recognition import fit_iepf

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

READING = "nearest-q"
"""The tracker that is drawn: the reading that agrees with the paper's errors."""
SCENE_FRAME = 60
"""Frame of experiment 1 in which both targets are in view."""
OCCLUDED_FRAMES = (48, 58, 68, 80)
"""Frames of experiment 2: before target 2 comes, while it cuts in, hides target 1, has passed."""
THREE_FRAME = 10
X_AXIS, Y_AXIS = 1, 0
"""Columns of the ego frame: the paper's x runs across the road and its y ahead."""
AXIS_NAMES = {X_AXIS: "x of the paper: left (m)", Y_AXIS: "y of the paper: ahead (m)"}


@cache
def _sensed(experiment: str) -> tuple[SensedExperiment, list[Detections], TargetHistories]:
    sensed = sense_experiment(experiment, FIRST_SEED)
    boxes = detect(sensed, "pag")
    return sensed, boxes, track_targets(sensed, boxes, TRACKERS[READING])


def _truth_boxes(axes: Axes, sensed: SensedExperiment, frame: int) -> None:
    truth = sensed.truths[frame - 1]
    ego_from_world = truth.world_from_ego.inverse()
    boxes = zip(ego_from_world.apply(truth.centres), truth.yaws, truth.sizes, strict=True)
    for k, (centre, yaw, size) in enumerate(boxes):
        pose = np.array([centre[0], centre[1], yaw - truth.world_from_ego.yaw])
        draw_box(axes, pose, size, PAPER_TRUTH, "truth" if k == 0 else "")


def clusters_and_lines(figure: Figure) -> None:
    """Figure 7: a scene of experiment 1, its clusters and their lines, by PAG and by distance."""
    figure.set_size_inches(10.0, 5.0)
    sensed, _, _ = _sensed(TWO)
    cloud = sensed.clouds[SCENE_FRAME - 1]
    places = figure.subplots(1, 3, sharex=True, sharey=True)
    draw_points(places[0], cloud.points, PAPER_COLOURS[0], "returns above the ground")
    _truth_boxes(places[0], sensed, SCENE_FRAME)
    seen_from_above(places[0], f"experiment 1, frame {SCENE_FRAME}")
    places[0].set(xlim=(5.0, 50.0), ylim=(-25.0, 28.0))
    places[0].legend(loc="lower right")
    for axes, name in zip(places[1:], ("pag", "distance"), strict=True):
        labels = CLUSTERINGS[name](cloud)
        draw_clusters(axes, cloud.points, labels)
        for outline in contours(cloud, labels):
            if len(outline) > 1:
                for segment in fit_iepf(outline):
                    axes.plot(*segment.points[[0, -1]].T, color=PAPER_TRUTH, linewidth=1)
        count = len(np.unique(labels[labels >= 0]))
        seen_from_above(axes, f"{name}: {count} clusters\n(lines black, outliers grey)")


def _against_frames(axes: Axes, histories: TargetHistories, target: int, column: int) -> None:
    frames = np.arange(1, histories.truth.shape[1] + 1)
    row = target - 1
    axes.plot(frames, histories.measured[row, :, column], ".", color=PAPER_COLOURS[1], markersize=3)
    axes.plot(frames, histories.estimated[row, :, column], color=PAPER_COLOURS[0], linewidth=1)
    missed = ~histories.detected[row] & np.isfinite(histories.estimated[row, :, column])
    at = histories.estimated[row, missed, column]
    axes.plot(frames[missed], at, "o", color=PAPER_COLOURS[4], markersize=4, fillstyle="none")
    axes.set(xlabel="frame", ylabel=AXIS_NAMES[column], title=f"target {target}")


LEGEND = ("measurement", "estimate", "estimate without a measurement")


def measurement_and_estimate(target: int, figure: Figure) -> None:
    """Figures 8 and 9: measurements and estimates of a target of experiment 1 over frames."""
    _, _, histories = _sensed(TWO)
    places = figure.subplots(1, 2)
    for axes, column in zip(places, (X_AXIS, Y_AXIS), strict=True):
        _against_frames(axes, histories, target, column)
    figure.legend(places[0].lines, LEGEND, loc="outside lower center", ncols=3)


def errors_over_frames(figure: Figure) -> None:
    """Figure 10: estimate minus measurement of both targets over frames."""
    _, _, histories = _sensed(TWO)
    frames = np.arange(1, histories.truth.shape[1] + 1)
    places = figure.subplots(1, 2, sharey=True)
    for row, axes in enumerate(places):
        for column, colour in ((X_AXIS, PAPER_COLOURS[0]), (Y_AXIS, PAPER_COLOURS[1])):
            difference = histories.estimated[row, :, column] - histories.measured[row, :, column]
            axes.plot(frames, difference, color=colour, linewidth=1, label=AXIS_NAMES[column])
        axes.set(xlabel="frame", title=f"target {row + 1}")
    places[0].set_ylabel("estimate minus measurement (m)")
    places[0].legend()


def occlusion_from_above(figure: Figure) -> None:
    """Figure 11: target 2 cuts in and hides target 1; measurements and tracks from above."""
    figure.set_size_inches(10.0, 5.5)
    sensed, _, histories = _sensed(OCCLUSION)
    places = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, frame in zip(places.flat, OCCLUDED_FRAMES, strict=True):
        draw_points(axes, sensed.clouds[frame - 1].points)
        _truth_boxes(axes, sensed, frame)
        for row in range(len(histories.truth)):
            track = histories.estimated[row, max(frame - 15, 0) : frame]
            axes.plot(*track.T, color=PAPER_COLOURS[row], linewidth=1.5)
            now = track[-1]
            if np.isfinite(now[0]):
                axes.annotate(
                    f"track of target {row + 1}", now, fontsize=7, color=PAPER_COLOURS[row]
                )
        seen_from_above(axes, f"frame {frame}")
        axes.set(xlim=(0.0, 62.0), ylim=(-12.0, 12.0))


def occlusion_in_x(figure: Figure) -> None:
    """Figure 12: measurements and estimates of both targets of experiment 2 in x."""
    _, _, histories = _sensed(OCCLUSION)
    places = figure.subplots(1, 2)
    for row, axes in enumerate(places):
        _against_frames(axes, histories, row + 1, X_AXIS)
    figure.legend(places[0].lines, LEGEND, loc="outside lower center", ncols=3)


def three_vehicles(figure: Figure) -> None:
    """Figure 13: the scene of experiment 3 and the vehicles that are detected in it."""
    sensed, boxes, _ = _sensed(THREE)
    axes = figure.subplots()
    draw_points(axes, sensed.clouds[THREE_FRAME - 1].points)
    _truth_boxes(axes, sensed, THREE_FRAME)
    _detected_boxes(axes, boxes[THREE_FRAME - 1])
    seen_from_above(axes, f"experiment 3, frame {THREE_FRAME}, detector pag")
    axes.legend(loc="upper right")


def _detected_boxes(axes: Axes, boxes: Detections) -> None:
    poses = np.column_stack([boxes.centres[:, :2], boxes.yaws])
    for k, (pose, size) in enumerate(zip(poses, boxes.sizes, strict=True)):
        draw_box(axes, pose, size, PAPER_COLOURS[1], "detections" if k == 0 else "")


def three_in_y(figure: Figure) -> None:
    """Figure 14: measurements of all targets of experiment 3 in y."""
    _, _, histories = _sensed(THREE)
    axes = figure.subplots()
    frames = np.arange(1, histories.truth.shape[1] + 1)
    for row, measured in enumerate(histories.measured[..., Y_AXIS]):
        axes.plot(frames, measured, ".-", color=PAPER_COLOURS[row], label=f"target {row + 1}")
    axes.set(xlabel="frame", ylabel=AXIS_NAMES[Y_AXIS], title="measurements of experiment 3")
    axes.legend()


FIGURES = {
    "figure-07": clusters_and_lines,
    "figure-08": partial(measurement_and_estimate, 1),
    "figure-09": partial(measurement_and_estimate, 2),
    "figure-10": errors_over_frames,
    "figure-11": occlusion_from_above,
    "figure-12": occlusion_in_x,
    "figure-13": three_vehicles,
    "figure-14": three_in_y,
}
"""By the paper's number."""
