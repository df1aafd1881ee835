"""Text files of samples beside scans: a line each, its stamp first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.table import FormatError, read_lines, read_table

LONGEST_S, SHORTEST_NS = 1.0, 2e5
"""Between these, the usual step of stamps is neither seconds nor nanoseconds: samples of 5 kHz at
most; of wheels in microseconds a step is 20,000."""


def find_beside(folder: Path, names: Sequence[str]) -> Path | None:
    """Return the first file of these names in a folder of scans or beside it, if there is one."""
    places = (root / name for root in (folder, folder.parent) for name in names)
    return next((path for path in places if path.is_file()), None)


def read_samples(path: Path, columns: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return (K,) stamps, s, and (K, C - 1) values of C columns, by commas or white space.

    Stamps are seconds or whole nanoseconds, on the clock of the scans; a line of names at the top,
    or lines that begin with `#`, are passed over.
    """
    lines = read_lines(path)
    separator = "," if any("," in line for line in lines[:2]) else None
    head = next((line for line in lines if line.strip()), "")
    comment = head.strip()[:1] if head.strip()[:1].isalpha() else "#"
    table = read_table(path, columns, separator=separator, comment=comment)
    values = table.numbers(0, len(columns))
    if len(values) < 2:
        raise FormatError(f"{path}: expected lines of {' '.join(columns)}, got {len(values)}")
    step = float(np.median(np.diff(values[:, 0])))
    if not (0 < step <= LONGEST_S or step >= SHORTEST_NS):
        raise FormatError(f"{path}: expected stamps in seconds or nanoseconds, got steps of "
                          f"{step:g}")  # fmt: skip
    return values[:, 0] * (1e-9 if step >= SHORTEST_NS else 1.0), values[:, 1:]
