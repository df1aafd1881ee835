"""Echoes of drops in the air: faint returns close by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import LidarScan

DROPS_M = 15.0
"""Echoes of drops fall with the square of the range: farther off, none is above the noise."""
SCAN_ARRAYS = ("points", "intensity", "ring", "column", "time_offset_s")


def check_faint(faint: float) -> float:
    """Return the least intensity, or refuse it."""
    if not 0 <= faint < 1:
        raise ValueError(f"faint must be at least 0 and below 1, got {faint!r}")
    return faint


def without_faint(scan: LidarScan, intensity: float) -> LidarScan:
    """Leave out the returns within 15 m that are fainter than this.

    A scan in which nothing has an intensity says nothing about drops and stays whole.
    """
    faint = np.flatnonzero(scan.intensity < intensity)
    x, y, _ = scan.points[faint].T
    drops = faint[x**2 + y**2 < DROPS_M**2]
    if not len(drops) or not scan.intensity.any():
        return scan
    rows = np.delete(np.arange(len(scan)), drops)
    return replace(scan, **{name: getattr(scan, name).take(rows, 0) for name in SCAN_ARRAYS})
