"""The order of scans, and their stamps: from a file of stamps, or from the names of the scans."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from roadscope.benchmarks.formats.table import FormatError, Table, read_lines, read_table, refuse

TIMES_FILE = "times.txt"
TIMES_FILES = (TIMES_FILE, "timestamps.txt")
"""The stamps of scans, in their folder or beside it; the second as in KITTI's raw drives."""
MIN_SCAN_STEP_S = 0.01
MAX_SCAN_STEP_S = 5.0
"""The time between two scans, by which the unit of their stamps is known. Chosen by hand."""
MAX_JUMP_S = 86400.0
"""Nobody pauses a recording for a day: such a step is a clock that was set. Chosen by hand."""
MAX_FALL_S = 1.0
"""A stamp that is lower than the one before by more than this, and by more than two steps, is of a
clock that was set back; a smaller fall is of a scan that came late. Chosen by hand."""
MAX_FALLING_SHARE = 0.01
"""A file with a larger share of stamps that do not rise is refused. Chosen by hand."""
LEAST_STAMP = 1e8
"""A number in a name from which on it is a stamp and no counter. Chosen by hand: a drive of 10^8
scans takes four months; 10^8 s are a stamp of 1973."""
HOLE_STEPS = 1.75
"""Scans more median steps apart have others missing between them. Chosen by hand."""
STEP_TOLERANCE = 0.25
"""Counters in names differ from whole steps by less than this share of a step, where no hole of
`HOLE_COUNT` steps or more is between them. Chosen by hand: it allows for milliseconds that jitter.
"""
HOLE_COUNT = 4
MAX_NAMED = 3
"""Number of places that a note names; the others are only counted."""
TIME_UNITS_S = (1.0, 1e-3, 1e-6, 1e-9)
TIME_UNITS = "in seconds or milli-, micro- or nanoseconds"
UNIT_NAMES = dict(zip(TIME_UNITS_S, ("s", "ms", "us", "ns"), strict=True))

_NUMBER = re.compile(r"((?:(?<![^_ ])-)?[0-9]+(?:\.[0-9]+)?)")
"""A number in a name; a minus is its sign at the beginning or behind an underscore."""
_DATE = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(\.\d+)?")
_DATE_IN_NAME = re.compile(
    r"(?<![0-9])([0-9]{4})[-_.]?([0-9]{2})[-_.]?([0-9]{2})[-_. T]?([0-9]{2})[-_.:]?([0-9]{2})"
    r"[-_.:]?([0-9]{2})(?:[-_.,]?([0-9]{1,9}))?(?![0-9])"
)
"""Year, month, day, hour, minute, second, and digits of a fraction of it."""
_YEARS = range(1970, 2100)
_DIGITS = re.compile(r"([0-9]+)")


