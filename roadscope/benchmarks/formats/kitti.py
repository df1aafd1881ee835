"""A folder of KITTI tracking data as detections, poses and truth of ours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.kitti_calibration import KittiCalibration, read_calibration
from roadscope.benchmarks.formats.kitti_classes import other_rows
from roadscope.benchmarks.formats.kitti_folder import KittiFolder
from roadscope.benchmarks.formats.kitti_frames import centres_from_bottoms, yaws_from_rotations
from roadscope.benchmarks.formats.kitti_objects import (
    TYPE_OF,
    KittiObjects,
    read_detections,
    read_labels,
)
from roadscope.benchmarks.formats.kitti_poses import read_oxts, read_poses
from roadscope.benchmarks.formats.table import FormatError
from roadscope.core import Category, Detections, Pose, Truth
from roadscope.core.record import Record

PERIOD_S = 0.1
UNKNOWN = -1
"""Of recorded truth: nobody counted returns and pixels, nor the share that is occluded."""


@dataclass(frozen=True, slots=True, eq=False)
class KittiSequence(Record):
    """One sequence and one class of road users; all tuples have T items, one a frame.

    detections: in the ego frame, which is the rectified camera's turned to ISO 8855; scores
        0 to 1: the detector's own where none of its files goes beyond, otherwise the logistic
        function of them.
    detected: the same rows as the file has them: image boxes, raw scores.
    world_from_ego: the world is the frame in which the poses are given.
    truths: objects labelled as of this class, world frame. Velocities are differences of the
        labelled centres in the world frame, so they carry the poses' errors; an object of one
        frame only has none, 0. What nobody counted (`lidar_returns`, `visible_pixels`,
        `occluded_fraction`) is `UNKNOWN`, -1.
    labelled: all labels, of every type, as the file has them.
    image_size: width and height in pixels: the least that all image boxes fit in.
    left_out: number of rows in the file of detections that are of another class.
    """

    name: str
    category: Category
    detector: str
    detections: tuple[Detections, ...]
    detected: tuple[KittiObjects, ...]
    world_from_ego: tuple[Pose, ...]
    truths: tuple[Truth, ...]
    labelled: tuple[KittiObjects, ...]
    calibration: KittiCalibration
    image_size: tuple[int, int]
    left_out: int = 0

    def __len__(self) -> int:
        return len(self.detections)


def read_sequence(
    folder: Path | str | KittiFolder,
    sequence: str,
    category: Category = Category.CAR,
    *,
    detector: str | None = None,
) -> KittiSequence:
    """Read one class of a sequence; anything malformed raises `FormatError`.

    category: car, pedestrian or cyclist.
    detector: NAME of the folder `det_NAME`; None for the only one.
    A sequence is as long as its poses. Detections of another class are left out; where all are,
    in the files of every sequence, classes are numbered otherwise and that is an error.
    """
    files = folder if isinstance(folder, KittiFolder) else KittiFolder.find(folder)
    if category not in TYPE_OF:
        known = ", ".join(c.name.lower() for c in TYPE_OF)
        raise FormatError(f"no KITTI detections of {Category(category).name.lower()}; of: {known}")
    name = files.the_detector(detector)
    labels_path = files.labels(sequence)
    found_path = files.detections(sequence, category, name)
    calibration = read_calibration(files.calibration(sequence))
    poses = _poses(files, sequence, calibration)
    labels, found = read_labels(labels_path), read_detections(found_path)
    for path, objects in ((labels_path, labels), (found_path, found)):
        _check_length(path, objects, files.poses(sequence), len(poses))
    wanted = found.types == TYPE_OF[category]
    if len(found) and not wanted.any():
        other_rows(files, category, name)
    found = found.select(wanted)
    true = labels.select((labels.types == TYPE_OF[category]) & (labels.ids >= 0))
    by_frame = found.by_frame(len(poses))
    scaled = files.scores_are_shares(name)
    return KittiSequence(
        sequence, category, name,
        detections=tuple(
            detections_of(rows, category, PERIOD_S * t, scaled) for t, rows in enumerate(by_frame)
        ),
        detected=tuple(by_frame),
        world_from_ego=tuple(poses),
        truths=truths_of(true, category, poses),
        labelled=tuple(labels.by_frame(len(poses))),
        calibration=calibration,
        image_size=_image_size(labels, found),
        left_out=int((~wanted).sum()),
    )  # fmt: skip


def detections_of(
    rows: KittiObjects, category: Category, stamp_s: float, scaled: bool = False
) -> Detections:
    """Turn rows of one frame into detections in the ego frame.

    scaled: scores are 0 to 1 already; otherwise the logistic function makes them so.
    """
    return Detections(
        centres_from_bottoms(rows.bottoms, rows.sizes),
        rows.sizes,
        yaws_from_rotations(rows.rotations_y),
        np.full(len(rows), category, np.int8),
        rows.scores if scaled else logistic(rows.scores),
        "ego",
        stamp_s,
    )


def logistic(scores: np.ndarray) -> np.ndarray:
    """Map scores of any range to 0 to 1; their order stays."""
    falling = np.exp(-np.abs(scores))
    mapped: np.ndarray = np.where(scores >= 0, 1.0, falling) / (1 + falling)
    return mapped


def truths_of(
    labels: KittiObjects, category: Category, world_from_ego: Sequence[Pose]
) -> tuple[Truth, ...]:
    """Turn labels of one class into the truth of each frame."""
    boxes = Detections(
        centres_from_bottoms(labels.bottoms, labels.sizes), labels.sizes,
        yaws_from_rotations(labels.rotations_y), np.full(len(labels), category, np.int8),
        np.ones(len(labels)), "ego", 0.0,
    )  # fmt: skip
    rows = [np.flatnonzero(labels.frames == t) for t in range(len(world_from_ego))]
    placed = [
        boxes.select(r).moved(pose, "world") for r, pose in zip(rows, world_from_ego, strict=True)
    ]
    centres = np.empty((len(labels), 3))
    for r, box in zip(rows, placed, strict=True):
        centres[r] = box.centres
    velocities = _velocities(labels, centres)
    return tuple(
        _truth(labels.ids[r], box, velocities[r], PERIOD_S * t, pose)
        for t, (r, box, pose) in enumerate(zip(rows, placed, world_from_ego, strict=True))
    )


def _truth(
    ids: np.ndarray, boxes: Detections, velocities: np.ndarray, stamp_s: float, pose: Pose
) -> Truth:
    unknown = np.full(len(ids), UNKNOWN)
    return Truth(
        ids, boxes.categories, boxes.centres, boxes.sizes, boxes.yaws, velocities,
        unknown, unknown, unknown.astype(np.float64), pose, stamp_s, np.empty(0, np.int64),
    )  # fmt: skip


def _velocities(labels: KittiObjects, centres: np.ndarray) -> np.ndarray:
    """Return (N, 2) m/s by differences of each object's (N, 3) world centres over its frames."""
    velocities = np.zeros((len(labels), 2))
    for number in np.unique(labels.ids):
        rows = np.flatnonzero(labels.ids == number)
        rows = rows[np.argsort(labels.frames[rows])]
        if len(rows) > 1:
            stamps = PERIOD_S * labels.frames[rows]
            velocities[rows] = np.gradient(centres[rows, :2], stamps, axis=0)
    return velocities


def _poses(files: KittiFolder, sequence: str, calibration: KittiCalibration) -> list[Pose]:
    path = files.poses(sequence)
    poses = read_oxts(path, calibration) if path.parent.name == "oxts" else read_poses(path)
    if not poses:
        raise FormatError(f"{path}: expected a pose for each frame, got an empty file")
    return poses


def _image_size(*objects: KittiObjects) -> tuple[int, int]:
    """Return width and height; no file says them, and KITTI's images differ."""
    ends = np.concatenate([np.zeros((1, 2)), *(rows.boxes[:, 2:] for rows in objects)])
    width, height = np.floor(ends.max(axis=0)).astype(int).tolist()
    return width + 1, height + 1


def _check_length(path: Path, objects: KittiObjects, poses: Path, count: int) -> None:
    last = int(objects.frames.max(initial=-1))
    if last >= count:
        raise FormatError(f"{poses}: expected a pose for each frame up to {last} of {path}, "
                          f"got {count} poses")  # fmt: skip
