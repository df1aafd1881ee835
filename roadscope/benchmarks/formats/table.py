"""Text files with columns. A malformed file raises `FormatError` with file, line and cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

LARGEST_INTEGER = 2**53 - 1
"""float64 cannot hold every larger integer exactly."""
UNDIVIDED = {None: "1 column when split at white space", ",": "1 column when split at commas"}
"""What is reported for a line without a separator; most such files use another one."""
MAX_QUOTED = 80
"""An error quotes at most this many characters of a line. Chosen by hand: one line on a
terminal."""


class FormatError(ValueError):
    """A file is malformed; the message names file, line, what was expected and what was found."""


@dataclass(frozen=True, slots=True)
class Table:
    """The rows of a text file as text, without blank lines and comments.

    rows: the fields of each row.
    lines: the line number of each row, from 1.
    columns: the names of the fields.
    """

    path: Path
    rows: Sequence[Sequence[str]]
    lines: Sequence[int]
    columns: Sequence[str]

    def __len__(self) -> int:
        return len(self.rows)

    def numbers(self, first: int, last: int) -> np.ndarray:
        """Return columns `first` up to but not including `last` as (N, K) finite float64."""
        values = self.numbers_or_nan(first, last)
        wrong = np.argwhere(~np.isfinite(values))
        if len(wrong):
            row, column = wrong[0].tolist()
            field = first + column
            self.refuse(row, f"{self.columns[field]} as a finite number", self.rows[row][field])
        return values

    def numbers_or_nan(self, first: int, last: int) -> np.ndarray:
        """Return the same columns as (N, K) float64, in which `nan` and `inf` are allowed."""
        texts = [row[first:last] for row in self.rows]
        if any("_" in text for row in texts for text in row):
            # Python reads 1_0 as 10, but no file format does.
            self._refuse_first_text(first, last)
        try:
            values = np.array(texts, dtype=np.float64).reshape(len(texts), last - first)
        except ValueError:
            self._refuse_first_text(first, last)
        return values

    def within(self, first: int, last: int, limit: float, unit: str) -> np.ndarray:
        """Return `numbers`; a value below minus `limit` or above `limit` is refused."""
        values = self.numbers(first, last)
        names = " ".join(self.columns[first:last])
        valid = np.asarray(np.all(np.abs(values) <= limit, axis=1))
        self.require(valid, f"{names} from -{limit:g} to {limit:g} {unit}", first, last)
        return values

    def integers(
        self, column: int, lowest: int | None = None, highest: int = LARGEST_INTEGER
    ) -> np.ndarray:
        """Return one column as (N,) int64; values outside of `lowest` to `highest` are refused.

        lowest: None allows every integer down to -`LARGEST_INTEGER`.
        """
        values = self.numbers(column, column + 1)[:, 0]
        expected = f"{self.columns[column]} as an integer"
        if lowest is not None:
            expected += f" from {lowest} to {highest}"
        least = -LARGEST_INTEGER if lowest is None else lowest
        valid = (values == np.rint(values)) & (values >= least) & (values <= highest)
        self.require(valid, expected, column)
        return values.astype(np.int64)

    def require(
        self, valid: np.ndarray, expected: str, first: int, last: int | None = None
    ) -> None:
        """Refuse the first row that is not valid, and quote its columns `first` up to `last`.

        valid: (N,) bool.
        last: not included; None quotes one column.
        """
        wrong = np.flatnonzero(~valid)
        if len(wrong):
            row = int(wrong[0])
            quoted = self.rows[row][first : first + 1 if last is None else last]
            self.refuse(row, expected, " ".join(quoted))

    def refuse(self, row: int, expected: str, actual: object) -> NoReturn:
        """Raise a `FormatError` for one row, counted from 0."""
        refuse(self.path, self.lines[row], expected, actual)

    def _refuse_first_text(self, first: int, last: int) -> NoReturn:
        """Raise a `FormatError` for the first field that is not a number."""
        for row, fields in enumerate(self.rows):
            for name, text in zip(self.columns[first:last], fields[first:last], strict=True):
                if not _is_number(text):
                    self.refuse(row, f"{name} as a number", text)
        raise AssertionError("all fields are numbers")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def refuse(path: Path, line: int, expected: str, actual: object) -> NoReturn:
    """Raise a `FormatError` for one line of a file, counted from 1."""
    quoted = str(actual)[:MAX_QUOTED]
    raise FormatError(f"{path}, line {line}: expected {expected}, got {quoted!r}")


def visible(folder: Path, pattern: str = "*") -> list[Path]:
    """Return what matches in a folder, in order, but for hidden files such as macOS's `._*`."""
    return sorted(path for path in folder.glob(pattern) if not path.name.startswith("."))


def names_in(folder: Path) -> str:
    """Return the first names in a folder, to say what was found there; `nothing` if it is empty."""
    return ", ".join(path.name for path in visible(folder)[:8]) or "nothing"


def read_content(path: Path) -> bytes:
    """Return the bytes of a file; `FormatError` says why it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from error


def read_lines(path: Path) -> list[str]:
    """Return the lines of a UTF-8 text file; line ends of every system are accepted."""
    content = read_content(path)
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
    required: int | None = None,
    comment: str | None = None,
    header: bool = False,
) -> Table:
    """Read a text file with the named columns; an empty file is a table without rows.

    separator: None splits at white space.
    required: number of columns that must be there if the last ones are optional. All rows of a
        file have the same number of columns.
    comment: lines that begin with this are skipped.
    header: the first line may hold names; it is skipped if its first field is not a number.
    """
    rows, lines = [], []
    for number, line in enumerate(read_lines(path), start=1):
        text = line.strip()
        if not text or (comment is not None and text.startswith(comment)):
            continue
        fields = [field.strip() for field in text.split(separator)]
        is_header, header = header and not _is_number(fields[0]), False
        if not is_header:
            rows.append(fields)
            lines.append(number)
    table = Table(path, rows, lines, columns)
    _check_widths(table, separator, len(columns) if required is None else required)
    return table


def _check_widths(table: Table, separator: str | None, required: int) -> None:
    """Refuse a row with too few or too many columns, or with other ones than the first row has."""
    most = len(table.columns)
    first = len(table.rows[0]) if table.rows else most
    if required <= first <= most:
        expected = f"{first} columns as in the first line"
        wrong = [row for row, fields in enumerate(table.rows) if len(fields) != first]
    else:
        expected = f"{required} to {most} columns" if required < most else f"{most} columns"
        wrong = [0]
    if wrong:
        actual = width_text(len(table.rows[wrong[0]]), separator)
        table.refuse(wrong[0], f"{expected} ({' '.join(table.columns)})", actual)


def width_text(width: int, separator: str | None) -> str:
    """Return the number of columns of a line in words; a single one hints at the separator."""
    return f"{width} columns" if width > 1 else UNDIVIDED.get(separator, "1 column")
