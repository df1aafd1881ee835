"""KITTI's text files of objects: labels, detections and results of trackers and detectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.table import Table, read_table
from roadscope.benchmarks.formats.tracking_rows import (
    MAX_FRAMES,
    require_ordered_frames,
    require_unique_ids,
    rows_by_frame,
)
from roadscope.core import Category
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.core.tables import ArrayTable

LABEL_COLUMNS = (
    *("frame", "id", "type", "truncated", "occluded", "alpha", "left", "top", "right", "bottom"),
    *("height", "width", "length", "x", "y", "z", "rotation_y", "score"),
)
"""Columns of results; labels lack the last one, and object results the first two."""
DETECTION_COLUMNS = (
    *("frame", "class", "left", "top", "right", "bottom", "score", "height", "width", "length"),
    *("x", "y", "z", "rotation_y", "alpha"),
)
"""Columns of detections, as AB3DMOT has them."""


class KittiType(IntEnum):
    """The object types of KITTI's tracking labels."""

    CAR = 0
    VAN = 1
    TRUCK = 2
    PEDESTRIAN = 3
    PERSON = 4
    CYCLIST = 5
    TRAM = 6
    MISC = 7
    DONT_CARE = 8


TYPE_NAMES = {
    KittiType.CAR: "Car",
    KittiType.VAN: "Van",
    KittiType.TRUCK: "Truck",
    KittiType.PEDESTRIAN: "Pedestrian",
    KittiType.PERSON: "Person",
    KittiType.CYCLIST: "Cyclist",
    KittiType.TRAM: "Tram",
    KittiType.MISC: "Misc",
    KittiType.DONT_CARE: "DontCare",
}
"""The spelling in files. `Person` is a sitting person, also spelt `Person_sitting`."""
TYPES_BY_NAME = {name.lower(): kind for kind, name in TYPE_NAMES.items()} | {
    "person_sitting": KittiType.PERSON
}
DETECTED_TYPES = {
    Category.CAR: KittiType.CAR,
    Category.PEDESTRIAN: KittiType.PEDESTRIAN,
    Category.CYCLIST: KittiType.CYCLIST,
}
"""The classes of which there are detections."""
CLASS_IDS = {1: KittiType.PEDESTRIAN, 2: KittiType.CAR, 3: KittiType.CYCLIST}
"""The numbers of the classes in files of detections."""
MAX_DISTANCE_M = 1e4
"""No box is larger or further away. -1000 m stands for unknown. Chosen by hand."""
MAX_PIXEL = 1e9
"""Boxes that reach behind the camera project far outside of the image. Chosen by hand."""
MAX_ANGLE_RAD = 4 * np.pi
"""Some files leave whole turns in angles; -10 stands for unknown."""
MAX_TRUNCATED = 2
MAX_OCCLUDED = 3


@dataclass(frozen=True, slots=True, eq=False)
class KittiObjects(ArrayTable, Record):
    """N objects in the order of their file, in KITTI's own conventions.

    frames: (N,) int64, from 0.
    ids: (N,) int64, -1 for none.
    types: (N,) int8, values of `KittiType`.
    truncated: (N,) float64; in tracking data a level, 0 not, 1 partly, 2 largely; in object data
        the share that is outside of the image; -1 unknown.
    occluded: (N,) int64; 0 not, 1 partly, 2 largely, 3 unknown, -1 not applicable.
    alphas: (N,) float64, radians, observation angle.
    boxes: (N, 4) float64, pixels, left top right bottom.
    sizes: (N, 3) float64, metres, length width height; -1000 or -1 if there is no 3-D box.
    bottoms: (N, 3) float64, metres, centre of the bottom face, rectified camera frame (x right,
        y down, z ahead).
    rotations_y: (N,) float64, radians about y, 0 for a length axis along x.
    scores: (N,) float64 of any range, as in the file; 1 for files without scores.
    """

    frames: np.ndarray
    ids: np.ndarray
    types: np.ndarray
    truncated: np.ndarray
    occluded: np.ndarray
    alphas: np.ndarray
    boxes: np.ndarray
    sizes: np.ndarray
    bottoms: np.ndarray
    rotations_y: np.ndarray
    scores: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            frames=(np.int64, ("N",)),
            ids=(np.int64, ("N",)),
            types=(np.int8, ("N",)),
            truncated=(np.float64, ("N",)),
            occluded=(np.int64, ("N",)),
            alphas=(np.float64, ("N",)),
            boxes=(np.float64, ("N", 4)),
            sizes=(np.float64, ("N", 3)),
            bottoms=(np.float64, ("N", 3)),
            rotations_y=(np.float64, ("N",)),
            scores=(np.float64, ("N",)),
        )

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def in_image(self) -> np.ndarray:
        """(N,) bool, which rows have an image box that is not empty."""
        shown: np.ndarray = np.all(self.boxes[:, 2:] > self.boxes[:, :2], axis=1)
        return shown

    @property
    def has_3d_box(self) -> np.ndarray:
        """(N,) bool, which rows have a 3-D box."""
        return np.asarray(np.all(self.sizes > 0, axis=1))

    def by_frame(self, count: int) -> list[KittiObjects]:
        """Return the rows of each of the frames 0 to count - 1, in the order of the file."""
        return rows_by_frame(self, 0, count)


