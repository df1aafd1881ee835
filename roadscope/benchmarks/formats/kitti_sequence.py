"""A folder of KITTI tracking data, and one of its sequences as detections, poses and truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.formats.kitti_calibration import (
    KittiCalibration,
    read_kitti_calibration,
    read_kitti_oxts,
    read_kitti_poses,
)
from roadscope.benchmarks.formats.kitti_frames import (
    PERIOD_S,
    detections_from_rows,
    kitti_objects,
    truths_from_rows,
)
from roadscope.benchmarks.formats.kitti_labels import (
    CLASS_IDS,
    DETECTED_TYPES,
    DETECTION_COLUMNS,
    TYPE_NAMES,
    KittiObjects,
    class_numbering,
    read_kitti_detections,
    read_kitti_labels,
)
from roadscope.benchmarks.formats.table import FormatError, names_in, visible
from roadscope.benchmarks.formats.tracking_rows import ImageSize
from roadscope.core import Category, Detections, Pose, Tracks, Truth
from roadscope.core.names import unknown
from roadscope.core.record import Record

DETECTOR_PREFIX = "det_"
"""The detections of a detector are in the folder `det_NAME`."""
POSE_FOLDERS = ("ego_pose", "poses", "oxts")
"""Folders of poses; the first one that has the sequence is used."""
CLASS_COLUMN = DETECTION_COLUMNS.index("class")
SCORE_COLUMN = DETECTION_COLUMNS.index("score")


@dataclass(frozen=True, slots=True)
class KittiFolder:
    """The places of the files; nothing is read yet.

    root: the folder that holds `label_02` and `calib`.
    """

    root: Path

    @staticmethod
    def find(folder: Path | str) -> KittiFolder:
        """Return the folder, or its `training`, whichever has labels; others are refused."""
        folder = Path(folder)
        if not folder.is_dir():
            raise FormatError(f"{folder}: no such folder; expected one with label_02/SEQ.txt")
        for root in (folder, folder / "training"):
            if (root / "label_02").is_dir():
                files = KittiFolder(root)
                if not files.sequences():
                    raise FormatError(f"{root / 'label_02'}: expected SEQ.txt files, got none")
                return files
        raise FormatError(
            f"{folder}: expected label_02/SEQ.txt, calib/SEQ.txt, "
            f"{DETECTOR_PREFIX}NAME/Car/SEQ.txt and ego_pose/SEQ.txt (or oxts/SEQ.txt), here or in "
            f"training/; got {names_in(folder)}"
        )

    def sequences(self) -> list[str]:
        """Return the names of all sequences that have labels."""
        return [path.stem for path in visible(self.root / "label_02", "*.txt")]

    def detectors(self) -> list[str]:
        """Return the names of all detectors whose detections are here."""
        folders = [p for p in visible(self.root, f"{DETECTOR_PREFIX}*") if p.is_dir()]
        return [p.name.removeprefix(DETECTOR_PREFIX) for p in folders]

    def labels(self, sequence: str) -> Path:
        """Return the file of labels of a sequence."""
        return self._existing("label_02", sequence)

    def calibration(self, sequence: str) -> Path:
        """Return the calibration file of a sequence."""
        return self._existing("calib", sequence)

    def detections(self, sequence: str, category: Category, detector: str) -> Path:
        """Return the file of detections of one class in a sequence."""
        return self._existing(_class_folder(category, detector), sequence)

    def has_detections(self, sequence: str, category: Category, detector: str) -> bool:
        """Return whether the file of detections exists."""
        return self._path(_class_folder(category, detector), sequence).is_file()

    def poses(self, sequence: str) -> Path:
        """Return the file of poses of a sequence, from the first of `POSE_FOLDERS` that has it."""
        for name in POSE_FOLDERS:
            path = self.root / name / f"{sequence}.txt"
            if path.is_file():
                return path
        places = ", ".join(f"{name}/{sequence}.txt" for name in POSE_FOLDERS)
        raise FormatError(f"{self.root}: no poses of sequence {sequence}; expected one of {places}")

    def choose_detector(self, name: str | None) -> str:
        """Return the name if it is known, or the only detector for None; others are refused."""
        known = self.detectors()
        if not known:
            raise FormatError(
                f"{self.root}: expected {DETECTOR_PREFIX}NAME/Car/SEQ.txt, "
                f"got no {DETECTOR_PREFIX}NAME"
            )
        if name is None and len(known) > 1:
            raise FormatError(f"{self.root}: several detectors, name one: {', '.join(known)}")
        if name is not None and name not in known:
            raise FormatError(f"{self.root}: {unknown('detector', name, known)}")
        return name or known[0]

    def scores_are_normalized(self, detector: str) -> bool:
        """Return whether all scores of a detector, in all its files, are from 0 to 1.

        All files are read because a single one may have only such scores by chance. Lines that
        cannot be read are skipped here; the reader of their file reports them.
        """
        for path in visible(self.root, f"{DETECTOR_PREFIX}{detector}/*/*.txt"):
            for line in path.read_bytes().splitlines():
                try:
                    if not 0 <= float(line.split(b",")[SCORE_COLUMN]) <= 1:
                        return False
                except (ValueError, IndexError):
                    continue
        return True

    def _existing(self, folder: str, sequence: str) -> Path:
        path = self._path(folder, sequence)
        if not path.is_file():
            raise FormatError(f"{path}: missing; sequence {sequence} needs it")
        return path

    def _path(self, folder: str, sequence: str) -> Path:
        return self.root / folder / f"{sequence}.txt"


def _class_folder(category: Category, detector: str) -> str:
    return f"{DETECTOR_PREFIX}{detector}/{TYPE_NAMES[DETECTED_TYPES[category]]}"


@dataclass(frozen=True, slots=True, eq=False)
class KittiSequence(Record):
    """One sequence and one class of road users; all tuples have T items, one per frame.

    detections: in the ego frame, which is the rectified camera frame with the axes of ISO 8855.
        Scores are from 0 to 1: the detector's own if none of its files has others, otherwise
        mapped by the logistic function.
    detection_rows: the same rows as in the file, with image boxes and original scores.
    world_from_ego: the world is the frame of the poses in their file.
    truths: the labelled objects of this class, world frame. Velocities are differences of the
        labelled centres in the world frame, so they have the errors of the poses; an object with
        a single frame has velocity 0. What nobody counted (`lidar_returns`, `visible_pixels`,
        `occluded_fraction`) is -1.
    label_rows: all labels of every type, as in the file.
    image_size: the smallest image that holds all image boxes; no file gives its size.
    other_class_rows: number of rows in the file of detections that are of another class.
    """

    name: str
    category: Category
    detector: str
    detections: tuple[Detections, ...]
    detection_rows: tuple[KittiObjects, ...]
    world_from_ego: tuple[Pose, ...]
    truths: tuple[Truth, ...]
    label_rows: tuple[KittiObjects, ...]
    calibration: KittiCalibration
    image_size: ImageSize
    other_class_rows: int = 0

    def __len__(self) -> int:
        return len(self.detections)

    def result_rows(self, tracks: Sequence[Tracks]) -> list[KittiObjects]:
        """Return the tracks of each frame, ego or world frame, as KITTI's rows of results."""
        projection, size = self.calibration.projection, self.image_size
        return [
            kitti_objects(record, frame, pose, projection, size)
            for frame, (record, pose) in enumerate(zip(tracks, self.world_from_ego, strict=True))
        ]


