"""The reference line of a scripted road: straights and bends with continuous curvature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core.bounds import Bounds

GRID_M = 1.0
"""Spacing of the knots between which the course is a cubic."""
PEAK = 1.875
"""Largest slope of the quintic smoothstep: the ratio of a bend's greatest curvature to its mean."""
SHARPEST_M = 500.0
"""Least radius of bends; articulated lorries, rigid here, then leave their lane by 0.3 m."""
LARGEST_TURN_RAD = 0.5
"""Largest turn of one bend, chosen by hand; the heading stays within twice that."""


class Bend(NamedTuple):
    """A bend of a course: where it begins, its length, and its turn; positive is to the left."""

    start_m: float
    length_m: float
    turn_rad: float


@dataclass(frozen=True, slots=True)
class Course:
    """A plane curve by arc length; at arc length 0 it is at (0, 0) and points along x.

    bends: the heading turns by a quintic smoothstep in each of them, so that the curvature and
        its slope are continuous.
    """

    bends: tuple[Bend, ...] = ()

    def headings(self, along: np.ndarray) -> np.ndarray:
        """Return headings in radians, continuous, at arc lengths of any shape, metres."""
        turned = np.zeros_like(along, np.float64)
        for start, length, turn in self.bends:
            u = np.clip((along - start) / length, 0.0, 1.0)
            turned += turn * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        return turned

    def curvatures(self, along: np.ndarray) -> np.ndarray:
        """Return curvatures in 1/m, positive to the left."""
        bent = np.zeros_like(along, np.float64)
        for start, length, turn in self.bends:
            u = np.clip((along - start) / length, 0.0, 1.0)
            bent += turn / length * 30.0 * u**2 * (1.0 - u) ** 2
        return bent

    def points(self, along: np.ndarray, left: np.ndarray | float) -> np.ndarray:
        """Return (..., 2) points at arc lengths along the course, offset to its left, metres."""
        low, high = min(float(along.min()), 0.0), max(float(along.max()), 0.0)
        knots = GRID_M * np.arange(np.floor(low / GRID_M), np.ceil(high / GRID_M) + 2)
        nodes = self._nodes(knots)
        cell = np.floor(along / GRID_M).astype(np.int64) - round(knots[0] / GRID_M)
        heading = self.headings(along)
        centre_line = _hermite(
            along - knots[cell], nodes[cell], nodes[cell + 1], *self._tangents(knots, cell)
        )
        normal = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
        placed: np.ndarray = centre_line + np.asarray(left)[..., None] * normal
        return placed

    def _nodes(self, knots: np.ndarray) -> np.ndarray:
        """Return the (K, 2) points of the course at knots a metre apart, by Simpson's rule."""
        ends, middles = self.headings(knots), self.headings(knots[:-1] + GRID_M / 2)
        steps = [
            GRID_M / 6 * (slope(ends[:-1]) + 4 * slope(middles) + slope(ends[1:]))
            for slope in (np.cos, np.sin)
        ]
        sums = np.concatenate([np.zeros((1, 2)), np.cumsum(np.stack(steps, axis=-1), axis=0)])
        nodes: np.ndarray = sums - sums[round(-knots[0] / GRID_M)]
        return nodes

    def _tangents(self, knots: np.ndarray, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return unit tangents at both ends of cells."""
        ends = self.headings(knots)
        tangents = np.stack([np.cos(ends), np.sin(ends)], axis=-1)
        return tangents[cell], tangents[cell + 1]


def winding(rng: np.random.Generator, span_m: Bounds, radius_m: float) -> Course:
    """Draw a course with bends to both sides.

    span_m: arc lengths between which the bends begin.
    radius_m: least radius; at least `SHARPEST_M` is used.
    """
    radius_m = max(radius_m, SHARPEST_M)
    bends, heading = [], 0.0
    start_m = span_m.low + float(rng.uniform(0.0, 1.0)) * radius_m / 4
    while start_m < span_m.high:
        turn = LARGEST_TURN_RAD * float(rng.uniform(0.3, 1.0)) * float(rng.choice([-1.0, 1.0]))
        turn = -turn if abs(heading + turn) > 2 * LARGEST_TURN_RAD else turn
        length = PEAK * abs(turn) * radius_m * float(rng.uniform(1.0, 1.5))
        bends.append(Bend(start_m, length, turn))
        heading += turn
        start_m += length + float(rng.uniform(0.05, 0.4)) * radius_m
    return Course(tuple(bends))


def _hermite(
    offset_m: np.ndarray,
    start: np.ndarray,
    end: np.ndarray,
    start_tangent: np.ndarray,
    end_tangent: np.ndarray,
) -> np.ndarray:
    """Return (..., 2) points on the cubics of cells, metres after the start of each cell."""
    u = (offset_m / GRID_M)[..., None]
    placed: np.ndarray = (
        (2 * u**3 - 3 * u**2 + 1) * start
        + (u**3 - 2 * u**2 + u) * GRID_M * start_tangent
        + (3 * u**2 - 2 * u**3) * end
        + (u**3 - u**2) * GRID_M * end_tangent
    )
    return placed
