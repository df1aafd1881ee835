"""Wheel speeds in text files: one line each, of stamp and speed."""

from __future__ import annotations

from pathlib import Path

from roadscope.benchmarks.formats.stamped_samples import find_beside, read_samples
from roadscope.core import WheelSamples

NAMES = ("wheels.csv", "wheels.txt")
COLUMNS = ("stamp", "speed")


def find_wheels(folder: Path) -> Path | None:
    """Return the file of wheel speeds in a folder of scans or beside it, if there is one."""
    return find_beside(folder, NAMES)


def read_wheels(path: Path) -> WheelSamples:
    """Read `stamp speed`, m/s along the vehicle, by commas or white space; stamps as an IMU's."""
    stamps_s, values = read_samples(path, COLUMNS)
    return WheelSamples(stamps_s, values[:, 0])
