"""What tracking files of KITTI and MOTChallenge share: rows with a frame number and an id."""

# Annotations are evaluated here, because signatures of named tuples show them as they are.
from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np

from roadscope.benchmarks.formats.table import Table

MAX_FRAMES = 500_000
"""No sequence is longer: KITTI's longest has 1 176 frames, MOT20's 3 315, and the 85 minutes of
DukeMTMC at 60 Hz have about 306 000."""


class ImageSize(NamedTuple):
    """Width and height of an image in pixels."""

    width: int
    height: int


class FrameLimit(NamedTuple):
    """The last frame that a file may have.

    frame: its number.
    source: where it comes from, for errors: "the seqLength of seqinfo.ini".
    """

    frame: int
    source: str


class NumberedRows(Protocol):
    """Rows that know their frame."""

    @property
    def frames(self) -> np.ndarray:
        """(N,) int64, frame number of each row."""
        ...

    def select(self, index: np.ndarray) -> Self:
        """Return the rows of a mask or an index array."""
        ...


R = TypeVar("R", bound=NumberedRows)


def rows_by_frame(rows: R, first_frame: int, count: int) -> list[R]:
    """Return the rows of each of `count` frames from `first_frame` on, in the order of the file.

    Frames without rows share one empty record: a long sequence with few rows needs little memory.
    """
    order = np.argsort(rows.frames, kind="stable")
    frames, starts = np.unique(rows.frames[order], return_index=True)
    of_frame = [rows.select(order[:0])] * count
    for frame, index in zip(frames.tolist(), np.split(order, starts)[1:], strict=True):
        if frame < first_frame + count:
            of_frame[frame - first_frame] = rows.select(index)
    return of_frame


def require_ordered_frames(table: Table, frames: np.ndarray) -> None:
    """Refuse a frame number below the one before: the file is damaged, or two files are joined.

    table: its first column holds the frames.
    frames: (N,) int64.
    """
    valid = np.diff(frames, prepend=0) >= 0
    table.require(valid, "a frame not below the frame of the line before", 0)


def require_unique_ids(table: Table, frames: np.ndarray, ids: np.ndarray) -> None:
    """Refuse two rows with the same id in one frame; negative ids stand for no id.

    frames, ids: (N,) int64.
    """
    known: set[tuple[int, int]] = set()
    for row, (frame, number) in enumerate(zip(frames.tolist(), ids.tolist(), strict=True)):
        if number >= 0 and (frame, number) in known:
            table.refuse(row, f"each id once in frame {frame}", f"id {number} a second time")
        known.add((frame, number))


def logistic(scores: np.ndarray) -> np.ndarray:
    """Map scores of any range to 0 to 1 by the logistic function, which keeps their order."""
    falling = np.exp(-np.abs(scores))
    mapped: np.ndarray = np.where(scores >= 0, 1.0, falling) / (1 + falling)
    return mapped