def read_kitti_sequence(
    folder: Path | str | KittiFolder,
    sequence: str,
    category: Category = Category.CAR,
    *,
    detector: str | None = None,
) -> KittiSequence:
    """Read one class of a sequence; a malformed file raises `FormatError`.

    category: car, pedestrian or cyclist.
    detector: NAME of the folder `det_NAME`; None for the only one.
    A sequence has as many frames as poses. Detections of another class are left out. If no row of
    any sequence is of the class, the files number classes in another way; they are refused.
    """
    files = folder if isinstance(folder, KittiFolder) else KittiFolder.find(folder)
    if category not in DETECTED_TYPES:
        known = ", ".join(c.name.lower() for c in DETECTED_TYPES)
        raise FormatError(
            f"KITTI has no detections of category {Category(category).name.lower()}; known: {known}"
        )
    name = files.choose_detector(detector)
    labels_path = files.labels(sequence)
    detections_path = files.detections(sequence, category, name)
    calibration = read_kitti_calibration(files.calibration(sequence))
    poses = _read_poses(files, sequence, calibration)
    labels, rows = read_kitti_labels(labels_path), read_kitti_detections(detections_path)
    for path, objects in ((labels_path, labels), (detections_path, rows)):
        _check_length(path, objects, files.poses(sequence), len(poses))
    of_class = rows.types == DETECTED_TYPES[category]
    if len(rows) and not of_class.any():
        count_other_classes(files, category, name)
    rows = rows.select(of_class)
    true = labels.select((labels.types == DETECTED_TYPES[category]) & (labels.ids >= 0))
    by_frame = rows.by_frame(len(poses))
    normalized = files.scores_are_normalized(name)
    return KittiSequence(
        sequence,
        category,
        name,
        detections=tuple(
            detections_from_rows(frame, category, stamp_s=PERIOD_S * t, normalized=normalized)
            for t, frame in enumerate(by_frame)
        ),
        detection_rows=tuple(by_frame),
        world_from_ego=tuple(poses),
        truths=truths_from_rows(true, category, poses),
        label_rows=tuple(labels.by_frame(len(poses))),
        calibration=calibration,
        image_size=_image_size(labels, rows),
        other_class_rows=int((~of_class).sum()),
    )


