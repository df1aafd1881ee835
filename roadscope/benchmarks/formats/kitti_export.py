"""Tracks as KITTI tracking results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.kitti_frames import (
    alphas,
    bottoms_from_centres,
    clipped_boxes,
    corners,
    rotations_from_yaws,
)
from roadscope.benchmarks.formats.kitti_objects import TYPE_NAMES, KittiObjects, KittiType
from roadscope.core import Category, Pose, Tracks

TYPE_FROM_CATEGORY = {
    Category.CAR: KittiType.CAR, Category.VAN: KittiType.VAN, Category.TRUCK: KittiType.TRUCK,
    Category.BUS: KittiType.MISC, Category.MOTORCYCLE: KittiType.MISC,
    Category.CYCLIST: KittiType.CYCLIST, Category.PEDESTRIAN: KittiType.PEDESTRIAN,
}  # fmt: skip
"""KITTI has no type of its own for buses and motorcycles."""


def kitti_objects(
    tracks: Tracks,
    frame: int,
    world_from_ego: Pose,
    projection: np.ndarray,
    image_size: tuple[int, int],
) -> KittiObjects:
    """Turn the tracks of one frame into rows; those that the image does not show are left out.

    world_from_ego: of the same frame; the ego frame is the camera's turned to ISO 8855.
    projection: (3, 4), pixels from metres in the rectified camera frame.
    image_size: width and height in pixels, to which boxes are clipped.
    """
    seen = tracks.moved(world_from_ego.inverse(), "ego") if tracks.frame == "world" else tracks
    bottoms = bottoms_from_centres(seen.centres, seen.sizes)
    # Undoes exactly what `Detections.moved` does to yaws; by the inverse of a tilted pose they
    # would come back a few hundredths of a degree off.
    yaws = tracks.yaws - world_from_ego.yaw if tracks.frame == "world" else tracks.yaws
    rotations = rotations_from_yaws(yaws)
    boxes = clipped_boxes(corners(bottoms, seen.sizes, rotations), projection, image_size)
    shown = np.flatnonzero(np.all(boxes[:, 2:] > boxes[:, :2], axis=1))
    types = np.array([TYPE_FROM_CATEGORY[Category(c)] for c in seen.categories], np.int8)
    unknown = np.full(len(shown), -1)
    return KittiObjects(
        np.full(len(shown), frame), seen.ids[shown], types[shown], unknown, unknown,
        alphas(bottoms, rotations)[shown], boxes[shown], seen.sizes[shown], bottoms[shown],
        rotations[shown], seen.scores[shown],
    )  # fmt: skip


def save_results(path: Path, frames: Sequence[KittiObjects]) -> None:
    """Write rows, in order of frames, as 18 columns with six decimals."""
    path.write_text("".join(_line(rows, k) for rows in frames for k in range(len(rows))))


def _line(rows: KittiObjects, k: int) -> str:
    """Return one line, height width length in KITTI's order."""
    kind = TYPE_NAMES[KittiType(rows.types[k])]
    head = f"{rows.frames[k]} {rows.ids[k]} {kind} {rows.truncated[k]} {rows.occluded[k]}"
    values = [
        rows.alphas[k], *rows.boxes[k], *rows.sizes[k, ::-1], *rows.bottoms[k],
        rows.rotations_y[k], rows.scores[k],
    ]  # fmt: skip
    return f"{head} {' '.join(f'{v:.6f}' for v in values)}\n"
