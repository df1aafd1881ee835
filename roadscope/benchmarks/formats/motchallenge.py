"""MOTChallenge's files: detections, ground truth, results, and `seqinfo.ini`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.formats.table import (
    FormatError,
    Table,
    read_lines,
    read_table,
    refuse,
    width_text,
)
from roadscope.benchmarks.formats.tracking_rows import (
    MAX_FRAMES,
    FrameLimit,
    ImageSize,
    logistic,
    require_ordered_frames,
    require_unique_ids,
    rows_by_frame,
)
from roadscope.core import Category, ImageDetections, Tracks
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.core.tables import ArrayTable

COLUMNS = ("frame", "id", "left", "top", "width", "height", "confidence")
CLASS_COLUMNS = (*COLUMNS, "class", "visibility")
WORLD_COLUMNS = (*COLUMNS, "x", "y", "z")
PEDESTRIAN = 1
PERSON_ON_VEHICLE = 2
NON_MOTOR_VEHICLE = 6
STATIC_PERSON = 7
DISTRACTOR = 8
REFLECTION = 12
CLASSES: dict[int, Category | None] = {
    PEDESTRIAN: Category.PEDESTRIAN,
    PERSON_ON_VEHICLE: None,
    3: Category.CAR,
    4: Category.CYCLIST,
    5: Category.MOTORCYCLE,
    NON_MOTOR_VEHICLE: None,
    STATIC_PERSON: Category.PEDESTRIAN,
    DISTRACTOR: None,
    9: None,
    10: None,
    11: None,
    REFLECTION: None,
    13: None,
}
"""The classes of MOT16 and later; None for what is no road user (occluders, crowds, ...)."""
MAX_COORDINATE = 1e9
"""No box (pixels) and no point (metres) is further away. Chosen by hand."""
SECTION = "[Sequence]"
SECTION_EXPECTED = f"{SECTION} with seqLength and frameRate"
DEFAULT_RATE_HZ = 30.0
"""The frame rate of sequences whose `seqinfo.ini` does not give it."""
MIN_RATE_HZ = 1e-6
MAX_RATE_HZ = 1e6
"""No camera is slower or faster. Chosen by hand."""
MAX_SIDE_PX = 1_000_000
"""No image is wider or higher. Chosen by hand."""


@dataclass(frozen=True, slots=True, eq=False)
class MotRows(ArrayTable, Record):
    """N rows of one file, in its order.

    frames: (N,) int64, from 1.
    ids: (N,) int64, -1 for none.
    boxes: (N, 4) float64, pixels, left top right bottom; all -1 for an object that no camera saw.
    confidences: (N,) float64 of any range; in ground truth 0 for rows that do not count.
    classes: (N,) int64, keys of `CLASSES`; pedestrians in files without classes.
    visibilities: (N,) float64 in 0 to 1; 1 in files without visibilities.
    points: (N, 3) float64, metres, world, where the object touches the ground; -1 if unknown.
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

    def by_frame(self, count: int) -> list[MotRows]:
        """Return the rows of each of the frames 1 to count, in the order of the file."""
        return rows_by_frame(self, 1, count)


@dataclass(frozen=True, slots=True, eq=False)
class MotSequence(Record):
    """One sequence; tuples have T items, one per frame.

    detections: from `det/det.txt`. Scores are from 0 to 1: the file's own if it has no others,
        otherwise mapped by the logistic function.
    detection_rows: the same rows as in the file, with original confidences.
    truth_rows: from `gt/gt.txt`; None without this file.
    image_size: None if `seqinfo.ini` does not give it.
    """

    name: str
    detections: tuple[ImageDetections, ...]
    detection_rows: tuple[MotRows, ...]
    truth_rows: tuple[MotRows, ...] | None
    rate_hz: float
    image_size: ImageSize | None


def read_mot(
    path: Path | str, *, ordered: bool = False, truth: bool = False, limit: FrameLimit | None = None
) -> MotRows:
    """Read a file of detections, ground truth or results: 7, 9 or 10 columns.

    The first seven columns are followed by class and visibility, by x y z, or by nothing.

    ordered: refuse frame numbers that decrease, as those of detections must not.
    truth: refuse rows without an id, which only detections may have.
    limit: refuse frames after the last one of the sequence.
    """
    table = _read_rows(Path(path))
    frames, ids = table.integers(0, 1, MAX_FRAMES), table.integers(1, 0 if truth else -1)
    if limit is not None:
        expected = f"a frame of at most {limit.frame}, {limit.source}"
        table.require(frames <= limit.frame, expected, 0)
    require_unique_ids(table, frames, ids)
    if ordered:
        require_ordered_frames(table, frames)
    boxes, n = _boxes(table), len(table)
    classes, visibilities, points = np.full(n, PEDESTRIAN), np.ones(n), np.full((n, 3), -1.0)
    if table.columns == CLASS_COLUMNS:
        classes, visibilities = table.integers(7), table.numbers(8, 9)[:, 0]
        table.require(np.isin(classes, list(CLASSES)), f"a class from 1 to {max(CLASSES)}", 7)
        in_range = (visibilities >= 0) & (visibilities <= 1)
        table.require(in_range, "a visibility from 0 to 1", 8)
    elif table.columns == WORLD_COLUMNS:
        points = table.within(7, 10, MAX_COORDINATE, "m")
    return MotRows(
        frames=frames,
        ids=ids,
        boxes=boxes,
        confidences=table.numbers(6, 7)[:, 0],
        classes=classes,
        visibilities=visibilities,
        points=points,
    )


