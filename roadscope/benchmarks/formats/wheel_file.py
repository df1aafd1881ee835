"""Wheel speeds in text files: one line each, of stamp and speed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.stamped_samples import find_beside, read_samples
from roadscope.benchmarks.formats.table import FormatError
from roadscope.core import WheelSamples

NAMES = ("wheels.csv", "wheels.txt")
COLUMNS = ("stamp", "speed")
FASTEST_M_S = 90.0
"""What drives on a road is not faster in one sample of a hundred."""


def find_wheels(folder: Path) -> Path | None:
    """Return the file of wheel speeds in a folder of scans or beside it, if there is one."""
    return find_beside(folder, NAMES)


def read_wheels(path: Path | str) -> tuple[WheelSamples, int]:
    """Read `stamp speed`, m/s along the vehicle, as `read_samples` does.

    Return with them how many lines were left out.
    """
    path = Path(path)
    found = read_samples(path, COLUMNS)
    speeds = found.values[:, 0]
    fastest = float(np.quantile(np.abs(speeds), 0.99))
    if fastest > FASTEST_M_S:
        raise FormatError(f"{path}: expected speeds in m/s, got up to {fastest:.1f}: in km/h?")
    return WheelSamples(found.stamps_s, speeds), found.left_out
