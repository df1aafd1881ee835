"""The beams of a LiDAR: found by the directions of points, or checked against them."""

from __future__ import annotations

import numpy as np

from roadscope.core.scan import MOST_RINGS

AZIMUTH_STEP_RAD = np.deg2rad(0.2)
"""Azimuth steps of common sensors at 10 Hz."""
MAX_BEAM_HEIGHT_RAD = np.deg2rad(0.4)
"""Elevations within this are of one beam: HDL-64E's beams are 0.33 to 0.5 degrees apart."""
MIN_BEAM_GAP_RAD = np.deg2rad(0.1)
"""There are no points within at least this gap between two beams. Chosen by hand."""
MAX_BEAM_SHARE = 0.5
"""A beam sweeps through a smaller share of the sensor's elevations. One of a sensor that is tilted
by 10 degrees sweeps through a third, each laser of a Livox through nine tenths. Chosen by hand."""


STEP_BACK_RAD = np.deg2rad(0.2)
"""In a file that has one beam after the other, azimuths rise along a beam and step back by more
than this where the next begins."""
SEAMS_RAD = np.linspace(0, 2 * np.pi, 36, endpoint=False)
SEAM_STEPS, SEAM_POINTS = 21, 8000
"""Azimuths that are tried for the place where beams begin, finer steps around the best one, and
points that the first are tried with."""
FEWEST_BEAMS, MOST_BEAMS = 4, 256
"""Numbers of beams of sensors on the market are 4 to 192."""
LEAST_ORDERED = 0.9
"""Least share of beams that are higher (or lower) than the one before, if beams are in order."""
MAX_BEAM_SPREAD_RAD = np.deg2rad(1.5)
"""The points of a beam are within this, but for one tenth on either side: beams do not start at one
point, so that near points are at other elevations. Chosen by hand."""


MAX_ZIGZAG_RAD = np.deg2rad(0.2)
"""Elevations of three neighbours along a beam differ from a line by less, at the median. Those of
two units that are stacked 0.25 m apart differ by 0.7 degrees at 20 m. Chosen by hand."""


def rings_of(points: np.ndarray) -> np.ndarray:
    """Return the beam of each of (N, 3) points, (N,) int16, 0 the lowest, found by directions.

    Points may be in the order of their beams, as in KITTI's files. Otherwise beams are separated by
    gaps between elevations. If there are no gaps, as in a deskewed scan or one of several units,
    bands of elevation take their place (`shows_beams`); one of them may hold two beams.
    """
    if not len(points):
        return np.zeros(0, np.int16)
    elevations = elevations_of(points)
    rings = _rings_shown(points, elevations)
    if rings is None:
        rings = np.floor((elevations - elevations.min()) / MAX_BEAM_HEIGHT_RAD)
    numbers: np.ndarray = rings.astype(np.int16)
    return numbers


def shows_beams(points: np.ndarray) -> bool:
    """Return whether order or directions of (N, 3) points show which beam each is of."""
    return bool(len(points)) and _rings_shown(points, elevations_of(points)) is not None


def _rings_shown(points: np.ndarray, elevations: np.ndarray) -> np.ndarray | None:
    rings = _rings_by_order(azimuths_of(points), elevations)
    return _rings_by_gaps(elevations) if rings is None else rings


def azimuth_steps(points: np.ndarray) -> np.ndarray:
    """Return the azimuth step of each of (N, 3) points, (N,) int32, clockwise from behind."""
    steps: np.ndarray = np.floor((np.pi - azimuths_of(points)) / AZIMUTH_STEP_RAD).astype(np.int32)
    return steps


def why_no_beams(points: np.ndarray, numbers: np.ndarray) -> str:
    """Return why numbers of (N, 3) points cannot be those of their beams; empty if they can.

    numbers: (N,).
    """
    known, beams = np.unique(numbers, return_inverse=True)
    if not np.isfinite(known).all() or (known != np.floor(known)).any():
        return "beams have whole numbers"
    if len(known) < 2:
        return "the same for all points"
    if known[-1] - known[0] >= MOST_RINGS:
        return f"its numbers span {known[-1] - known[0]:g}: no sensor has so many beams"
    elevations = elevations_of(points)
    order = np.lexsort((elevations, beams))
    counts = np.bincount(beams)
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    low, high = (
        elevations[order][starts + (share * (counts - 1)).astype(int)] for share in (0.1, 0.9)
    )
    whole = float(np.subtract(*np.quantile(elevations, [0.95, 0.05])))
    if np.average(high - low, weights=counts) > MAX_BEAM_SHARE * whole:
        return "points of one number are at all elevations, those of a beam are not"
    if _zigzag_rad(azimuths_of(points), elevations, beams) > MAX_ZIGZAG_RAD:
        return "points of one number are of several beams: are there several units?"
    return ""


def _zigzag_rad(azimuths: np.ndarray, elevations: np.ndarray, beams: np.ndarray) -> float:
    """Return by how much elevations differ from a line of three neighbours of a number, median."""
    order = np.lexsort((azimuths, beams))
    one_number = beams[order][2:] == beams[order][:-2]
    bends = np.abs(np.diff(elevations[order], n=2))[one_number] / 2
    return float(np.median(bends)) if len(bends) else 0.0


