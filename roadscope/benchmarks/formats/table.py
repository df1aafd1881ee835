"""Text files of columns, refused with file, line and what was expected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

LARGEST = 2**53 - 1
"""Whole numbers beyond are not told apart in float64."""
MAX_FRAMES = 500_000
"""More than any sequence has: KITTI's longest has 1 176, MOT20's 3 315, DukeMTMC's 85 minutes at
60 Hz some 306 000."""

ALONE = {None: "1 column between white space", ",": "1 column between commas"}
"""What is said of a line that nothing divides: mostly it has another separator."""


class FormatError(ValueError):
    """A file is not what it should be; the message names file, line and what was expected."""


@dataclass(frozen=True, slots=True)
class Table:
    """The rows of a file, still text; blank lines are left out.

    rows: the fields of each line.
    lines: number of the line that each row stands in, from 1.
    columns: what the fields are called.
    """

    path: Path
    rows: Sequence[Sequence[str]]
    lines: Sequence[int]
    columns: Sequence[str]

    def __len__(self) -> int:
        return len(self.rows)

    def numbers(self, first: int, last: int) -> np.ndarray:
        """Return fields `first` up to but not including `last` as (N, K) finite float64."""
        values = self.numbers_or_nan(first, last)
        wrong = np.argwhere(~np.isfinite(values))
        if len(wrong):
            row, column = wrong[0].tolist()
            given = self.rows[row][first + column]
            self.refuse(row, f"a finite {self.columns[first + column]}", given)
        return values

    def numbers_or_nan(self, first: int, last: int) -> np.ndarray:
        """Return the same where `nan` and `inf` are numbers too."""
        texts = [row[first:last] for row in self.rows]
        if any("_" in text for row in texts for text in row):
            # Python's own way to write thousands: 1_0 is no 10 in a file.
            self._refuse_texts(first, last)
        try:
            values = np.array(texts, dtype=np.float64).reshape(len(texts), last - first)
        except ValueError:
            self._refuse_texts(first, last)
        return values

    def within(self, first: int, last: int, limit: float, unit: str) -> np.ndarray:
        """Return `numbers`, none beyond plus or minus a limit."""
        values = self.numbers(first, last)
        names = " ".join(self.columns[first:last])
        proper = np.asarray(np.all(np.abs(values) <= limit, axis=1))
        self.require(proper, f"{names} from -{limit:g} to {limit:g} {unit}", first, last)
        return values

    def integers(self, column: int, least: int | None = None, most: int = LARGEST) -> np.ndarray:
        """Return one field as (N,) int64, none below `least`, none above `most`."""
        values = self.numbers(column, column + 1)[:, 0]
        name = f"an integer {self.columns[column]}"
        low, bound = (-LARGEST, "") if least is None else (least, f" of {least} or more")
        self.require((values == np.rint(values)) & (values >= low), name + bound, column)
        self.require(values <= most, f"{name} of at most {most}", column)
        return values.astype(np.int64)

    def require(self, proper: np.ndarray, expected: str, column: int, until: int = 0) -> None:
        """Refuse the first row that is not proper, showing its fields from `column` on."""
        wrong = np.flatnonzero(~proper)
        if len(wrong):
            row = int(wrong[0])
            self.refuse(row, expected, " ".join(self.rows[row][column : until or column + 1]))

    def refuse(self, row: int, expected: str, given: object) -> NoReturn:
        """Say what is wrong with a row."""
        refuse(self.path, self.lines[row], expected, given)

    def _refuse_texts(self, first: int, last: int) -> NoReturn:
        """Find the field that is not a number."""
        for row, fields in enumerate(self.rows):
            for name, text in zip(self.columns[first:last], fields[first:last], strict=True):
                if not _is_number(text):
                    self.refuse(row, f"a number as {name}", text)
        raise AssertionError("all fields are numbers")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def refuse(path: Path, line: int, expected: str, given: object) -> NoReturn:
    """Raise a `FormatError` for one line of a file."""
    raise FormatError(f"{path}, line {line}: expected {expected}, got {str(given)[:80]!r}")


def read_lines(path: Path) -> list[str]:
    """Return the lines of a text file, whatever ends them."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise FormatError(f"{path}, line {line}: expected text, got binary data") from error
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise FormatError(f"{path}, line {line}: expected text, got binary data")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def read_table(
    path: Path,
    columns: Sequence[str],
    *,
    separator: str | None = None,
    least: int | None = None,
    comment: str | tuple[str, ...] = (),
    names: bool = False,
) -> Table:
    """Read lines of the named columns; an empty file is a table without rows.

    separator: None for white space. comment: what lines that are passed over begin with,
        one of these. names: the first line is too if it begins with no number.
    least: columns that must be there when the last ones may be missing, the same in all lines.
    """
    rows, lines = [], []
    for number, line in enumerate(read_lines(path), start=1):
        if not line.strip() or line.lstrip().startswith(comment):
            continue
        fields = [field.strip() for field in line.strip().split(separator)]
        if names and not _is_number(fields[0]):
            names = False
            continue
        names = False
        rows.append(fields)
        lines.append(number)
    allowed = range(len(columns) if least is None else least, len(columns) + 1)
    width = len(rows[0]) if rows and len(rows[0]) in allowed else None
    for row, number in zip(rows, lines, strict=True):
        if width is None or len(row) != width:
            given = f"{len(row)} columns" if len(row) > 1 else ALONE.get(separator, "1 column")
            _refuse_width(path, number, columns, (allowed, width), given)
    return Table(path, rows, lines, columns)


def _refuse_width(
    path: Path, line: int, columns: Sequence[str], wide: tuple[range, int | None], given: str
) -> NoReturn:
    """Say how many columns there must be, and which.

    wide: how many are allowed, and how many the first line has if that is one of these.
    """
    allowed, width = wide
    counts = f"{allowed[0]} to {allowed[-1]}" if len(allowed) > 1 else str(allowed[0])
    wanted = f"{width} columns as in the first line" if width else f"{counts} columns"
    refuse(path, line, f"{wanted} ({' '.join(columns)})", given)


def refuse_backward(table: Table, frames: np.ndarray) -> None:
    """Refuse a frame below the one before: two files in one, or a damaged one."""
    proper = np.diff(frames, prepend=0) >= 0
    table.require(proper, "frames that do not decrease", 0)


def refuse_twins(table: Table, frames: np.ndarray, ids: np.ndarray) -> None:
    """Refuse two rows of one id in one frame; negative ids are none."""
    seen: set[tuple[int, int]] = set()
    for row, key in enumerate(zip(frames.tolist(), ids.tolist(), strict=True)):
        if key[1] >= 0 and key in seen:
            table.refuse(row, f"each id once in frame {key[0]}", f"id {key[1]} again")
        seen.add(key)