def read_mot_sequence(folder: Path | str) -> MotSequence:
    """Read a folder with `det/det.txt`, and `gt/gt.txt` and `seqinfo.ini` if they exist."""
    root = Path(folder)
    detections_path, truth_path = root / "det" / "det.txt", root / "gt" / "gt.txt"
    if not detections_path.is_file():
        raise FormatError(
            f"{detections_path}: missing; expected det/det.txt, gt/gt.txt and seqinfo.ini"
        )
    info = _read_sequence_info(root / "seqinfo.ini")
    limit = None
    if info.length is not None:
        limit = FrameLimit(info.length, "the seqLength of seqinfo.ini")
    rows = read_mot(detections_path, ordered=True, limit=limit)
    truth = read_mot(truth_path, truth=True, limit=limit) if truth_path.is_file() else None
    last = max(int(r.frames.max(initial=0)) for r in (rows, truth) if r is not None)
    count = last if info.length is None else info.length
    by_frame = rows.by_frame(count)
    return MotSequence(
        name=root.absolute().name,
        detections=_image_detections(by_frame, info.rate_hz),
        detection_rows=tuple(by_frame),
        truth_rows=None if truth is None else tuple(truth.by_frame(count)),
        rate_hz=info.rate_hz,
        image_size=info.image_size,
    )


def mot_rows(tracks: Tracks, frame: int, boxes: np.ndarray | None = None) -> MotRows:
    """Return the tracks of one frame as MOTChallenge's rows with world coordinates.

    frame: the frame number, from 1.
    boxes: (N, 4) pixels, left top right bottom; tracks with an empty box are left out. None if
        there is no camera.
    The points are the centres of the bottom faces, in the frame of the tracks.
    """
    n = len(tracks)
    bottoms = tracks.centres - np.column_stack([np.zeros((n, 2)), tracks.sizes[:, 2] / 2])
    numbers = {category: number for number, category in reversed(CLASSES.items())}
    classes = [numbers.get(Category(c), NON_MOTOR_VEHICLE) for c in tracks.categories]
    rows = MotRows(
        frames=np.full(n, frame),
        ids=tracks.ids,
        boxes=np.full((n, 4), -1.0) if boxes is None else boxes,
        confidences=tracks.scores,
        classes=np.array(classes, np.int64),
        visibilities=np.ones(n),
        points=bottoms,
    )
    return rows if boxes is None else rows.select(np.all(boxes[:, 2:] > boxes[:, :2], axis=1))


def write_mot(path: Path | str, frames: Sequence[MotRows], *, world: bool = True) -> None:
    """Write results of 10 columns.

    frames: the rows of each frame, in order.
    world: write the points into the last three columns; otherwise these are -1.
    """
    lines = []
    for rows in frames:
        points = rows.points if world else np.full((len(rows), 3), -1.0)
        for k in range(len(rows)):
            left, top, right, bottom = rows.boxes[k]
            size = (right - left, bottom - top) if right > left else (-1.0, -1.0)
            values = (left, top, *size, rows.confidences[k], *points[k])
            texts = ",".join(f"{v:.6f}" for v in values)
            lines.append(f"{rows.frames[k]},{rows.ids[k]},{texts}\n")
    Path(path).write_text("".join(lines))


def _read_rows(path: Path) -> Table:
    """Read the rows of a file; the first line decides which of the three layouts it has."""
    for number, line in enumerate(read_lines(path), start=1):
        if line.strip():
            width = len(line.split(","))
            for columns in (COLUMNS, CLASS_COLUMNS, WORLD_COLUMNS):
                if width == len(columns):
                    return read_table(path, columns, separator=",")
            expected = (
                f"7 columns ({' '.join(COLUMNS)}), 9 (also class visibility) or 10 (also x y z)"
            )
            refuse(path, number, expected, width_text(width, ","))
    return read_table(path, COLUMNS, separator=",")