def ranked_rings(points: np.ndarray, numbers: np.ndarray) -> np.ndarray | None:
    """Return (N,) int16 beams, 0 the lowest; None if the numbers are not whole or too far apart.

    points: (N, 3).
    numbers: (N,) beam numbers of the file. They may count from below or from above, with gaps for
        beams without returns; numbers in another order, as of firing, are ranked by elevation.
    """
    known, beams = np.unique(numbers, return_inverse=True)
    span = known[-1] - known[0] if len(known) else 0
    if len(known) < 2 or span >= MOST_RINGS or (known != np.floor(known)).any():
        return None
    mean = np.bincount(beams, elevations_of(points)) / np.bincount(beams)
    rises = np.diff(mean) > 0
    rank = np.empty(len(known), np.int16)
    if rises.all():
        rank[:] = known - known[0]
    elif not rises.any():
        rank[:] = known[-1] - known
    else:
        rank[np.argsort(mean, kind="stable")] = np.arange(len(known))
    rings: np.ndarray = rank[beams]
    return rings


def elevations_of(points: np.ndarray) -> np.ndarray:
    """Return (N,) angles above the x-y plane, radians."""
    x, y, z = points.T.astype(np.float64)
    elevations: np.ndarray = np.arctan2(z, np.hypot(x, y))
    return elevations


def azimuths_of(points: np.ndarray) -> np.ndarray:
    """Return (N,) angles around z, from x to y, radians."""
    x, y, _ = points.T.astype(np.float64)
    azimuths: np.ndarray = np.arctan2(y, x)
    return azimuths


def _rings_by_order(azimuths: np.ndarray, elevations: np.ndarray) -> np.ndarray | None:
    """Return (N,) beams of points that are sorted by beam and then by azimuth, None for others.

    Either the highest or the lowest beam comes first.
    """
    few = slice(None, None, 1 + len(azimuths) // SEAM_POINTS)
    steps = (np.diff(azimuths) + np.pi) % (2 * np.pi) - np.pi
    for along, rising in ((azimuths, steps > 0), (-azimuths, steps < 0)):
        if len(steps) < FEWEST_BEAMS or rising.mean() < LEAST_ORDERED:
            continue
        rough = min(
            SEAMS_RAD, key=lambda seam: _elevation_spread(along[few], elevations[few], seam)
        )
        near = rough + np.linspace(-1, 1, SEAM_STEPS) * SEAMS_RAD[1]
        beams = _cut_at(
            along, min(near, key=lambda seam: _elevation_spread(along, elevations, seam))
        )
        counts = np.bincount(beams)
        if not FEWEST_BEAMS <= len(counts) <= MOST_BEAMS:
            continue
        mean = np.bincount(beams, elevations) / counts
        rises = np.diff(mean) > 0
        if max(rises.mean(), 1 - rises.mean()) < LEAST_ORDERED:
            continue
        if np.quantile(np.abs(elevations - mean[beams]), LEAST_ORDERED) > MAX_BEAM_SPREAD_RAD:
            continue
        rising_beams = beams if rises.mean() > 0.5 else beams.max() - beams
        steps_back = np.where(rises == (rises.mean() > 0.5), 0.0, np.abs(np.diff(mean)))
        if steps_back.max() < MAX_BEAM_SPREAD_RAD:
            return rising_beams
        # Several units, one after the other.
        ranked: np.ndarray = np.argsort(np.argsort(mean))[beams]
        return ranked
    return None


def _cut_at(along: np.ndarray, seam: float) -> np.ndarray:
    """Return (N,) which turn from the seam on a point belongs to, for azimuths that rise."""
    past = (along - seam) % (2 * np.pi)
    return np.concatenate([[0], np.cumsum(np.diff(past) < -STEP_BACK_RAD)])


def _elevation_spread(along: np.ndarray, elevations: np.ndarray, seam: float) -> float:
    """Return how much elevations differ in a turn, if turns begin at a seam, radians."""
    beams = _cut_at(along, seam)
    if beams[-1] >= MOST_BEAMS:
        return np.inf
    mean = np.bincount(beams, elevations) / np.bincount(beams)
    return float(np.mean(np.abs(elevations - mean[beams])))


def _rings_by_gaps(elevations: np.ndarray) -> np.ndarray | None:
    """Return (N,) beams between gaps; None if one is too high or if there are too many."""
    order = np.argsort(elevations, kind="stable")
    rising = elevations[order]
    starts = np.concatenate([[0], np.flatnonzero(np.diff(rising) > MIN_BEAM_GAP_RAD) + 1])
    ends = np.concatenate([starts[1:], [len(rising)]]) - 1
    highest = (rising[ends] - rising[starts]).max()
    if len(starts) > MOST_RINGS or highest > MAX_BEAM_HEIGHT_RAD:
        return None
    rings = np.empty(len(elevations))
    rings[order] = np.repeat(np.arange(len(starts)), ends - starts + 1)
    return rings