class ClassCount(NamedTuple):
    """Rows of detections of one class, in the files of all sequences.

    other: number of rows of another class than that of their folder.
    total: number of all rows.
    """

    other: int
    total: int


def count_other_classes(files: KittiFolder, category: Category, detector: str) -> ClassCount:
    """Count the rows of another class in the files of all sequences.

    If there are rows and none is of the class, `FormatError` says how classes are numbered. One
    file alone may lack the class, because some detectors put all classes in every file.
    """
    paths = [
        files.detections(sequence, category, detector)
        for sequence in files.sequences()
        if files.has_detections(sequence, category, detector)
    ]
    numbers = _class_numbers(paths)
    expected = next(k for k, kind in CLASS_IDS.items() if kind == DETECTED_TYPES[category])
    of_class = numbers.count(expected)
    if numbers and not of_class:
        actual = ", ".join(map(str, sorted(set(numbers))))
        raise FormatError(
            f"{paths[0].parent}: expected rows of class {expected} in the second column "
            f"({class_numbering()}), got {len(numbers)} rows, all of class {actual}"
        )
    return ClassCount(len(numbers) - of_class, len(numbers))


def other_classes_remark(files: KittiFolder, category: Category, detector: str) -> str:
    """Return a sentence with the number of rows left out for their class; empty if none are."""
    count = count_other_classes(files, category, detector)
    if not count.other:
        return ""
    kind = TYPE_NAMES[DETECTED_TYPES[category]]
    return (
        f"{count.other} of {count.total} rows in {DETECTOR_PREFIX}{detector}/{kind} are left out: "
        f"their class is not {kind.lower()} ({class_numbering()})."
    )


def _class_numbers(paths: Sequence[Path]) -> list[int]:
    """Return the class numbers of all rows; the reader of a file reports malformed lines."""
    numbers = []
    for path in paths:
        for line in path.read_bytes().splitlines():
            try:
                numbers.append(int(float(line.split(b",")[CLASS_COLUMN])))
            except (ValueError, IndexError, OverflowError):
                continue
    return numbers


def _read_poses(files: KittiFolder, sequence: str, calibration: KittiCalibration) -> list[Pose]:
    path = files.poses(sequence)
    is_oxts = path.parent.name == "oxts"
    poses = read_kitti_oxts(path, calibration) if is_oxts else read_kitti_poses(path)
    if not poses:
        raise FormatError(f"{path}: expected one pose per frame, got an empty file")
    return poses


def _image_size(*objects: KittiObjects) -> ImageSize:
    """Return the size that holds all boxes; no file gives it, and KITTI's images differ in size."""
    ends = np.concatenate([np.zeros((1, 2)), *(rows.boxes[:, 2:] for rows in objects)])
    width, height = np.floor(ends.max(axis=0)).astype(int).tolist()
    return ImageSize(width + 1, height + 1)


def _check_length(path: Path, objects: KittiObjects, poses: Path, count: int) -> None:
    """Refuse poses that end before the last frame of a file of objects."""
    last = int(objects.frames.max(initial=-1))
    if last >= count:
        raise FormatError(
            f"{poses}: expected a pose for each of the frames 0 to {last} of {path}, "
            f"got {count} poses"
        )
