"""The line that a scripted road follows: straights and bends whose curvature never jumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GRID_M = 1.0
PEAK = 1.875
"""Largest slope of the quintic smoothstep: a bend's sharpest curvature over its mean one."""

SHARPEST_M = 500.0
"""Bends no sharper than this leave articulated lorries, stiff here, 0.3 m off their lane."""

Bend = tuple[float, float, float]
"""Where a bend begins and how long it is, metres along the course, and its turn in radians."""


@dataclass(frozen=True, slots=True)
class Course:
    """A plane curve through the origin, there along x, by arc length.

    bends: where and how much it turns, each as a quintic smoothstep of the heading, so that
        curvature and its slope are continuous; positive turns are to the left.
    """

    bends: tuple[Bend, ...] = ()

    def headings(self, along: np.ndarray) -> np.ndarray:
        """Return headings in radians, continuous, at ways along of any shape, metres."""
        turned = np.zeros_like(along, np.float64)
        for start, length, turn in self.bends:
            u = np.clip((along - start) / length, 0.0, 1.0)
            turned += turn * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        return turned

    def curvatures(self, along: np.ndarray) -> np.ndarray:
        """Return curvatures in 1/m, to the left positive."""
        bent = np.zeros_like(along, np.float64)
        for start, length, turn in self.bends:
            u = np.clip((along - start) / length, 0.0, 1.0)
            bent += turn / length * 30.0 * u**2 * (1.0 - u) ** 2
        return bent

    def places(self, along: np.ndarray, left: np.ndarray | float) -> np.ndarray:
        """Return (..., 2) places in metres that far along and to the left of the course."""
        low, high = min(float(along.min()), 0.0), max(float(along.max()), 0.0)
        knots = GRID_M * np.arange(np.floor(low / GRID_M), np.ceil(high / GRID_M) + 2)
        nodes = self._nodes(knots)
        cell = np.floor(along / GRID_M).astype(np.int64) - round(knots[0] / GRID_M)
        heading = self.headings(along)
        on = _hermite(along - knots[cell], nodes[cell], nodes[cell + 1], self._steps(knots, cell))
        normal = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
        placed: np.ndarray = on + np.asarray(left)[..., None] * normal
        return placed

    def _nodes(self, knots: np.ndarray) -> np.ndarray:
        """(K, 2) places of the course itself at knots a metre apart, by Simpson's rule."""
        ends, middles = self.headings(knots), self.headings(knots[:-1] + GRID_M / 2)
        steps = [
            GRID_M / 6 * (way(ends[:-1]) + 4 * way(middles) + way(ends[1:]))
            for way in (np.cos, np.sin)
        ]
        sums = np.concatenate([np.zeros((1, 2)), np.cumsum(np.stack(steps, axis=-1), axis=0)])
        nodes: np.ndarray = sums - sums[round(-knots[0] / GRID_M)]
        return nodes

    def _steps(self, knots: np.ndarray, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return unit tangents at both ends of cells."""
        ends = self.headings(knots)
        tangents = np.stack([np.cos(ends), np.sin(ends)], axis=-1)
        return tangents[cell], tangents[cell + 1]


def winding(
    rng: np.random.Generator, span_m: tuple[float, float], radius_m: float, *, turn_rad: float = 0.5
) -> Course:
    """Draw bends to both sides between two ways along, never sharper than radius or 500 m.

    turn_rad: the most that one bend turns; the heading stays within twice that.
    """
    radius_m = max(radius_m, SHARPEST_M)
    bends, heading = [], 0.0
    at = span_m[0] + float(rng.uniform(0.0, 1.0)) * radius_m / 4
    while at < span_m[1]:
        turn = turn_rad * float(rng.uniform(0.3, 1.0)) * float(rng.choice([-1.0, 1.0]))
        turn = -turn if abs(heading + turn) > 2 * turn_rad else turn
        length = PEAK * abs(turn) * radius_m * float(rng.uniform(1.0, 1.5))
        bends.append((at, length, turn))
        heading += turn
        at += length + float(rng.uniform(0.05, 0.4)) * radius_m
    return Course(tuple(bends))


def _hermite(
    way: np.ndarray, start: np.ndarray, end: np.ndarray, tangents: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Return (..., 2) places on the cubics of cells, a way in metres after their start."""
    u = (way / GRID_M)[..., None]
    placed: np.ndarray = (
        (2 * u**3 - 3 * u**2 + 1) * start
        + (u**3 - 2 * u**2 + u) * GRID_M * tangents[0]
        + (3 * u**2 - 2 * u**3) * end
        + (u**3 - u**2) * GRID_M * tangents[1]
    )
    return placed
