"""MOTChallenge's text files: detections, ground truth, results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.benchmarks.formats.by_frame import rows_by_frame
from roadscope.benchmarks.formats.seqinfo import read_info
from roadscope.benchmarks.formats.table import (
    MAX_FRAMES,
    FormatError,
    Table,
    read_lines,
    read_table,
    refuse,
    refuse_backward,
    refuse_twins,
)
from roadscope.core import Category, ImageDetections, Tracks
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

COLUMNS = ("frame", "id", "left", "top", "width", "height", "confidence")
CLASS_COLUMNS = (*COLUMNS, "class", "visibility")
WORLD_COLUMNS = (*COLUMNS, "x", "y", "z")
CLASSES = {
    1: Category.PEDESTRIAN, 2: None, 3: Category.CAR, 4: Category.CYCLIST, 5: Category.MOTORCYCLE,
    6: None, 7: Category.PEDESTRIAN, 8: None, 9: None, 10: None, 11: None, 12: None, 13: None,
}  # fmt: skip
"""Classes of MOT16 and later; the others are distractors, occluders, reflections, crowds and
people on vehicles."""
PEDESTRIAN = 1
FARTHEST = 1e9
"""No box, pixels, and no place, metres, lies beyond."""


@dataclass(frozen=True, slots=True, eq=False)
class MotRows(Record):
    """Rows of one file, in file order.

    frames: (N,) int64, from 1.
    ids: (N,) int64, -1 for none.
    boxes: (N, 4) float64, pixels, left top right bottom; all -1 where no camera saw it.
    confidences: (N,) float64, of any range; in ground truth 0 for rows to be left out.
    classes: (N,) int64, keys of `CLASSES`; pedestrians where the file has none.
    visibilities: (N,) float64, 1 where the file has none.
    points: (N, 3) float64, metres, world, where the object stands; -1 where unknown.
    """

    frames: np.ndarray
    ids: np.ndarray
    boxes: np.ndarray
    confidences: np.ndarray
    classes: np.ndarray
    visibilities: np.ndarray
    points: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            frames=(np.int64, ("N",)),
            ids=(np.int64, ("N",)),
            boxes=(np.float64, ("N", 4)),
            confidences=(np.float64, ("N",)),
            classes=(np.int64, ("N",)),
            visibilities=(np.float64, ("N",)),
            points=(np.float64, ("N", 3)),
        )

    def __len__(self) -> int:
        return len(self.frames)

    def select(self, index: np.ndarray) -> MotRows:
        """Keep the rows that a mask or an index array names."""
        kept: dict[str, Any] = {f.name: getattr(self, f.name)[index] for f in fields(self)}
        return MotRows(**kept)


@dataclass(frozen=True, slots=True, eq=False)
class MotSequence(Record):
    """One sequence; tuples have an item a frame.

    detections: of `det/det.txt`; scores 0 to 1 as in the file, or by the logistic function where
        the file goes beyond.
    detected: the same rows with raw confidences.
    truth: of `gt/gt.txt`; None without.
    """

    name: str
    detections: tuple[ImageDetections, ...]
    detected: tuple[MotRows, ...]
    truth: tuple[MotRows, ...] | None
    rate_hz: float
    image_size: tuple[int, int] | None


def read_mot(
    path: Path | str,
    *,
    ordered: bool = False,
    truth: bool = False,
    end: tuple[int, str] | None = None,
) -> MotRows:
    """Read a det.txt, gt.txt or result file of 7, 9 (class, visibility) or 10 (x y z) columns.

    ordered: refuse frames that decrease, as detections must not.
    truth: refuse rows without an id, which detections have.
    end: the last frame that may be there, and what says so; None: as far as any sequence goes.
    """
    path = Path(path)
    table = _table(path)
    frames, ids = table.integers(0, 1, MAX_FRAMES), table.integers(1, 0 if truth else -1)
    n = len(table)
    if end is not None:
        table.require(frames <= end[0], f"a frame of at most {end[0]}, {end[1]}", 0)
    refuse_twins(table, frames, ids)
    if ordered:
        refuse_backward(table, frames)
    boxes = _boxes(table)
    classes, visible, points = np.full(n, PEDESTRIAN), np.ones(n), np.full((n, 3), -1.0)
    if table.columns == CLASS_COLUMNS:
        classes, visible = table.integers(7), table.numbers(8, 9)[:, 0]
        table.require(np.isin(classes, list(CLASSES)), "a class from 1 to 13", 7)
        table.require((visible >= 0) & (visible <= 1), "a visibility in 0 to 1", 8)
    elif table.columns == WORLD_COLUMNS:
        points = table.within(7, 10, FARTHEST, "m")
    return MotRows(frames, ids, boxes, table.numbers(6, 7)[:, 0], classes, visible, points)


def read_mot_sequence(folder: Path | str) -> MotSequence:
    """Read a folder with `det/det.txt` and, where they are, `gt/gt.txt` and `seqinfo.ini`."""
    root = Path(folder)
    det = root / "det" / "det.txt"
    if not det.is_file():
        raise FormatError(f"{det}: missing; expected det/det.txt, gt/gt.txt and seqinfo.ini")
    info = read_info(root / "seqinfo.ini")
    end = None if info.length is None else (info.length, "the seqLength of seqinfo.ini")
    found = read_mot(det, ordered=True, end=end)
    gt = root / "gt" / "gt.txt"
    true = read_mot(gt, truth=True, end=end) if gt.is_file() else None
    last = max(int(r.frames.max(initial=0)) for r in (found, true) if r is not None)
    count = last if info.length is None else info.length
    rows = by_frame(found, count)
    return MotSequence(
        root.absolute().name, _image_frames(rows, info.rate_hz), rows,
        None if true is None else by_frame(true, count), info.rate_hz, info.image_size,
    )  # fmt: skip


def mot_rows(tracks: Tracks, frame: int, boxes: np.ndarray | None = None) -> MotRows:
    """Turn the tracks of one frame into rows with world coordinates.

    frame: from 1.
    boxes: (N, 4) pixels, left top right bottom; None where no camera saw them. Tracks with an
        empty box are left out.
    x y z are where the object stands: the centre of its bottom face, in the frame of the tracks.
    """
    n = len(tracks)
    feet = tracks.centres - np.column_stack([np.zeros((n, 2)), tracks.sizes[:, 2] / 2])
    codes = {category: code for code, category in reversed(CLASSES.items())}
    classes = np.array([codes.get(Category(c), 6) for c in tracks.categories], np.int64)
    image = np.full((n, 4), -1.0) if boxes is None else boxes
    rows = MotRows(np.full(n, frame), tracks.ids, image, tracks.scores, classes, np.ones(n), feet)
    return rows if boxes is None else rows.select(np.all(boxes[:, 2:] > boxes[:, :2], axis=1))


def save_mot(path: Path | str, frames: Sequence[MotRows], *, world: bool = True) -> None:
    """Write results of 10 columns, world coordinates or -1 in the last three."""
    path = Path(path)
    lines = []
    for rows in frames:
        points = rows.points if world else np.full((len(rows), 3), -1.0)
        for k in range(len(rows)):
            left, top, right, bottom = rows.boxes[k]
            size = (right - left, bottom - top) if right > left else (-1.0, -1.0)
            values = (left, top, *size, rows.confidences[k], *points[k])
            texts = ",".join(f"{v:.6f}" for v in values)
            lines.append(f"{rows.frames[k]},{rows.ids[k]},{texts}\n")
    path.write_text("".join(lines))


def _table(path: Path) -> Table:
    """Tell the three kinds apart by the first line."""
    for number, line in enumerate(read_lines(path), start=1):
        if line.strip():
            width = len(line.split(","))
            for columns in (COLUMNS, CLASS_COLUMNS, WORLD_COLUMNS):
                if width == len(columns):
                    return read_table(path, columns, separator=",")
            wanted = f"7 columns ({' '.join(COLUMNS)}), 9 (and class visibility) or 10 (and x y z)"
            refuse(path, number, wanted, f"{width} columns")
    return read_table(path, COLUMNS, separator=",")


def by_frame(rows: MotRows, count: int) -> tuple[MotRows, ...]:
    """Return the rows of frames 1 to count, in file order."""
    return tuple(rows_by_frame(rows, 1, count))


def _boxes(table: Table) -> np.ndarray:
    """Return (N, 4) left top right bottom, all -1 where no camera saw it."""
    given = table.within(2, 6, FARTHEST, "pixels")
    size = given[:, 2:]
    unseen = np.asarray(np.all(given == -1, axis=1))
    proper = np.asarray(np.all(size > 0, axis=1)) | unseen
    table.require(proper, "a width and height above 0", 4, 6)
    boxes = np.concatenate([given[:, :2], given[:, :2] + size], axis=1)
    boxes[unseen] = -1.0
    return boxes


def _image_frames(frames: Sequence[MotRows], rate_hz: float) -> tuple[ImageDetections, ...]:
    """Turn rows into detections; scores stay where all are 0 to 1."""
    probable = all(np.all((r.confidences >= 0) & (r.confidences <= 1)) for r in frames if len(r))
    empty = ImageDetections(np.empty((0, 4)), np.empty(0, np.int8), np.empty(0), 0.0)
    return tuple(
        _image_detections(r, t / rate_hz, probable)
        if len(r)
        else empty._trusted(stamp_s=t / rate_hz)
        for t, r in enumerate(frames)
    )


def _image_detections(rows: MotRows, stamp_s: float, probable: bool) -> ImageDetections:
    """Leave out classes that are no road users."""
    from roadscope.benchmarks.formats.kitti import logistic

    kinds = [CLASSES[c] for c in rows.classes.tolist()]
    kept = np.array([kind is not None for kind in kinds], bool)
    categories = np.array([kind for kind in kinds if kind is not None], np.int8)
    scores = rows.confidences[kept] if probable else logistic(rows.confidences[kept])
    return ImageDetections(rows.boxes[kept], categories, scores, stamp_s)
