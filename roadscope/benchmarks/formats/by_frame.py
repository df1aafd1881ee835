"""Rows of a file, frame by frame."""

from __future__ import annotations

from typing import Protocol, Self, TypeVar

import numpy as np


class Rows(Protocol):
    """What has a frame for each of its rows."""

    @property
    def frames(self) -> np.ndarray:
        """(N,) int64."""
        ...

    def select(self, index: np.ndarray) -> Self:
        """Keep the rows that an index array names."""
        ...


R = TypeVar("R", bound=Rows)


def rows_by_frame(rows: R, first: int, count: int) -> list[R]:
    """Return the rows of `count` frames from `first`, in file order; all empty ones are the same.

    A sequence may be long and have few rows, so what frames cost is for those that have any.
    """
    order = np.argsort(rows.frames, kind="stable")
    held, starts = np.unique(rows.frames[order], return_index=True)
    found = [rows.select(order[:0])] * count
    for frame, index in zip(held.tolist(), np.split(order, starts)[1:], strict=True):
        if frame < first + count:
            found[frame - first] = rows.select(index)
    return found
