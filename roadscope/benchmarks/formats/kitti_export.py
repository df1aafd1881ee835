"""Tracks, labels, detections and calibration as KITTI has them."""

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
from roadscope.benchmarks.formats.kitti_objects import (
    CLASS_IDS,
    TYPE_NAMES,
    KittiObjects,
    KittiType,
)
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
    *,
    all_around: bool = False,
) -> KittiObjects:
    """Turn the tracks of one frame into rows; those that the image does not show are left out.

    all_around: keep those too; their boxes in the image are empty.
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
    shown = np.flatnonzero(np.all(boxes[:, 2:] > boxes[:, :2], axis=1) | all_around)
    types = np.array([TYPE_FROM_CATEGORY[Category(c)] for c in seen.categories], np.int8)
    unknown = np.full(len(shown), -1)
    return KittiObjects(
        np.full(len(shown), frame), seen.ids[shown], types[shown], unknown, unknown,
        alphas(bottoms, rotations)[shown], boxes[shown], seen.sizes[shown], bottoms[shown],
        rotations[shown], seen.scores[shown],
    )  # fmt: skip


def save_results(path: Path | str, frames: Sequence[KittiObjects]) -> None:
    """Write rows, in order of frames, as 18 columns with six decimals."""
    _write(
        Path(path), [_line(rows, k, [rows.scores[k]]) for rows in frames for k in range(len(rows))]
    )


def save_labels(path: Path, frames: Sequence[KittiObjects]) -> None:
    """Write rows, in order of frames, as the 17 columns of labels with six decimals."""
    _write(path, [_line(rows, k, []) for rows in frames for k in range(len(rows))])


def save_detections(path: Path, frames: Sequence[KittiObjects]) -> None:
    """Write rows of types that are detected, separated by commas, as AB3DMOT has them."""
    numbers = {kind: number for number, kind in CLASS_IDS.items()}
    lines = []
    for rows in frames:
        for k in range(len(rows)):
            values = [
                *rows.boxes[k],
                rows.scores[k],
                *rows.sizes[k, ::-1],
                *rows.bottoms[k],
                rows.rotations_y[k],
                rows.alphas[k],
            ]
            numbered = f"{rows.frames[k]},{numbers[KittiType(rows.types[k])]}"
            lines.append(f"{numbered},{','.join(f'{v:.6f}' for v in values)}\n")
    _write(path, lines)


def calibration_text(projection: np.ndarray, camera_from_lidar: Pose, lidar_from_imu: Pose) -> str:
    """Return a calibration file; all cameras are the one.

    projection: (3, 4), pixels from metres in the camera frame, which is rectified.
    """
    matrices = {f"P{k}": projection for k in range(4)} | {
        "R0_rect": np.eye(3),
        "Tr_velo_to_cam": camera_from_lidar.matrix[:3],
        "Tr_imu_to_velo": lidar_from_imu.matrix[:3],
    }
    return "".join(
        f"{key}: {' '.join(f'{v:.12e}' for v in matrix.ravel())}\n"
        for key, matrix in matrices.items()
    )


def _write(path: Path, lines: Sequence[str]) -> None:
    path.write_text("".join(lines), encoding="utf-8")


def _line(rows: KittiObjects, k: int, scores: Sequence[float]) -> str:
    """Return one line, height width length in KITTI's order."""
    kind = TYPE_NAMES[KittiType(rows.types[k])]
    head = f"{rows.frames[k]} {rows.ids[k]} {kind} {rows.truncated[k]} {rows.occluded[k]}"
    values = [
        rows.alphas[k],
        *rows.boxes[k],
        *rows.sizes[k, ::-1],
        *rows.bottoms[k],
        rows.rotations_y[k],
        *scores,
    ]
    return f"{head} {' '.join(f'{v:.6f}' for v in values)}\n"
