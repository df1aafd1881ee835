"""Parts of a composed frame beside the bird's-eye view: camera image, range image, scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Category, Frame, ImageDetections, LidarScan, Tracks, Truth
from roadscope.core.palette import (
    DETECTION_COLOURS,
    GROUND_COLOUR,
    LABEL_COLOUR,
    PANEL_COLOUR,
    RING_COLOUR,
    TRUTH_COLOUR,
    track_colour,
)
from roadscope.core.projection import NEAR_M, Projection
from roadscope.core.record import Record
from roadscope.envs.drawing.birds_eye import SCALE_COLOURS, box_corners, scale_levels
from roadscope.envs.drawing.canvas import Canvas, text_px
from roadscope.envs.drawing.labels import LabelPlacer, places_beside
from roadscope.envs.sensors.lidar_spec import LidarSpec

SMALL_PX, VALUE_PX = 12, 20
"""Sizes of letters of captions and of scores."""
LEAST_VISIBLE_PX = 20
"""True boxes of objects with fewer visible pixels are not drawn."""
CAMERA_NEAR_M = 0.5
"""Boxes of which a corner is nearer to the camera, or behind it, are not drawn."""
OVER_FIRST = [6, 7, 0, 1]
"""Rows of `places_beside` for labels in images: above the box, below it, beside it."""
EDGES = np.array([(k, (k + 1) % 4) for k in range(4)])
"""Pairs of corners of the lower face of a box."""


@dataclass(frozen=True, slots=True, eq=False)
class RunningScore(Record):
    """A figure that changes from frame to frame.

    name: with its unit. decimals: of the value that is written.
    values: (T,) float64, one of each frame so far, the latest last; NaN where there is none.
    top: end of the scale on which the values are drawn; None: the greatest so far.
    """

    name: str
    values: np.ndarray
    decimals: int = 2
    top: float | None = None

    def until(self, index: int) -> RunningScore:
        """Return the score as it was at an earlier frame."""
        return replace(self, values=self.values[: index + 1])


# --------------------------------------------------------------------------------------------------
# Camera.


def camera_panel(
    width: int,
    height: int,
    frame: Frame | None,
    truth: Truth | None,
    *,
    detections: ImageDetections | None = None,
    tracks: Tracks | None = None,
) -> np.ndarray:
    """Return a (height, width, 3) image of a camera with true boxes, detections and tracks.

    frame, truth: of the image; without an image the panel says so.
    tracks: world frame, drawn at the stamp of the image.
    """
    canvas = Canvas(width, height, PANEL_COLOUR)
    image = None if frame is None else frame.camera
    if frame is None or image is None:
        text = "no image"
        place = (np.array([width, height]) - text_px(text, SMALL_PX)) / 2
        canvas.text(text, place, LABEL_COLOUR, SMALL_PX)
        return canvas.image()
    scale = min(width / image.size_px[0], height / image.size_px[1])
    canvas.paste(
        image.pixels,
        np.zeros(2),
        width=round(image.size_px[0] * scale),
        height=round(image.size_px[1] * scale),
    )
    if truth is not None and truth.image_boxes is not None:
        for box in truth.image_boxes[truth.visible_pixels >= LEAST_VISIBLE_PX]:
            canvas.polygon(_rectangle(box * scale), TRUTH_COLOUR, fill=0.0, line_px=1.0)
    if detections is not None:
        _draw_boxes(canvas, detections, scale)
    if tracks is not None and truth is not None:
        projection = Projection.of(
            image.intrinsics, frame.calibration.pose(image.sensor), *image.size_px
        )
        _draw_tracks(canvas, projection, tracks, truth, scale)
    return canvas.image()


def image_view(pixels: np.ndarray, detections: ImageDetections) -> np.ndarray:
    """Return an (H, W, 3) uint8 image with boxes, their categories and scores, best ones first."""
    height, width = pixels.shape[:2]
    canvas = Canvas(width, height)
    canvas.paste(pixels, np.zeros(2), width=width, height=height)
    _draw_boxes(canvas, detections, 1.0)
    labels = LabelPlacer(canvas)
    for row in np.argsort(-detections.scores, kind="stable"):
        category = Category(int(detections.categories[row]))
        text = f"{category.name.lower()} {detections.scores[row]:.2f}"
        places = places_beside(_rectangle(detections.boxes[row]), text, SMALL_PX)
        labels.write(text, places[OVER_FIRST], DETECTION_COLOURS[category.family], SMALL_PX)
    return canvas.image()


def _draw_boxes(canvas: Canvas, detections: ImageDetections, scale: float) -> None:
    for box, number in zip(detections.boxes, detections.categories.tolist(), strict=True):
        colour = DETECTION_COLOURS[Category(number).family]
        canvas.polygon(_rectangle(box * scale), colour, fill=0.0, line_px=2.0)


def _rectangle(box: np.ndarray) -> np.ndarray:
    """Return the corners of a box in an image: left, top, right, bottom."""
    return box[[[0, 1], [2, 1], [2, 3], [0, 3]]]


def _draw_tracks(
    canvas: Canvas, projection: Projection, tracks: Tracks, truth: Truth, scale: float
) -> None:
    """Draw the edges of the boxes of tracks, the farthest first, and their ids."""
    ego_from_world = truth.world_from_ego.inverse()
    late_s = truth.stamp_s - tracks.stamp_s
    labels, corners_of = LabelPlacer(canvas), {}
    for row in range(len(tracks)):
        centre, size = tracks.centres[row], tracks.sizes[row]
        base = box_corners(centre[:2] + late_s * tracks.velocities[row], size, tracks.yaws[row])
        heights = centre[2] + size[2] * np.array([-0.5, 0.5])
        corners = np.concatenate([np.column_stack([base, np.full(4, z)]) for z in heights])
        pixels, depths = projection.project(ego_from_world.apply(corners))
        pixels = pixels * scale
        inside = (pixels.max(axis=0) > 0) & (pixels.min(axis=0) < (canvas.width, canvas.height))
        if depths.min() > max(NEAR_M, CAMERA_NEAR_M) and inside.all():
            corners_of[row] = pixels, float(depths.mean())
    nearest_first = sorted(corners_of, key=lambda row: corners_of[row][1])
    for row in reversed(nearest_first):
        pixels, colour = corners_of[row][0], track_colour(int(tracks.ids[row]))
        for first, second in [*EDGES, *(EDGES + 4), *zip(range(4), range(4, 8), strict=True)]:
            canvas.line(pixels[[first, second]], colour, 1.5)
    for row in nearest_first:
        text, pixels = str(tracks.ids[row]), corners_of[row][0]
        places = places_beside(pixels, text, SMALL_PX)[OVER_FIRST]
        labels.write(text, places, track_colour(int(tracks.ids[row])), SMALL_PX)


# --------------------------------------------------------------------------------------------------
# Range image.


def range_panel(
    width: int, height: int, scan: LidarScan | None, spec: LidarSpec, *, intensity: bool = False
) -> np.ndarray:
    """Return a (height, width, 3) image of a scan: beams from below, azimuths from left to right.

    It shows ranges, near ones bright, or intensities. Where several returns share a pixel, one of
    them is shown; a pixel without any is dark.
    """
    levels = np.zeros((spec.beams, width), np.uint8)
    if scan is not None and len(scan):
        # Columns may run either way around; the left is on the left.
        columns = scan.column if spec.azimuth_span < 0 else spec.columns - 1 - scan.column
        if intensity:
            values = scale_levels(scan.intensity, 0.0, 1.0)
        else:
            ranges = np.sqrt(np.einsum("ij,ij->i", scan.points, scan.points))
            farthest = float(np.log(spec.range_max_m))
            values = scale_levels(-np.log(np.maximum(ranges, 1.0)), -farthest, 0.0)
        levels[spec.beams - 1 - scan.ring, columns * width // spec.columns] = values
    rows = np.arange(height) * spec.beams // height
    table = SCALE_COLOURS.astype(np.uint8)
    table[0] = PANEL_COLOUR
    return table[levels[rows]]


# --------------------------------------------------------------------------------------------------
# Scores.


def score_panel(width: int, height: int, scores: Sequence[RunningScore]) -> np.ndarray:
    """Return a (height, width, 3) image of figures with their courses so far."""
    canvas = Canvas(width, height, GROUND_COLOUR)
    cell = width / max(len(scores), 1)
    for number, score in enumerate(scores):
        low = np.array([number * cell, 0.0])
        box = np.array([low[0], 0, low[0] + cell - 6, height])
        canvas.polygon(_rectangle(box), PANEL_COLOUR)
        canvas.text(score.name, low + np.array([8, 6]), LABEL_COLOUR, SMALL_PX)
        value = score.values[-1] if len(score.values) else np.nan
        text = "-" if np.isnan(value) else f"{value:.{score.decimals}f}"
        canvas.text(text, low + np.array([8, 20]), TRUTH_COLOUR, VALUE_PX)
        _draw_course(canvas, score, np.array([low[0] + 8, 50, low[0] + cell - 14, height - 8]))
    return canvas.image()


def _draw_course(canvas: Canvas, score: RunningScore, box: np.ndarray) -> None:
    """Draw the values of a score from left to right, from 0 at the bottom to its top."""
    canvas.line(box[[[0, 3], [2, 3]]], RING_COLOUR, 1.0)
    rows = np.flatnonzero(np.isfinite(score.values))
    if len(rows) < 2:
        return
    top = score.top or max(float(score.values[rows].max()), 1e-9)
    x = box[0] + (box[2] - box[0]) * rows / (len(score.values) - 1)
    y = box[3] + (box[1] - box[3]) * np.clip(score.values[rows] / top, 0.0, 1.0)
    canvas.line(np.stack([x, y], axis=1), LABEL_COLOUR, 1.5)
