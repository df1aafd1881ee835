"""The order of scans, and their stamps: from a file of stamps, or from the names of the scans."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

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
MAX_FALLING_SHARE = 0.01
"""A file with a larger share of stamps that do not rise is refused. Chosen by hand."""
LEAST_STAMP = 1e8
"""A number in a name from which on it is a stamp and no counter. Chosen by hand: a drive of 10^8
scans takes four months; 10^8 s are a stamp of 1973."""
HOLE_STEPS = 1.75
"""Scans more median steps apart have others missing between them. Chosen by hand."""
MAX_NAMED = 3
"""Number of places that a note names; the others are only counted."""
TIME_UNITS_S = (1.0, 1e-3, 1e-6, 1e-9)
TIME_UNITS = "in seconds or milli-, micro- or nanoseconds"
UNIT_NAMES = dict(zip(TIME_UNITS_S, ("s", "ms", "us", "ns"), strict=True))

_NUMBER = re.compile(r"[0-9]+(?:\.[0-9]+)?")
_DATE = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(\.\d+)?")
_DIGITS = re.compile(r"([0-9]+)")


class OrderedScans(NamedTuple):
    """Files of scans in order.

    numbers: (N,) float64, the number that differs in their names; None if there is no such one.
    notes: what was assumed about their order.
    """

    files: tuple[Path, ...]
    numbers: np.ndarray | None
    notes: tuple[str, ...] = ()


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
    Names that are decimal numbers are compared as such. In other names, digits are compared as
    whole numbers: 9 comes before 10.
    """
    stems = [without_ending(path.name, endings) for path in files]
    if all(_NUMBER.fullmatch(stem) for stem in stems):
        return _by_decimals(files, stems)
    order = sorted(range(len(files)), key=lambda k: _natural(stems[k]))
    numbers = _number_that_differs([stems[k] for k in order])
    return OrderedScans(tuple(files[k] for k in order), numbers)


def without_ending(name: str, endings: Sequence[str]) -> str:
    """Return a name without the first of the endings that it has."""
    ending = next((each for each in endings if name.lower().endswith(each)), "")
    return name[: len(name) - len(ending)]


def _by_decimals(files: Sequence[Path], stems: Sequence[str]) -> OrderedScans:
    """Order names that are decimal numbers.

    `1.25` and `1.3` may also be seconds and nanoseconds, without zeros in front; that is assumed
    only if it makes the steps between scans more even.
    """
    decimals = np.array([float(stem) for stem in stems])
    parts = [stem.partition(".") for stem in stems]
    pairs = np.array([float(whole) + 1e-9 * float(rest or 0) for whole, _, rest in parts])
    order, other = np.argsort(decimals, kind="stable"), np.argsort(pairs, kind="stable")
    notes: tuple[str, ...] = ()
    numbers = decimals
    if (order != other).any():
        k = int(np.flatnonzero(order != other)[0])
        first, second = stems[order[k]], stems[other[k]]
        as_pairs = _unevenness(pairs[other]) < _unevenness(decimals[order])
        if as_pairs:
            order, numbers, first, second = other, pairs, second, first
        kind = "seconds.nanoseconds" if as_pairs else "decimal numbers"
        notes = (f"the names of scans are read as {kind}: {first} comes before {second}",)
    return OrderedScans(tuple(files[k] for k in order), numbers[order], notes)


def _unevenness(numbers: np.ndarray) -> float:
    """Return how much steps differ from their median, as a share of it."""
    steps = np.diff(numbers)
    middle = float(np.median(steps))
    return float(np.mean(np.abs(steps - middle))) / middle if middle > 0 else np.inf


def _natural(stem: str) -> list[tuple[int, str]]:
    """Return a sort key that compares numbers in names as numbers: 9 comes before 10."""
    parts = (part for part in _DIGITS.split(stem) if part)
    return [(int(part), part) if part.isdigit() else (-1, part) for part in parts]


def _number_that_differs(stems: Sequence[str]) -> np.ndarray | None:
    """Return (N,) the only number in which names differ; None if they differ in more."""
    parts = [_DIGITS.split(stem) for stem in stems]
    if len({len(each) for each in parts}) > 1:
        return None
    differing = [k for k, column in enumerate(zip(*parts, strict=True)) if len(set(column)) > 1]
    if len(differing) != 1 or differing[0] % 2 == 0:
        return None
    return np.array([float(each[differing[0]]) for each in parts])


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
    return read_stamps(times_file, [path.name for path in scans.files]), times_file