def _boxes(table: Table) -> np.ndarray:
    """Return (N, 4) left top right bottom, all -1 for objects that no camera saw."""
    values = table.within(2, 6, MAX_COORDINATE, "pixels")
    sizes = values[:, 2:]
    unseen = np.asarray(np.all(values == -1, axis=1))
    valid = np.asarray(np.all(sizes > 0, axis=1)) | unseen
    table.require(valid, "a width and height above 0", 4, 6)
    boxes = np.concatenate([values[:, :2], values[:, :2] + sizes], axis=1)
    boxes[unseen] = -1.0
    return boxes


def _image_detections(frames: Sequence[MotRows], rate_hz: float) -> tuple[ImageDetections, ...]:
    """Return the rows of each frame as detections; scores stay if all are from 0 to 1."""
    normalized = all(np.all((r.confidences >= 0) & (r.confidences <= 1)) for r in frames if len(r))
    empty = ImageDetections(np.empty((0, 4)), np.empty(0, np.int8), np.empty(0), 0.0)
    return tuple(
        _detections_of_frame(rows, t / rate_hz, normalized)
        if len(rows)
        else empty._trusted(stamp_s=t / rate_hz)
        for t, rows in enumerate(frames)
    )


def _detections_of_frame(rows: MotRows, stamp_s: float, normalized: bool) -> ImageDetections:
    """Return the rows of one frame as detections, without classes that are no road users."""
    categories = [CLASSES[c] for c in rows.classes.tolist()]
    is_road_user = np.array([category is not None for category in categories], bool)
    confidences = rows.confidences[is_road_user]
    return ImageDetections(
        boxes=rows.boxes[is_road_user],
        categories=np.array([c for c in categories if c is not None], np.int8),
        scores=confidences if normalized else logistic(confidences),
        stamp_s=stamp_s,
    )


class _SequenceInfo(NamedTuple):
    """The content of `seqinfo.ini`; None for what it does not give.

    length: number of frames.
    """

    length: int | None = None
    rate_hz: float = DEFAULT_RATE_HZ
    image_size: ImageSize | None = None


class _Value(NamedTuple):
    """A value of `seqinfo.ini` and the line that it is in."""

    line: int
    text: str


def _read_sequence_info(path: Path) -> _SequenceInfo:
    """Read `[Sequence]`; every key may be missing, and the whole file too."""
    if not path.is_file():
        return _SequenceInfo()
    values = _section_values(path)
    width = _whole_number(path, values, "imWidth", MAX_SIDE_PX)
    height = _whole_number(path, values, "imHeight", MAX_SIDE_PX)
    return _SequenceInfo(
        length=_whole_number(path, values, "seqLength", MAX_FRAMES),
        rate_hz=_frame_rate(path, values),
        image_size=None if width is None or height is None else ImageSize(width, height),
    )


def _section_values(path: Path) -> Mapping[str, _Value]:
    """Return the values of `[Sequence]`; keys are in lower case."""
    values: dict[str, _Value] = {}
    sections: list[str] = []
    for number, line in enumerate(map(str.strip, read_lines(path)), start=1):
        if not line or line[0] in "#;":
            continue
        if line[0] == "[":
            sections.append(line)
            continue
        if not sections:
            refuse(path, number, SECTION_EXPECTED, line)
        if sections[-1].lower() != SECTION.lower():
            continue
        key, sign, text = line.partition("=")
        if not sign:
            refuse(path, number, "KEY=VALUE", line)
        name = key.strip().lower()
        if name in values:
            refuse(path, number, f"the key {key.strip()} once", line)
        values[name] = _Value(number, text.strip())
    if SECTION.lower() not in map(str.lower, sections):
        actual = ", ".join(sections) or "nothing"
        raise FormatError(f"{path}: expected {SECTION_EXPECTED}, got {actual}")
    return values


def _whole_number(path: Path, values: Mapping[str, _Value], key: str, highest: int) -> int | None:
    value = values.get(key.lower())
    if value is None:
        return None
    text = value.text
    valid = text.isascii() and text.isdigit() and 1 <= float(text) <= highest
    if not valid:
        refuse(path, value.line, f"{key} as a whole number from 1 to {highest}", text)
    return int(text)


def _frame_rate(path: Path, values: Mapping[str, _Value]) -> float:
    value = values.get("framerate")
    if value is None:
        return DEFAULT_RATE_HZ
    try:
        rate_hz = float(value.text)
    except ValueError:
        rate_hz = math.nan
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        expected = f"frameRate as a number from {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}"
        refuse(path, value.line, expected, value.text)
    return rate_hz
