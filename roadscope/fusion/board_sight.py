"""What a LiDAR at rest tells of a board: its plane, and between which beams it ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.fusion.calibration import CalibrationError

NEAR_BEAMS = 2
"""Beams farther than this from the board's edge, in columns, say nothing more of it."""
LEAST_RETURNS = 6
OUTLYING = 4.0
"""Ranges off by more than this many standard deviations are not the board's."""


@dataclass(frozen=True, slots=True, eq=False)
class Beams(Record):
    """Where the beams of a LiDAR look: azimuths (C,) of columns, elevations (R,) of rings, rad."""

    azimuths: np.ndarray
    elevations: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, azimuths=(np.float64, ("C",)), elevations=(np.float64, ("R",)))

    @property
    def step_rad(self) -> float:
        """Between neighbouring columns."""
        return float(np.abs(np.median(np.diff(self.azimuths))))

    def rays(self, ring: np.ndarray, column: np.ndarray) -> np.ndarray:
        """(N, 3) unit directions, LiDAR frame."""
        azimuth, elevation = self.azimuths[column], self.elevations[ring]
        flat = np.cos(elevation)
        return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], -1)


@dataclass(frozen=True, slots=True, eq=False)
class BoardSight(Record):
    """A board at rest in many scans, all in the LiDAR's frame.

    plane: (3,) float64, 1/m, q of the plane q . p = 1.
    plane_root: (3, 3) float64; plane_root @ (q - plane) has unit covariance at the true q.
    rays: (N, 3) float64, unit directions of the beams beside the board's edge.
    met: (N,) float64, share of the scans in which each met the board.
    step_rad: between neighbouring columns.
    """

    plane: np.ndarray
    plane_root: np.ndarray
    rays: np.ndarray
    met: np.ndarray
    step_rad: float

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            plane=(np.float64, (3,)),
            plane_root=(np.float64, (3, 3)),
            rays=(np.float64, ("N", 3)),
            met=(np.float64, ("N",)),
        )


def board_sight(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, beams: Beams, scans: int
) -> BoardSight:
    """Sum up the returns of a board at rest.

    points: (N, 3) metres, LiDAR frame, of the board alone, from `scans` scans. ring, column: (N,).
    A beam without returns is known to have passed beside the board: it looked there, as beams say.
    """
    if len(points) < LEAST_RETURNS:
        raise CalibrationError(f"expected at least {LEAST_RETURNS} returns, got {len(points)}")
    ranges = np.linalg.norm(points, axis=1)
    plane, root = _plane(beams.rays(ring, column), ranges)
    rings, columns, met = _beside_edges(ring, column, beams, scans)
    return BoardSight(plane, root, beams.rays(rings, columns), met, beams.step_rad)


def _plane(rays: np.ndarray, ranges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the likeliest plane of ranges wrong along their rays, and the root of what it knows.

    range = 1 / (q . ray), by Gauss and Newton from the linear solution, without outliers.
    """
    plane = np.linalg.lstsq(rays * ranges[:, None], np.ones(len(rays)), rcond=None)[0]
    root, kept = np.eye(3), np.ones(len(rays), bool)
    for _ in range(6):
        along = rays @ plane
        off = ranges - 1 / along
        sigma = max(1.4826 * float(np.median(np.abs(off[kept]))), 1e-4)
        kept = np.abs(off) < OUTLYING * sigma
        slope = -rays[kept] / along[kept, None] ** 2
        plane = plane + np.linalg.lstsq(slope, off[kept], rcond=None)[0]
        root = np.asarray(np.linalg.qr(slope, mode="r")) / sigma
    return plane, root


def _beside_edges(
    ring: np.ndarray, column: np.ndarray, beams: Beams, scans: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ring, column and share of returns of the beams next to the board's edge."""
    from scipy.ndimage import maximum_filter, minimum_filter

    count = np.zeros((len(beams.elevations), len(beams.azimuths)))
    np.add.at(count, (ring, column), 1.0)
    met = np.minimum(count / scans, 1.0)
    size = (3, 2 * NEAR_BEAMS + 1)
    beside = (maximum_filter(met, size) >= 0.5) & (minimum_filter(met, size) < 0.5)
    rings, columns = np.nonzero(beside)
    return rings, columns, met[rings, columns]
