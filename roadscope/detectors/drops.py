"""Removal of the echoes of drops in the air: faint returns close to the sensor."""

from __future__ import annotations

import numpy as np

from roadscope.core import LidarScan

DROPS_M = 15.0
"""Echoes of drops get weaker with the square of the range: farther away none is above the noise."""


def check_faint(faint: float) -> float:
    """Return the least intensity; raise `ValueError` if it is impossible."""
    if not 0 <= faint < 1:
        raise ValueError(f"faint must be at least 0 and below 1, got {faint!r}")
    return faint


def without_faint(scan: LidarScan, intensity: float) -> LidarScan:
    """Return the scan without the returns within 15 m whose intensity is less than this.

    An intensity of 0 says nothing about drops and stays: sensors that round report it for black
    cars and dark asphalt, and scans without intensities have no other.
    """
    faint = np.flatnonzero((scan.intensity > 0) & (scan.intensity < intensity))
    x, y, _ = scan.points[faint].T
    drops = faint[x**2 + y**2 < DROPS_M**2]
    if not len(drops):
        return scan
    return scan.select(np.delete(np.arange(len(scan)), drops))
