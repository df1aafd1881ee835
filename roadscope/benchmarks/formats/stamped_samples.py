"""Text files of samples beside scans: a line each, its stamp first."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.table import FormatError, Table, read_lines, read_table

LONGEST_S, SHORTEST_NS = 1.0, 2e5
"""Between these, the usual step of stamps is neither seconds nor nanoseconds: samples of 5 kHz at
most; of wheels in microseconds a step is 20,000."""
FEW = 0.01
"""Share of the stamps that may be out of order."""


def find_beside(folder: Path, names: Sequence[str]) -> Path | None:
    """Return the first file of these names in a folder of scans or beside it, if there is one."""
    places = (root / name for root in (folder, folder.parent) for name in names)
    return next((path for path in places if path.is_file()), None)


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples in order of time.

    stamps_s: (K,) rising. values: (K, C - 1). left_out: lines that say nothing, for one of their
    fields is `nan` or `inf` or their stamp is out of order.
    """

    stamps_s: np.ndarray
    values: np.ndarray
    left_out: int


def read_samples(path: Path, columns: Sequence[str]) -> Samples:
    """Read lines of C columns, the first a stamp, by commas or white space.

    Stamps are seconds or whole nanoseconds, on the clock of the scans; a line of names at the top,
    or lines that begin with `#`, are passed over. A few stamps may be out of order, as of samples
    that came late; a file of which more are, as when a clock was set back, is refused.
    """
    table, values = _numbers(path, columns)
    sound = np.flatnonzero(np.isfinite(values).all(axis=1))
    rising = rising_rows(values[sound, 0])
    if len(sound) - len(rising) > max(FEW * len(sound), 1):
        at = int(sound[np.flatnonzero(np.diff(values[sound, 0]) <= 0)[0] + 1])
        table.refuse(at, "stamps that rise", table.rows[at][0])
    kept = values[sound][rising]
    if len(kept) < 2:
        raise FormatError(f"{path}: expected lines of {' '.join(columns)}, got {len(kept)}")
    step = float(np.median(np.diff(kept[:, 0])))
    if not (0 < step <= LONGEST_S or step >= SHORTEST_NS):
        raise FormatError(f"{path}: expected stamps in seconds or nanoseconds, got steps of "
                          f"{step:g}")  # fmt: skip
    stamps_s = kept[:, 0] * (1e-9 if step >= SHORTEST_NS else 1.0)
    return Samples(stamps_s, kept[:, 1:], len(values) - len(kept))


def _numbers(path: Path, columns: Sequence[str]) -> tuple[Table, np.ndarray]:
    """Return the lines of numbers, and these, `nan` and `inf` among them."""
    telling = (line for line in read_lines(path) if line.strip() and not line.startswith("#"))
    separator = "," if any("," in line for line in islice(telling, 2)) else None
    table = read_table(path, columns, separator=separator, comment="#", names=True)
    return table, table.numbers_or_nan(0, len(columns))


def rising_rows(stamps: np.ndarray) -> np.ndarray:
    """Return the numbers of the most rows, of (K,) stamps, that rise strictly, in order.

    Schensted 1961: for each length, the least stamp at which a rising chain so long may end.
    """
    if (np.diff(stamps) > 0).all():
        return np.arange(len(stamps))
    ends: list[float] = []
    last: list[int] = []
    before = np.full(len(stamps), -1)
    for row, stamp in enumerate(stamps.tolist()):
        length = bisect_left(ends, stamp)
        before[row] = last[length - 1] if length else -1
        ends[length : length + 1], last[length : length + 1] = [stamp], [row]
    rows = [last[-1]]
    while before[rows[-1]] >= 0:
        rows.append(int(before[rows[-1]]))
    return np.array(rows[::-1])
