"""Rows of KITTI tracking files: labels, detections, results."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.benchmarks.formats.by_frame import rows_by_frame
from roadscope.benchmarks.formats.table import (
    MAX_FRAMES,
    Table,
    read_table,
    refuse_backward,
    refuse_twins,
)
from roadscope.core import Category
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

LABEL_COLUMNS = (
    "frame", "id", "type", "truncated", "occluded", "alpha", "left", "top", "right", "bottom",
    "height", "width", "length", "x", "y", "z", "rotation_y", "score",
)  # fmt: skip
DETECTION_COLUMNS = (
    "frame", "class", "left", "top", "right", "bottom", "score", "height", "width", "length",
    "x", "y", "z", "rotation_y", "alpha",
)  # fmt: skip


class KittiType(IntEnum):
    """The types of KITTI's tracking labels."""

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
    KittiType.CAR: "Car", KittiType.VAN: "Van", KittiType.TRUCK: "Truck",
    KittiType.PEDESTRIAN: "Pedestrian", KittiType.PERSON: "Person",
    KittiType.CYCLIST: "Cyclist", KittiType.TRAM: "Tram", KittiType.MISC: "Misc",
    KittiType.DONT_CARE: "DontCare",
}  # fmt: skip
"""As files spell them; `Person` is one who sits, also spelt `Person_sitting`."""
TYPES = {name.lower(): kind for kind, name in TYPE_NAMES.items()} | {
    "person_sitting": KittiType.PERSON
}
TYPE_OF = {
    Category.CAR: KittiType.CAR,
    Category.PEDESTRIAN: KittiType.PEDESTRIAN,
    Category.CYCLIST: KittiType.CYCLIST,
}
"""The types that are detected."""
CLASS_IDS = {1: KittiType.PEDESTRIAN, 2: KittiType.CAR, 3: KittiType.CYCLIST}
"""How detection files number them."""
FARTHEST_M, FARTHEST_PX = 1e4, 1e9
"""Beyond lies nothing; -1000 m is unknown, and what reaches behind the camera is far outside."""
MAX_ANGLE_RAD = 4 * np.pi
"""Some files leave whole turns in angles, -10 is unknown."""
MOST_TRUNCATED, MOST_OCCLUDED = 2, 3