def read_kitti_labels(path: Path | str, *, results: bool = False) -> KittiObjects:
    """Read a file of labels (17 columns) or of a tracker's results (17, or 18 with a score).

    results: frames may come in any order, and 3-D boxes may be missing.
    """
    most = len(LABEL_COLUMNS)
    columns = LABEL_COLUMNS[: most if results else most - 1]
    table = read_table(Path(path), columns, required=17)
    return _objects_of(table, results=results, shares=results)


def read_kitti_object_labels(path: Path | str, frame: int = 0) -> KittiObjects:
    """Read the labels of one frame of KITTI's object data: 15 columns, `truncated` as a share.

    frame: its number, which the file does not have. An empty file has no objects.
    """
    table = read_table(Path(path), LABEL_COLUMNS[2:-1])
    rows = [[str(frame), "-1", *row] for row in table.rows]
    return _objects_of(replace(table, rows=rows, columns=LABEL_COLUMNS), shares=True)


def read_kitti_object_results(path: Path | str, frame: int) -> KittiObjects:
    """Read a detector's results on one frame: KITTI's object format, 15 columns or 16 with a score.

    These are the columns of labels without frame and id.
    """
    table = read_table(Path(path), LABEL_COLUMNS[2:], required=15)
    rows = [[str(frame), "-1", *row] for row in table.rows]
    return _objects_of(replace(table, rows=rows, columns=LABEL_COLUMNS), results=True, shares=True)


def read_kitti_detections(path: Path | str) -> KittiObjects:
    """Read a file of detections, separated by commas as AB3DMOT has them; it may be empty."""
    path = Path(path)
    table = read_table(path, DETECTION_COLUMNS, separator=",")
    frames, classes = table.integers(0, 0, MAX_FRAMES - 1), table.integers(1)
    table.require(np.isin(classes, list(CLASS_IDS)), f"a class ({class_numbering()})", 1)
    require_ordered_frames(table, frames)
    sizes, boxes = table.within(7, 10, MAX_DISTANCE_M, "m")[:, ::-1], _image_boxes(table, 2)
    _require_sizes(table, sizes, np.zeros((len(table), 1), bool), 7)
    unknown = np.full(len(table), -1)
    return KittiObjects(
        frames=frames,
        ids=unknown,
        types=np.array([CLASS_IDS[c] for c in classes.tolist()], np.int8),
        truncated=unknown,
        occluded=unknown,
        alphas=_angles(table, 14),
        boxes=boxes,
        sizes=sizes,
        bottoms=table.within(10, 13, MAX_DISTANCE_M, "m"),
        rotations_y=_angles(table, 13),
        scores=table.numbers(6, 7)[:, 0],
    )


def class_numbering() -> str:
    """Return in words how files of detections number classes."""
    return ", ".join(f"{k} {TYPE_NAMES[kind].lower()}" for k, kind in CLASS_IDS.items())


def write_kitti_results(path: Path | str, frames: Sequence[KittiObjects]) -> None:
    """Write a tracker's results: 18 columns, six decimals.

    frames: the rows of each frame, in order.
    """
    _write_lines(
        path, [_label_line(rows, k, [rows.scores[k]]) for rows in frames for k in range(len(rows))]
    )


def write_kitti_labels(path: Path | str, frames: Sequence[KittiObjects]) -> None:
    """Write labels: 17 columns, six decimals; frames as for `write_kitti_results`."""
    _write_lines(path, [_label_line(rows, k, []) for rows in frames for k in range(len(rows))])


def write_kitti_object_results(path: Path | str, rows: KittiObjects) -> None:
    """Write a detector's results on one frame: 16 columns, six decimals."""
    _write_lines(path, [_object_line(rows, k, [rows.scores[k]]) for k in range(len(rows))])


def write_kitti_detections(path: Path | str, frames: Sequence[KittiObjects]) -> None:
    """Write detections, separated by commas as AB3DMOT has them; all types are of `CLASS_IDS`."""
    _write_lines(path, [_detection_line(rows, k) for rows in frames for k in range(len(rows))])