class OrderedScans(NamedTuple):
    """Files of scans in order.

    numbers: (N,) float64, rising, by which their names differ; None if there are no such numbers.
    unit_s: seconds in one of the numbers if they are stamps; None if they count scans.
    notes: what was assumed about their order.
    """

    files: tuple[Path, ...]
    numbers: np.ndarray | None
    unit_s: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> list[str]:
        """The names of the files."""
        return [path.name for path in self.files]

    def steps(self) -> np.ndarray | None:
        """Return (N - 1,) how many usual steps the numbers of neighbours differ by.

        None without numbers, and for counters that are uneven.
        """
        if self.numbers is None or len(self.numbers) < 2:
            return None
        steps = np.diff(self.numbers)
        steps = steps / np.sort(steps)[(len(steps) - 1) // 2]
        # Their mean, as single ones may jitter.
        steps = steps / np.mean(steps[np.abs(steps - 1) < STEP_TOLERANCE])
        off = np.abs(steps - np.maximum(np.rint(steps), 1))
        uneven = (off > STEP_TOLERANCE) & (steps < HOLE_COUNT)
        return None if self.unit_s is None and uneven.any() else steps


class Stamps(NamedTuple):
    """The stamps of scans, seconds, one each, and what was assumed about them.

    measured: whether they are of a clock; otherwise scans are counted.
    """

    stamps_s: tuple[float, ...]
    notes: tuple[str, ...] = ()
    measured: bool = False


def time_unit_s(length: float, *, shortest_s: float, longest_s: float) -> float | None:
    """Return the first of `TIME_UNITS_S` in which a time is within the limits; None if none is.

    length: a time in an unknown unit.
    """
    return next((unit for unit in TIME_UNITS_S if shortest_s <= length * unit <= longest_s), None)


# --------------------------------------------------------------------------------------------------
# Order.


def in_order(files: Sequence[Path], endings: Sequence[str]) -> OrderedScans:
    """Return files in the order of the numbers in their names.

    endings: of the names that are no part of them, such as `.pcd.bin`.
    Names without numbers that tell all of them apart are sorted with their digits as whole numbers:
    9 comes before 10.
    """
    stems = [without_ending(path.name, endings) for path in files]
    by_digits = sorted(range(len(files)), key=lambda k: _natural(stems[k]))
    reading = _reading_of(stems) if len(stems) > 1 else None
    if reading is None:
        ordered = tuple(files[k] for k in by_digits)
        return OrderedScans(ordered, None, notes=_notes_without_numbers(stems))
    order = np.argsort(reading.numbers, kind="stable").tolist()
    place = next((pair for pair in zip(order, by_digits, strict=True) if len(set(pair)) > 1), None)
    notes: tuple[str, ...] = ()
    if place is not None or reading.words:
        notes = (f"the names of scans are read as {reading.words or 'numbers'}",)
    if place is not None:
        notes = (f"{notes[0]}: {stems[place[0]]} comes before {stems[place[1]]}",)
    ordered = tuple(files[k] for k in order)
    return OrderedScans(ordered, reading.numbers[order], reading.unit_s, notes)


def without_ending(name: str, endings: Sequence[str]) -> str:
    """Return a name without the first of the endings that it has."""
    ending = next((each for each in endings if name.lower().endswith(each)), "")
    return name[: len(name) - len(ending)]


class _Reading(NamedTuple):
    """What the names of scans say.

    numbers: (N,) float64.
    unit_s: seconds in one of the numbers if they are stamps; None if they count scans.
    words: how the names are read, if that is not plain.
    """

    numbers: np.ndarray
    unit_s: float | None
    words: str = ""

    @property
    def unevenness(self) -> float:
        """How much steps differ from their median, as a share of it; infinite if some are 0."""
        steps = np.diff(np.sort(self.numbers))
        if not steps.min() > 0:
            return np.inf
        middle = float(np.median(steps))
        # Rounded, so that equally even readings are equal.
        return round(float(np.mean(np.abs(steps - middle))) / middle, 6)


def _reading_of(stems: Sequence[str]) -> _Reading | None:
    """Return the most even reading of names that tells all of them apart; stamps come first.

    None if there is no such reading.
    """
    columns = _columns(stems)
    readings = [_dates(stems), *(_column(each) for each in columns)]
    readings += [_with_fraction(*pair) for pair in pairwise(columns)]
    usable = [each for each in readings if each is not None and np.isfinite(each.unevenness)]
    stamps = [each for each in usable if each.unit_s is not None]
    return min(stamps or usable, key=lambda each: each.unevenness, default=None)


def _columns(stems: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the numbers in names as text, one tuple for each place; none if other text differs."""
    parts = [_NUMBER.split(stem) for stem in stems]
    if len({tuple(each[::2]) for each in parts}) > 1:
        return []
    columns = list(zip(*(each[1::2] for each in parts), strict=True))
    return [c if any(t[0] != "-" for t in c) else tuple(t[1:] for t in c) for c in columns]


def _column(texts: Sequence[str]) -> _Reading:
    """Return the reading of one number in names.

    `1.25` and `1.3` are decimal numbers, or seconds and nanoseconds without zeros in front; that is
    assumed only if it makes the steps between scans more even.
    """
    decimals = _timed(np.array([float(text) for text in texts]), "")
    if all(text.isdecimal() for text in texts):
        return decimals
    parts = [text.partition(".") for text in texts]
    pairs = np.array([float(whole) + 1e-9 * float(rest or 0) for whole, _, rest in parts])
    readings = (decimals, _timed(pairs, "seconds.nanoseconds"))
    best = min(readings, key=lambda each: each.unevenness)
    has_points = any("." in text for text in texts)
    return best._replace(words=best.words or "decimal numbers") if has_points else decimals


def _with_fraction(whole: Sequence[str], fraction: Sequence[str]) -> _Reading | None:
    """Return the reading of seconds and then milli-, micro- or nanoseconds with zeros in front.

    None for other numbers.
    """
    lengths = {len(text) for text in fraction}
    if not all(text.isdecimal() for text in (*whole, *fraction)) or not lengths <= {3, 6, 9}:
        return None
    seconds = np.array([float(text) for text in whole])
    if len(lengths) > 1 or seconds.min() < LEAST_STAMP:
        return None
    fractions = np.array([float(f"0.{text}") for text in fraction])
    return _of_seconds(seconds + fractions, "seconds and fractions")


def _dates(stems: Sequence[str]) -> _Reading | None:
    """Return the reading of names as dates with the time of day; None if they are none."""
    seconds = [_date_s(stem) for stem in stems]
    return None if None in seconds else _of_seconds(np.array(seconds, np.float64), "dates")


def _date_s(stem: str) -> float | None:
    match = _DATE_IN_NAME.search(stem)
    if match is None or int(match[1]) not in _YEARS:
        return None
    try:
        year, month, day, hour, minute, second = (int(part) for part in match.groups()[:6])
        whole = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
    except ValueError:
        return None
    return whole.timestamp() + float(f"0.{match[7] or 0}")


def _of_seconds(seconds: np.ndarray, words: str) -> _Reading | None:
    """Return the reading of (N,) seconds; None if scans are not that far apart."""
    reading = _timed(seconds, words)
    return reading if reading.unit_s == 1.0 else None


def _timed(numbers: np.ndarray, words: str) -> _Reading:
    """Return the reading of (N,) numbers: large ones and those with fractions are stamps."""
    unit_s = None
    if numbers.min() >= LEAST_STAMP or (numbers != np.floor(numbers)).any():
        unit_s = _scan_unit_s(float(np.median(np.diff(np.sort(numbers)))))
    return _Reading(numbers, unit_s, words)


def _scan_unit_s(step: float) -> float | None:
    return time_unit_s(step, shortest_s=MIN_SCAN_STEP_S, longest_s=MAX_SCAN_STEP_S)


def _natural(stem: str) -> list[tuple[int, str]]:
    """Return a sort key that compares numbers in names as numbers: 9 comes before 10."""
    parts = (part for part in _DIGITS.split(stem) if part)
    return [(int(part), part) if part.isdigit() else (-1, part) for part in parts]


def _notes_without_numbers(stems: Sequence[str]) -> tuple[str, ...]:
    """Return why the numbers in names are not used; nothing if there are none."""
    if len(stems) < 2 or not any(_DIGITS.search(stem) for stem in stems):
        return ()
    forms = {_NUMBER.sub("1", stem): stem for stem in stems}
    why = "no number tells all of them apart"
    if len(forms) > 1:
        why = f"they are of {len(forms)} forms, such as {' and '.join([*forms.values()][:2])}"
    return (f"the numbers in the names of scans are not used: {why}",)


# --------------------------------------------------------------------------------------------------
# Stamps.


def stamps_of_files(scans: OrderedScans, rate_hz: float) -> tuple[Stamps, Path | None]:
    """Return the stamps of scans, and the file that they are from if there is one.

    It is in the folder of the scans or beside it; without it, names have stamps or count scans.
    """
    place = scans.files[0].parent
    times = (each / name for each in (place, place.parent) for name in TIMES_FILES)
    times_file = next((path for path in times if path.is_file()), None)
    if times_file is None:
        return stamps_by_names(scans, rate_hz), None
    return read_stamps(times_file, scans), times_file


def read_stamps(path: Path, scans: OrderedScans) -> Stamps:
    """Read the stamps of scans, one a line; the median step decides their unit."""
    table = stamp_table(path)
    rows = rows_of_scans(table, scans)
    stamps = table.numbers(0, 1)[rows, 0]
    steps = np.diff(stamps)
    falling = np.flatnonzero(steps <= 0)
    if len(falling) > max(MAX_FALLING_SHARE * len(stamps), 1):
        _refuse(table, rows, falling, "stamps that rise")
    step = float(np.median(steps)) if len(steps) else 0.0
    unit_s = _scan_unit_s(step)
    if unit_s is None and step > MAX_SCAN_STEP_S:
        raise FormatError(
            f"{path}: expected stamps {MIN_SCAN_STEP_S:g} to {MAX_SCAN_STEP_S:g} s apart, "
            f"{TIME_UNITS}, got steps of {step:g}"
        )
    stamps_s = stamps * (unit_s or 1.0)
    steps_s = np.diff(stamps_s)
    jumps = np.flatnonzero((np.abs(steps_s) > MAX_JUMP_S) | clock_set_back(steps_s))
    if len(jumps):
        _refuse(table, rows, jumps, f"a stamp without a jump of {steps_s[jumps[0]]:.3g} s")
    notes = [*_hole_notes(stamps_s, scans.names, path.name), *_contradictions(path, scans, steps_s)]
    if len(table) > len(rows):
        notes.append(
            f"{path.name}: {len(table)} lines for {len(rows)} scans: the number in the name of a "
            "scan says which line is its own, counted from 0"
        )
    if len(falling):
        line = table.lines[rows[falling[0] + 1]]
        notes.append(f"{path.name}: {not_rising(len(falling))}, the first in line {line}")
    return Stamps(tuple(stamps_s.tolist()), tuple(notes), measured=True)


def rows_of_scans(table: Table, files: OrderedScans) -> np.ndarray:
    """Return (N,) which row of a table with one for each file is of which.

    Where files are missing, as in KITTI's raw drives, the numbers in the names of the others say
    it, from 0.
    """
    count, numbers = len(files.files), files.numbers
    if len(table) == count:
        return np.arange(count)
    expected = f"{table.path}: expected {count} lines, one a scan"
    if numbers is not None and files.unit_s is None and (numbers == np.floor(numbers)).all():
        if numbers[0] >= 0 and count < numbers[-1] + 1 <= len(table):
            return numbers.astype(int)
        expected += f", or one for each number in their names, 0 to {numbers[-1]:.0f}"
    raise FormatError(f"{expected}, got {len(table)}")


def clock_set_back(steps_s: np.ndarray) -> np.ndarray:
    """Return (N,) bool, which steps between stamps are of a clock that was set back."""
    rising = steps_s[steps_s > 0]
    step_s = float(np.median(rising)) if len(rising) else 0.0
    set_back: np.ndarray = steps_s < -max(MAX_FALL_S, 2 * step_s)
    return set_back


def not_rising(count: int) -> str:
    """Return in words that some stamps do not rise."""
    return "1 stamp does not rise" if count == 1 else f"{count} stamps do not rise"


def _refuse(table: Table, rows: np.ndarray, steps: np.ndarray, expected: str) -> NoReturn:
    """Raise a `FormatError` for the row behind the first of some steps."""
    row = int(rows[steps[0] + 1])
    table.refuse(row, expected, table.rows[row][0])


def _contradictions(path: Path, scans: OrderedScans, steps_s: np.ndarray) -> tuple[str, ...]:
    """Return a note on holes in the names of scans that their stamps do not have.

    steps_s: (N - 1,) between the stamps.
    """
    by_names = scans.steps()
    if by_names is None:
        return ()
    even = steps_s <= HOLE_STEPS * np.median(steps_s)
    missing = _missing_notes(np.where(even, by_names, 1), scans.names)
    return tuple(f"{note}, where {path.name} has no hole: its stamps are used" for note in missing)


def stamp_table(path: Path) -> Table:
    """Read one number a line, or one date and time a line (KITTI's raw drives), as seconds."""
    lines = [(k, line.strip()) for k, line in enumerate(read_lines(path), 1) if line.strip()]
    if not lines or not _DATE.fullmatch(lines[0][1]):
        return read_table(path, ("seconds",))
    rows = []
    for number, text in lines:
        if not _DATE.fullmatch(text):
            refuse(path, number, "a date and a time as in the first line", text)
        nanoseconds = int(np.datetime64(text.replace(" ", "T"), "ns").astype(np.int64))
        rows.append([f"{nanoseconds // 10**9}.{nanoseconds % 10**9:09d}"])
    return Table(path, rows, [number for number, _ in lines], ("seconds",))


def stamps_by_names(scans: OrderedScans, rate_hz: float) -> Stamps:
    """Return stamps of scans that have no file of stamps.

    Large numbers in their names and those with fractions are stamps. Others count scans at
    `rate_hz`, also those that are missing; without numbers, or with uneven ones, scans follow one
    another at this rate.
    """
    assumed = f"no {TIMES_FILE}: scans are taken to be {rate_hz:g} a second"
    steps = scans.steps()
    if scans.numbers is None or steps is None:
        uneven = ("the numbers in their names are uneven: not used",)
        in_a_row = tuple(k / rate_hz for k in range(len(scans.files)))
        return Stamps(in_a_row, (assumed, *(uneven if scans.numbers is not None else ())))
    if scans.unit_s is not None:
        stamps_s = scans.numbers * scans.unit_s
        note = f"no {TIMES_FILE}: the numbers in the names are taken for stamps in "
        notes = (note + UNIT_NAMES[scans.unit_s], *_hole_notes(stamps_s, scans.names, "names"))
        return Stamps(tuple(stamps_s.tolist()), notes, measured=True)
    stamps_s = np.concatenate([[0], np.cumsum(steps)]) / rate_hz
    return Stamps(tuple(stamps_s.tolist()), (assumed, *_missing_notes(steps, scans.names)))


def recorded_stamps(stamps_s: np.ndarray, names: Sequence[str]) -> Stamps:
    """Return stamps of a clock in seconds, (N,), with notes on what is odd about them."""
    steps_s = np.diff(stamps_s)
    jumps = np.flatnonzero(np.abs(steps_s) > MAX_JUMP_S)
    if len(jumps):
        raise FormatError(
            f"expected stamps without a jump of {steps_s[jumps[0]]:.3g} s, which is "
            f"{_after(jumps[:1], names)}"
        )
    notes = list(_hole_notes(stamps_s, names, "stamps"))
    same = int((steps_s <= 0).sum())
    if same:
        notes.append(not_rising(same))
    return Stamps(tuple(stamps_s.tolist()), tuple(notes), measured=True)


def _missing_notes(steps: np.ndarray, names: Sequence[str]) -> tuple[str, ...]:
    """Return a note on numbers that are missing in names; steps: (N - 1,) in usual steps."""
    gaps = np.flatnonzero(steps > HOLE_STEPS)
    if not len(gaps):
        return ()
    missing = int((np.rint(steps[gaps]) - 1).sum())
    numbers = "number is" if missing == 1 else "numbers are"
    return (f"{missing} {numbers} missing in the names of scans, {_after(gaps, names)}",)


def _hole_notes(stamps_s: np.ndarray, names: Sequence[str], source: str) -> tuple[str, ...]:
    """Return a note on times without scans; stamps_s: (N,)."""
    steps = np.diff(stamps_s)
    if len(steps) < 2:
        return ()
    holes = np.flatnonzero(steps > HOLE_STEPS * np.median(steps))
    if not len(holes):
        return ()
    longest = float(steps[holes].max())
    return (f"{source}: scans are up to {longest:.3g} s apart, {_after(holes, names)}",)


def _after(rows: np.ndarray, names: Sequence[str]) -> str:
    """Return the places behind some scans in words."""
    named = ", ".join(names[k] for k in rows[:MAX_NAMED].tolist())
    more = len(rows) - MAX_NAMED
    return f"after {named}" + (f" and {more} more" if more > 0 else "")
