"""Whether files of detections hold the class that their folder is for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from roadscope.benchmarks.formats.kitti_folder import KittiFolder
from roadscope.benchmarks.formats.kitti_objects import CLASS_IDS, TYPE_NAMES, TYPE_OF
from roadscope.benchmarks.formats.table import FormatError
from roadscope.core import Category

CLASS_COLUMN = 1


def other_rows(files: KittiFolder, category: Category, detector: str) -> tuple[int, int]:
    """Return how many rows of a class's files, of all sequences, are of another, and of all rows.

    Where there are rows and none is of the class, `FormatError` says how classes are numbered:
    one file alone may lack it, where files hold all classes.
    """
    paths = [
        files.detections(sequence, category, detector)
        for sequence in files.sequences()
        if files.has_detections(sequence, category, detector)
    ]
    numbers = _numbers(paths)
    wanted = next(k for k, kind in CLASS_IDS.items() if kind == TYPE_OF[category])
    right = numbers.count(wanted)
    if numbers and not right:
        _refuse(paths[0].parent, wanted, numbers)
    return len(numbers) - right, len(numbers)


def said_of_others(files: KittiFolder, category: Category, detector: str) -> str:
    """Say how many rows are left out for being of another class; empty where none is."""
    left_out, total = other_rows(files, category, detector)
    if not left_out:
        return ""
    kind = TYPE_NAMES[TYPE_OF[category]]
    return (
        f"{left_out} of {total} rows in det_{detector}/{kind} are left out: their class is not "
        f"{kind.lower()} ({numbering()})."
    )


def numbering() -> str:
    """Return how files number classes, in words."""
    return ", ".join(f"{k} {TYPE_NAMES[kind].lower()}" for k, kind in CLASS_IDS.items())


def _refuse(folder: Path, wanted: int, numbers: Sequence[int]) -> None:
    """Name the folder, the class expected in it and those that were met."""
    met = ", ".join(map(str, sorted(set(numbers))))
    raise FormatError(
        f"{folder}: expected rows of class {wanted} in the second column ({numbering()}), got "
        f"{len(numbers)} rows, all of class {met}"
    )


def _numbers(paths: Sequence[Path]) -> list[int]:
    """Return the classes of all rows; who reads a file is told of its malformed lines."""
    numbers = []
    for path in paths:
        for line in path.read_bytes().splitlines():
            try:
                numbers.append(int(float(line.split(b",")[CLASS_COLUMN])))
            except (ValueError, IndexError, OverflowError):
                continue
    return numbers