def _objects_of(table: Table, *, results: bool = False, shares: bool = False) -> KittiObjects:
    """Return the rows of a table.

    results: frames may come in any order, and 3-D boxes may be missing.
    shares: `truncated` may be a share instead of a level.
    """
    frames, ids = table.integers(0, 0, MAX_FRAMES - 1), table.integers(1, -1)
    types = _types(table)
    require_unique_ids(table, frames, ids)
    if not results:
        require_ordered_frames(table, frames)
    sizes = table.within(10, 13, MAX_DISTANCE_M, "m")[:, ::-1]
    is_region = (types == KittiType.DONT_CARE)[:, None]
    is_2d = np.asarray(np.all(sizes < 0, axis=1))[:, None] & results
    _require_sizes(table, sizes, is_region | is_2d, 10)
    boxes = _image_boxes(table, 6)
    has_scores = bool(table.rows) and len(table.rows[0]) == len(LABEL_COLUMNS)
    return KittiObjects(
        frames=frames,
        ids=ids,
        types=types,
        truncated=_truncations(table, shares),
        occluded=table.integers(4, -1, MAX_OCCLUDED),
        alphas=_angles(table, 5),
        boxes=boxes,
        sizes=sizes,
        bottoms=table.within(13, 16, MAX_DISTANCE_M, "m"),
        rotations_y=_angles(table, 16),
        scores=table.numbers(17, 18)[:, 0] if has_scores else np.ones(len(table)),
    )


def _types(table: Table) -> np.ndarray:
    names = [row[2].lower() for row in table.rows]
    valid = np.array([name in TYPES_BY_NAME for name in names], bool)
    table.require(valid, f"a type ({', '.join(TYPE_NAMES.values())})", 2)
    return np.array([TYPES_BY_NAME[name] for name in names], np.int8)


def _require_sizes(table: Table, sizes: np.ndarray, exempt: np.ndarray, column: int) -> None:
    """Refuse sizes of 0 or less, except in the exempt rows, (N, 1) bool."""
    valid = np.asarray(np.all((sizes > 0) | exempt, axis=1))
    table.require(valid, "a height, width and length above 0", column, column + 3)


def _image_boxes(table: Table, column: int) -> np.ndarray:
    boxes = table.within(column, column + 4, MAX_PIXEL, "pixels")
    valid = np.asarray(np.all(boxes[:, 2:] >= boxes[:, :2], axis=1))
    expected = "left top right bottom with right >= left and bottom >= top"
    table.require(valid, expected, column, column + 4)
    return boxes


def _angles(table: Table, column: int) -> np.ndarray:
    return table.within(column, column + 1, MAX_ANGLE_RAD, "rad")[:, 0]


def _truncations(table: Table, shares: bool) -> np.ndarray:
    """Return levels -1 to 2, or if `shares` says so shares from 0 to 1."""
    if not shares:
        return table.integers(3, -1, MAX_TRUNCATED).astype(np.float64)
    values = table.numbers(3, 4)[:, 0]
    is_level = np.isin(values, np.arange(-1, MAX_TRUNCATED + 1))
    is_share = (values >= 0) & (values <= 1)
    expected = f"truncated as a level (-1, 0, 1, {MAX_TRUNCATED}) or as a share from 0 to 1"
    table.require(is_level | is_share, expected, 3)
    return values


def _write_lines(path: Path | str, lines: Sequence[str]) -> None:
    Path(path).write_text("".join(lines), encoding="utf-8")


def _label_line(rows: KittiObjects, k: int, scores: Sequence[float]) -> str:
    """Return row k as a line of a label file, with a score if there is one in `scores`."""
    return f"{rows.frames[k]} {rows.ids[k]} {_object_line(rows, k, scores)}"


def _object_line(rows: KittiObjects, k: int, scores: Sequence[float]) -> str:
    """Return row k without frame and id."""
    head = f"{TYPE_NAMES[KittiType(rows.types[k])]} {rows.truncated[k]:g} {rows.occluded[k]}"
    values = [
        rows.alphas[k],
        *rows.boxes[k],
        *rows.sizes[k, ::-1],
        *rows.bottoms[k],
        rows.rotations_y[k],
        *scores,
    ]
    return f"{head} {' '.join(f'{v:.6f}' for v in values)}\n"


def _detection_line(rows: KittiObjects, k: int) -> str:
    """Return row k as a line of a file of detections."""
    numbers = {kind: number for number, kind in CLASS_IDS.items()}
    values = [
        *rows.boxes[k],
        rows.scores[k],
        *rows.sizes[k, ::-1],
        *rows.bottoms[k],
        rows.rotations_y[k],
        rows.alphas[k],
    ]
    head = f"{rows.frames[k]},{numbers[KittiType(rows.types[k])]}"
    return f"{head},{','.join(f'{v:.6f}' for v in values)}\n"