def read_stamps(path: Path, names: Sequence[str]) -> Stamps:
    """Read the stamps of scans, one a line; the median step decides their unit.

    names: of the scans, for what is said of holes.
    """
    table = stamp_table(path)
    if len(table) != len(names):
        raise FormatError(f"{path}: expected {len(names)} lines, one a scan, got {len(table)}")
    stamps = table.numbers(0, 1)[:, 0]
    steps = np.diff(stamps)
    falling = np.flatnonzero(steps <= 0)
    if len(falling) > max(MAX_FALLING_SHARE * len(stamps), 1):
        row = int(falling[0]) + 1
        table.refuse(row, "stamps that rise", table.rows[row][0])
    step = float(np.median(steps)) if len(steps) else 0.0
    unit_s = time_unit_s(step, shortest_s=MIN_SCAN_STEP_S, longest_s=MAX_SCAN_STEP_S)
    if unit_s is None and step > MAX_SCAN_STEP_S:
        raise FormatError(
            f"{path}: expected stamps {MIN_SCAN_STEP_S:g} to {MAX_SCAN_STEP_S:g} s apart, "
            f"{TIME_UNITS}, got steps of {step:g}"
        )
    stamps_s = stamps * (unit_s or 1.0)
    jumps = np.flatnonzero(np.abs(np.diff(stamps_s)) > MAX_JUMP_S)
    if len(jumps):
        row = int(jumps[0]) + 1
        jump_s = float(stamps_s[row] - stamps_s[row - 1])
        table.refuse(row, f"a stamp without a jump of {jump_s:.3g} s", table.rows[row][0])
    notes = list(_hole_notes(stamps_s, names, path.name))
    if len(falling):
        notes.append(
            f"{path.name}: {len(falling)} stamps do not rise, the first in line "
            f"{table.lines[int(falling[0]) + 1]}"
        )
    return Stamps(tuple(stamps_s.tolist()), tuple(notes), measured=True)


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

    Large numbers in their names are stamps. Smaller ones count scans at `rate_hz`, also those that
    are missing; without numbers, or with uneven ones, scans follow one another at this rate.
    """
    count, names = len(scans.files), [path.name for path in scans.files]
    assumed = f"no {TIMES_FILE}: scans are taken to be {rate_hz:g} a second"
    in_a_row = tuple(k / rate_hz for k in range(count))
    if scans.numbers is None or count < 2:
        return Stamps(in_a_row, (assumed,))
    steps = np.diff(scans.numbers)
    if scans.numbers.min() >= LEAST_STAMP:
        step = float(np.median(steps))
        unit_s = time_unit_s(step, shortest_s=MIN_SCAN_STEP_S, longest_s=MAX_SCAN_STEP_S)
        if unit_s is not None and (steps > 0).all():
            stamps_s = scans.numbers * unit_s
            note = f"no {TIMES_FILE}: the numbers in the names are taken for stamps in "
            holes = _hole_notes(stamps_s, names, "names")
            notes = (note + UNIT_NAMES[unit_s], *holes)
            return Stamps(tuple(stamps_s.tolist()), notes, measured=True)
    values, counts = np.unique(steps, return_counts=True)
    usual = float(values[np.argmax(counts)])
    if usual <= 0 or (steps % usual).any():
        return Stamps(in_a_row, (assumed, "the numbers in their names are uneven: not used"))
    places = (scans.numbers - scans.numbers[0]) / usual
    return Stamps(
        tuple((places / rate_hz).tolist()), (assumed, *_missing_notes(np.diff(places), names))
    )


def recorded_stamps(stamps_s: np.ndarray, names: Sequence[str]) -> Stamps:
    """Return stamps of a clock in seconds, (N,), with notes on what is odd about them."""
    notes = list(_hole_notes(stamps_s, names, "stamps"))
    same = int((np.diff(stamps_s) <= 0).sum())
    if same:
        notes.append(f"{same} stamps do not rise")
    return Stamps(tuple(stamps_s.tolist()), tuple(notes), measured=True)


def _missing_notes(steps: np.ndarray, names: Sequence[str]) -> tuple[str, ...]:
    """Return a note on numbers that are missing in names; steps: (N - 1,) in usual steps."""
    gaps = np.flatnonzero(steps > 1)
    if not len(gaps):
        return ()
    missing = int((steps[gaps] - 1).sum())
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
    return f"after {named}" + (f" and {more} others" if more > 0 else "")
