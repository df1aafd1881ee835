"""Figures 7 to 14 of Lu 2018 from our experiments with the first test seed."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.papers.drawing import (
    caption,
    draw_box,
    draw_clusters,
    draw_points,
    legend_above,
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
METHOD = f"pag + {READING}"
"""Detector and tracker of all figures of tracks."""
SCENE_FRAME = 60
"""Frame of experiment 1 in which both targets are in view."""
OCCLUDED_FRAMES = (48, 58, 68, 80)
"""Frames of experiment 2: before target 2 comes, while it cuts in, hides target 1, has passed."""
THREE_FRAME = 10
TRACKS_M = (-10.0, 30.0)
"""Least and greatest x of the tracks of experiment 1, which reach no farther."""
TRAIL = 15
"""Frames of a track that are drawn."""
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
    """Figure 7: a scene of experiment 1, its tracks, and its clusters by PAG and by distance."""
    figure.set_size_inches(10.0, 9.0)
    sensed, _, histories = _sensed(TWO)
    cloud = sensed.clouds[SCENE_FRAME - 1]
    (scene, tracks), clustered = figure.subplots(2, 2)
    draw_points(scene, cloud.points, PAPER_COLOURS[0], "returns above the ground")
    _truth_boxes(scene, sensed, SCENE_FRAME)
    seen_from_above(scene, f"(a) experiment 1, frame {SCENE_FRAME}")
    scene.legend(loc="upper left", markerscale=3)
    _tracks_from_above(tracks, histories)
    tracks.set_title(f"(b) tracks of frames 1 to {histories.truth.shape[1]}, y stretched")
    for letter, axes, name in zip("cd", clustered, ("pag", "distance"), strict=True):
        labels = CLUSTERINGS[name](cloud)
        draw_clusters(axes, cloud.points, labels)
        for outline in contours(cloud, labels):
            if len(outline) > 1:
                for segment in fit_iepf(outline):
                    axes.plot(*segment.points[[0, -1]].T, color=PAPER_TRUTH, linewidth=1)
        count = len(np.unique(labels[labels >= 0]))
        seen_from_above(axes, f"({letter}) {name}: {count} clusters (lines black, outliers grey)")
    for axes in (scene, *clustered):
        axes.set(xlim=(5.0, 50.0), ylim=(-25.0, 28.0))
    caption(figure, f"{METHOD} (tracks), clusterings pag and distance")


def _tracks_from_above(axes: Axes, histories: TargetHistories) -> None:
    """Draw truth, measurements and estimates of all targets in the ego frame, y stretched."""
    for row, (truth, measured, estimated) in enumerate(
        zip(histories.truth, histories.measured, histories.estimated, strict=True)
    ):
        names = ("truth", "measurements", "estimates") if row == 0 else ("", "", "")
        axes.plot(*truth.T, color=PAPER_TRUTH, linewidth=4, alpha=0.25, label=names[0])
        axes.plot(*measured.T, ".", color=PAPER_COLOURS[1], markersize=3, label=names[1])
        axes.plot(*estimated.T, color=PAPER_COLOURS[0], linewidth=1, label=names[2])
        place = (TRACKS_M[1] - 1.0, truth[-1, 1] - 0.9)
        axes.text(*place, f"target {row + 1}", ha="right")
    seen_from_above(axes)
    axes.set_aspect("auto")
    axes.set(xlim=TRACKS_M, ylim=(-5.5, 5.5), box_aspect=53.0 / 45.0)
    axes.legend(loc="upper left")


def _against_frames(axes: Axes, histories: TargetHistories, target: int, column: int) -> None:
    frames, row = np.arange(1, histories.truth.shape[1] + 1), target - 1
    measured, estimated = (
        each[row, :, column] for each in (histories.measured, histories.estimated)
    )
    missed = ~histories.detected[row] & np.isfinite(estimated)
    axes.plot(frames, measured, ".", color=PAPER_COLOURS[1], markersize=3, label="measurement")
    axes.plot(frames, estimated, color=PAPER_COLOURS[0], linewidth=1, label="estimate")
    _mark_coasting(axes, np.column_stack([frames, estimated])[missed], 4)
    axes.set(xlabel="frame", ylabel=AXIS_NAMES[column], title=f"target {target}")


def _mark_coasting(axes: Axes, places: np.ndarray, size: int) -> None:
    """Mark (N, 2) estimates that have no measurement."""
    colour, name = PAPER_COLOURS[4], "estimate without a measurement"
    axes.plot(*places.T, "o", color=colour, markersize=size, fillstyle="none", label=name)


def measurement_and_estimate(target: int, figure: Figure) -> None:
    """Figures 8 and 9: measurements and estimates of a target of experiment 1 over frames."""
    _, _, histories = _sensed(TWO)
    places = figure.subplots(1, 2)
    for axes, column in zip(places, (X_AXIS, Y_AXIS), strict=True):
        _against_frames(axes, histories, target, column)
    legend_above(figure, places)
    caption(figure, METHOD)


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
    legend_above(figure, places)
    caption(figure, METHOD)


def occlusion_from_above(figure: Figure) -> None:
    """Figure 11: target 2 cuts in and hides target 1; measurements and tracks from above."""
    figure.set_size_inches(10.0, 5.5)
    sensed, _, histories = _sensed(OCCLUSION)
    places = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, frame in zip(places.flat, OCCLUDED_FRAMES, strict=True):
        draw_points(axes, sensed.clouds[frame - 1].points, label="returns")
        _truth_boxes(axes, sensed, frame)
        for row in range(len(histories.truth)):
            _trail(axes, histories, row, frame)
        seen_from_above(axes, f"frame {frame}")
        axes.set(xlim=(0.0, 62.0), ylim=(-12.0, 12.0))
    legend_above(figure, places.flat)
    caption(figure, f"{METHOD}; the last {TRAIL} frames of each track")


def _trail(axes: Axes, histories: TargetHistories, row: int, frame: int) -> None:
    """Draw the last frames of a track and where it is now."""
    track = histories.estimated[row, max(frame - TRAIL, 0) : frame]
    if not np.isfinite(track[-1, 0]):
        return
    axes.plot(*track.T, color=PAPER_COLOURS[row], linewidth=1.5, label=f"track of target {row + 1}")
    axes.plot(*track[-1], "o", color=PAPER_COLOURS[row], markersize=4)
    if not histories.detected[row, frame - 1]:
        _mark_coasting(axes, track[-1:], 9)


def occlusion_in_x(figure: Figure) -> None:
    """Figure 12: measurements and estimates of both targets of experiment 2 in x."""
    _, _, histories = _sensed(OCCLUSION)
    places = figure.subplots(1, 2)
    for row, axes in enumerate(places):
        _against_frames(axes, histories, row + 1, X_AXIS)
    legend_above(figure, places)
    caption(figure, METHOD)


def three_vehicles(figure: Figure) -> None:
    """Figure 13: the scene of experiment 3 and the vehicles that are detected in it."""
    sensed, boxes, _ = _sensed(THREE)
    axes = figure.subplots()
    draw_points(axes, sensed.clouds[THREE_FRAME - 1].points)
    _truth_boxes(axes, sensed, THREE_FRAME)
    _detected_boxes(axes, boxes[THREE_FRAME - 1])
    seen_from_above(axes, f"experiment 3, frame {THREE_FRAME}")
    legend_above(figure, [axes])
    caption(figure, "pag")


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
    legend_above(figure, [axes])
    caption(figure, "pag")


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
