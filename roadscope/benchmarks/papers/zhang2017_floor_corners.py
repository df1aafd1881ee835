"""What the information floor knows of the car's corners: their radius, or only how it is spread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.benchmarks.papers.zhang2017_floor_kernels import Bodies
from roadscope.benchmarks.papers.zhang2017_outline import fusion
from roadscope.detectors.pose.body_model import RADIUS, VALUES, part_of
from roadscope.envs.world.ford_saloon import CORNER_RADII_M, with_corners
from roadscope.envs.world.prisms import Prisms

QUANTILES = 20_000
RADII = 81
"""Radii between the least and the greatest, 5 mm apart: a surface is off by 1 mm at most."""


@dataclass(frozen=True, slots=True)
class Corners:
    """G bodies with rising radii, and how many unknowns, 0 or 1, say which it is.

    normal, rows: (Q,) values of a standard normal unknown, rising, and the row of the body that
    each means, with fractions.
    """

    bodies: Bodies
    unknowns: int
    normal: np.ndarray
    rows: np.ndarray

    def which(self, unknowns: np.ndarray) -> np.ndarray:
        """Return the row of the body (N,) for unknowns (N, E)."""
        if not self.unknowns:
            return np.zeros(len(unknowns), np.int64)
        rows: np.ndarray = np.rint(np.interp(unknowns[:, 0], self.normal, self.rows))
        return rows.astype(np.int64)


@cache
def told(body: str) -> Corners:
    """Return the car as it is."""
    return Corners(bodies_of((CORNER_RADII_M[body],)), 0, np.empty(0), np.empty(0))


@cache
def untold() -> Corners:
    """Return the car with corners of any radius, spread as our fit supposes.

    Our fit makes the radius from a standard normal unknown of its own. Here a greater unknown
    always means a greater radius, so that the posterior has one mode; the spread is the same.
    """
    from scipy.special import ndtri

    least, most = fusion().radius_m
    normal = ndtri((np.arange(QUANTILES) + 0.5) / QUANTILES)
    model, states = fusion(), np.zeros((QUANTILES, VALUES))
    states[:, RADIUS] = normal
    radii_m = np.sort([part_of(model.shape, 0, state).radius for state in states])
    rows = (radii_m - least) / (most - least) * (RADII - 1)
    bodies = bodies_of(tuple(np.linspace(least, most, RADII).tolist()))
    return Corners(bodies, 1, normal, rows)


@cache
def bodies_of(radii_m: Sequence[float]) -> Bodies:
    """Return the car's prisms as half-planes, for each radius of its corners."""
    cars = [with_corners(radius_m) for radius_m in radii_m]
    outlines = np.concatenate([car.footprints for car in cars], axis=1)
    low, high = outlines.min(axis=1), outlines.max(axis=1)
    return Bodies(
        np.stack([_planes(car) for car in cars]),
        np.stack([car.corners.astype(np.int64) for car in cars]),
        np.column_stack([cars[0].bottoms, cars[0].tops]),
        cars[0].reflectivities.astype(np.float64),
        np.column_stack([(low + high) / 2, (high - low) / 2]),
    )


def _planes(prisms: Prisms) -> np.ndarray:
    """(M, 12, 3) unit normals and offsets of the sides."""
    edges = np.roll(prisms.footprints, -1, axis=1) - prisms.footprints
    for m, corners in enumerate(prisms.corners):
        edges[m, corners - 1] = prisms.footprints[m, 0] - prisms.footprints[m, corners - 1]
    lengths = np.maximum(np.linalg.norm(edges, axis=2), 1e-12)
    normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1) / lengths[..., None]
    reaches = (normals * prisms.footprints).sum(axis=2)
    return np.concatenate([normals, reaches[..., None]], axis=2)
