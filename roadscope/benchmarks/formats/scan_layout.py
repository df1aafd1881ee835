"""Beam and azimuth step of points, whether or not their file tells beams."""

from __future__ import annotations

import numpy as np

from roadscope.core.scan import MOST_RINGS

STEP = np.deg2rad(0.2)
"""Azimuth steps of a common turn rate."""
BEAM = np.deg2rad(0.4)
"""Elevations this near are one beam: HDL-64E's lie 0.33 to 0.5 degrees apart."""
GAP = np.deg2rad(0.1)
"""Between two beams nothing is met over at least so much."""


def rings_and_columns(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (N,) beams, 0 the lowest, and azimuth steps, of (N, 3) points.

    Beams are told apart by gaps between elevations. Where there are none, as after the sweep's own
    motion was taken out, bands of elevation stand for beams: one may be two of the sensor.
    """
    if not len(points):
        return np.zeros(0, np.int16), np.zeros(0, np.int32)
    x, y, z = points.T.astype(np.float64)
    elevation = np.arctan2(z, np.hypot(x, y))
    band = _by_gaps(elevation)
    if band is None:
        band = np.floor((elevation - elevation.min()) / BEAM)
    column = np.floor((np.pi - np.arctan2(y, x)) / STEP)
    return band.astype(np.int16), column.astype(np.int32)


def _by_gaps(elevation: np.ndarray) -> np.ndarray | None:
    """Return (N,) beams between gaps; None if one of them is too wide, or they are too many."""
    order = np.argsort(elevation, kind="stable")
    rising = elevation[order]
    begins = np.concatenate([[0], np.flatnonzero(np.diff(rising) > GAP) + 1])
    ends = np.concatenate([begins[1:], [len(rising)]]) - 1
    if len(begins) > MOST_RINGS or (rising[ends] - rising[begins]).max() > BEAM:
        return None
    beams = np.empty(len(elevation))
    beams[order] = np.repeat(np.arange(len(begins)), ends - begins + 1)
    return beams


def rings_of(points: np.ndarray, told: np.ndarray) -> np.ndarray | None:
    """Return (N,) beams from 0, the lowest, of (N,) numbers that a file tells.

    Makers number from below or from above, a beam without returns between included, or by firing:
    then beams are ranked by elevation. None where the numbers can be none of beams.
    """
    numbers, beams = np.unique(told, return_inverse=True)
    span = numbers[-1] - numbers[0] if len(numbers) else 0
    if len(numbers) < 2 or span >= MOST_RINGS or (numbers != np.floor(numbers)).any():
        return None
    x, y, z = points.T.astype(np.float64)
    elevation = np.arctan2(z, np.hypot(x, y))
    mean = np.bincount(beams, elevation) / np.bincount(beams)
    rises = np.diff(mean) > 0
    rank = np.empty(len(numbers), np.int16)
    if rises.all():
        rank[:] = numbers - numbers[0]
    elif not rises.any():
        rank[:] = numbers[-1] - numbers
    else:
        rank[np.argsort(mean, kind="stable")] = np.arange(len(numbers))
    ordered: np.ndarray = rank[beams]
    return ordered
