"""What PCD and PLY files share: points in rows after a header that says what is in them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.table import FormatError, refuse


@dataclass(frozen=True, slots=True)
class CloudHeader:
    """What a file says about its points.

    layout: the fields of one point. count: how many points there are.
    encoding: how they are written, a word of the format.
    offset: the byte at which they begin. lines: how many lines the header has.
    """

    layout: np.dtype
    count: int
    encoding: str
    offset: int
    lines: int


def binary_rows(path: Path, header: CloudHeader, body: bytes) -> np.ndarray:
    """Return the points, (count,) of the layout, from their bytes."""
    size = header.count * header.layout.itemsize
    if len(body) < size:
        raise FormatError(
            f"{path}: expected {size} bytes after the header, {header.count} points of "
            f"{header.layout.itemsize}, got {len(body)}"
        )
    return np.frombuffer(body, header.layout, header.count)


def ascii_rows(path: Path, header: CloudHeader, lines: Iterable[tuple[int, bytes]]) -> np.ndarray:
    """Return the points, (count,) of the layout, from `count` lines with their numbers."""
    names = header.layout.names or ()
    widths = [int(np.prod(header.layout[name].shape)) for name in names]
    values = np.empty((header.count, sum(widths)))
    for row, (number, line) in enumerate(lines):
        try:
            numbers = [float(word) for word in line.split()]
            if len(numbers) != sum(widths):
                raise ValueError
            values[row] = numbers
        except ValueError:
            refuse(path, number, f"{sum(widths)} numbers", line.decode("ascii", "replace"))
    rows = np.empty(header.count, header.layout)
    columns = np.split(values, np.cumsum(widths)[:-1], axis=1)
    for name, column in zip(names, columns, strict=True):
        rows[name] = column.reshape(rows[name].shape)
    return rows