@dataclass(frozen=True, slots=True, eq=False)
class KittiObjects(Record):
    """Rows of one sequence, in file order, in KITTI's own conventions.

    frames: (N,) int64, from 0.
    ids: (N,) int64, -1 for none.
    types: (N,) int8, values of `KittiType`.
    truncated: (N,) int64; 0 not, 1 partly, 2 largely, -1 unknown.
    occluded: (N,) int64; 0 not, 1 partly, 2 largely, 3 unknown, -1 where it has no meaning.
    alphas: (N,) float64, radians, observation angle.
    boxes: (N, 4) float64, pixels, left top right bottom.
    sizes: (N, 3) float64, metres, length width height; -1000 or -1 where there is no 3-D box.
    bottoms: (N, 3) float64, metres, centre of the bottom face, rectified camera frame (x right,
        y down, z ahead).
    rotations_y: (N,) float64, radians about y, 0 for a length axis along x.
    scores: (N,) float64, as the file has them, of any range; 1 in files without.
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
            truncated=(np.int64, ("N",)),
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

    def select(self, index: np.ndarray) -> KittiObjects:
        """Keep the rows that a mask or an index array names."""
        kept: dict[str, Any] = {f.name: getattr(self, f.name)[index] for f in fields(self)}
        return KittiObjects(**kept)

    @property
    def solid(self) -> np.ndarray:
        """(N,) bool, rows that have a 3-D box."""
        return np.asarray(np.all(self.sizes > 0, axis=1))

    def by_frame(self, count: int) -> list[KittiObjects]:
        """Return the rows of frames 0 to count - 1, in file order."""
        return rows_by_frame(self, 0, count)


def read_labels(path: Path | str, *, results: bool = False) -> KittiObjects:
    """Read a label file (17 columns) or a tracker's results (17, or 18 with a score).

    Results may come in any order of frames, and without 3-D boxes.
    """
    last = len(LABEL_COLUMNS)
    columns = LABEL_COLUMNS[: last if results else last - 1]
    return _labels(read_table(Path(path), columns, least=17), results=results)


def read_objects(path: Path | str, frame: int) -> KittiObjects:
    """Read a detector's results on one frame: KITTI's object format, 15 columns or 16 with a score.

    These are the columns of labels without frame and id.
    """
    table = read_table(Path(path), LABEL_COLUMNS[2:], least=15)
    rows = [[str(frame), "-1", *row] for row in table.rows]
    return _labels(replace(table, rows=rows, columns=LABEL_COLUMNS), results=True)


def _labels(table: Table, *, results: bool) -> KittiObjects:
    frames, ids = table.integers(0, 0, MAX_FRAMES - 1), table.integers(1, -1)
    types = _types(table)
    refuse_twins(table, frames, ids)
    if not results:
        refuse_backward(table, frames)
    sizes = table.within(10, 13, FARTHEST_M, "m")[:, ::-1]
    nothing = (types == KittiType.DONT_CARE)[:, None]
    flat = np.asarray(np.all(sizes < 0, axis=1))[:, None] & results
    _refuse_boxes(table, sizes, nothing | flat, 10)
    boxes = _image_boxes(table, 6)
    scored = bool(table.rows) and len(table.rows[0]) == len(LABEL_COLUMNS)
    return KittiObjects(
        frames, ids, types, _truncated(table, results), table.integers(4, -1, MOST_OCCLUDED),
        _angles(table, 5), boxes, sizes, table.within(13, 16, FARTHEST_M, "m"), _angles(table, 16),
        table.numbers(17, 18)[:, 0] if scored else np.ones(len(table)),
    )  # fmt: skip


def read_detections(path: Path | str) -> KittiObjects:
    """Read detections, comma separated (the layout of AB3DMOT); a file may be empty."""
    path = Path(path)
    table = read_table(path, DETECTION_COLUMNS, separator=",")
    frames, classes = table.integers(0, 0, MAX_FRAMES - 1), table.integers(1)
    known = ", ".join(f"{k} {TYPE_NAMES[v].lower()}" for k, v in CLASS_IDS.items())
    table.require(np.isin(classes, list(CLASS_IDS)), f"a class ({known})", 1)
    refuse_backward(table, frames)
    sizes, boxes = table.within(7, 10, FARTHEST_M, "m")[:, ::-1], _image_boxes(table, 2)
    _refuse_boxes(table, sizes, np.zeros((len(table), 1), bool), 7)
    none = np.full(len(table), -1)
    return KittiObjects(
        frames, none, np.array([CLASS_IDS[c] for c in classes.tolist()], np.int8), none, none,
        _angles(table, 14), boxes, sizes, table.within(10, 13, FARTHEST_M, "m"),
        _angles(table, 13), table.numbers(6, 7)[:, 0],
    )  # fmt: skip


def _types(table: Table) -> np.ndarray:
    names = [row[2].lower() for row in table.rows]
    proper = np.array([name in TYPES for name in names], bool)
    table.require(proper, f"a type ({', '.join(TYPE_NAMES.values())})", 2)
    return np.array([TYPES[name] for name in names], np.int8)


def _refuse_boxes(table: Table, sizes: np.ndarray, excused: np.ndarray, column: int) -> None:
    proper = np.asarray(np.all((sizes > 0) | excused, axis=1))
    table.require(proper, "a height, width and length above 0", column, column + 3)


def _image_boxes(table: Table, column: int) -> np.ndarray:
    boxes = table.within(column, column + 4, FARTHEST_PX, "pixels")
    proper = np.asarray(np.all(boxes[:, 2:] >= boxes[:, :2], axis=1))
    wanted = "left top right bottom with right >= left and bottom >= top"
    table.require(proper, wanted, column, column + 4)
    return boxes


def _angles(table: Table, column: int) -> np.ndarray:
    return table.within(column, column + 1, MAX_ANGLE_RAD, "rad")[:, 0]


def _truncated(table: Table, results: bool) -> np.ndarray:
    """Return levels; results may have shares as KITTI's single images do, which become 0."""
    if not results:
        return table.integers(3, -1, MOST_TRUNCATED)
    values = table.numbers(3, 4)[:, 0]
    levels = np.isin(values, np.arange(-1, MOST_TRUNCATED + 1))
    wanted = f"a truncated of -1 to {MOST_TRUNCATED}, or a share of 0 to 1"
    table.require(levels | ((values >= 0) & (values <= 1)), wanted, 3)
    return values.astype(np.int64)
