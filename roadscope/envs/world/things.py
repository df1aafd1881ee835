"""Makes many things of one kind at once; the prisms of a thing have the same owner."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from roadscope.core.bounds import Bounds
from roadscope.envs.world.borders import Sites
from roadscope.envs.world.prisms import Prisms, padded, placed, rectangle

Value = np.ndarray | float


class ThingPrisms(NamedTuple):
    """Columns of `Prisms` under construction, unchecked; owners are numbers of things."""

    footprints: np.ndarray
    corners: np.ndarray
    bottoms: np.ndarray
    tops: np.ndarray
    owners: np.ndarray
    extinctions: np.ndarray
    reflectivities: np.ndarray
    materials: np.ndarray
    headings: np.ndarray

    def select(self, index: np.ndarray) -> ThingPrisms:
        """Return the rows of a mask or of an index array."""
        return ThingPrisms(*(column[index] for column in self))


def join(parts: Sequence[ThingPrisms | Prisms]) -> ThingPrisms:
    """Return all prisms one after the other."""
    parts = parts or [Prisms.empty()]
    return ThingPrisms(
        *(np.concatenate([getattr(p, n) for p in parts]) for n in ThingPrisms._fields)
    )


def prisms_of(
    outlines: np.ndarray,
    bottoms: Value,
    tops: Value,
    reflectivities: Value,
    extinctions: Value = 0.0,
    *,
    materials: Value = 0.0,
    headings: Value = 0.0,
) -> ThingPrisms:
    """Return one prism for each of m things.

    outlines: (m, K, 2) metres. All others are a number for all things, or an (m,) array.
    bottoms, tops: metres. extinctions: 1/m. headings: radians.
    """
    count = len(outlines)

    def full(value: Value) -> np.ndarray:
        column = np.empty(count)
        column[:] = value
        return column

    return ThingPrisms(
        padded(outlines),
        np.full(count, outlines.shape[1]),
        full(bottoms),
        full(tops),
        np.arange(count),
        full(extinctions),
        full(reflectivities),
        full(materials).astype(np.int16),
        full(headings),
    )


def with_owners(prisms: Prisms, owners: np.ndarray) -> Prisms:
    """Return the same prisms under other owners."""
    return Prisms(
        prisms.footprints,
        prisms.corners,
        prisms.bottoms,
        prisms.tops,
        owners.astype(np.int32),
        prisms.extinctions,
        prisms.reflectivities,
        prisms.materials,
        prisms.headings,
    )


def scatter_beside(
    sites: Sites, per_m: float, band_m: Bounds, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw positions beside borders: (m, 2) centres and (m,) yaws of the border.

    per_m: mean number per metre of border; each piece of border has at most one.
    band_m: least and greatest distance of the centres from the border.
    """
    lengths = np.linalg.norm(sites.ends - sites.starts, axis=1)
    along, across, chance = rng.random((3, len(sites)))
    offsets = band_m.low + across * (band_m.high - band_m.low)
    centres = (
        sites.starts
        + along[:, None] * (sites.ends - sites.starts)
        + offsets[:, None] * sites.normals
    )
    selected = chance < per_m * lengths
    return centres[selected], sites.yaws[selected]


def ribbon(sites: Sites, offset_m: float, thickness_m: float) -> np.ndarray:
    """Return (S, 4, 2) outlines of a band that follows the border at a distance, piece by piece."""
    starts = sites.starts + offset_m * sites.start_normals
    ends = sites.ends + offset_m * sites.end_normals
    outer_starts = starts + thickness_m * sites.start_normals
    outer_ends = ends + thickness_m * sites.end_normals
    # The outside may lie to the right or to the left: make all outlines counter-clockwise.
    quads = np.stack([starts, outer_starts, outer_ends, ends], axis=1)
    ahead, side = sites.ends - sites.starts, sites.normals
    left = ahead[:, 0] * side[:, 1] - ahead[:, 1] * side[:, 0] > 0
    quads[left] = quads[left, ::-1]
    return quads


def boxes(centres: np.ndarray, yaws: np.ndarray, length_m: Value, width_m: Value) -> np.ndarray:
    """Return (m, 4, 2) outlines of rectangles."""
    sizes = np.stack(np.broadcast_arrays(length_m, width_m, yaws)[:2], axis=-1)
    return placed(rectangle(1.0, 1.0) * sizes[:, None, :], centres, yaws)


def stretches(sites: Sites, share: float, rng: np.random.Generator) -> np.ndarray:
    """Return (S,) whether a thing such as a rail runs along a piece of border.

    One draw decides for eight neighbouring pieces.
    """
    groups, members = np.unique(
        np.stack([sites.lanes, sites.slots // 8], axis=1), axis=0, return_inverse=True
    )
    chosen = rng.random(len(groups)) < share
    result: np.ndarray = chosen[members.reshape(-1)]
    return result
