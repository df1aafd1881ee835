"""Many things of one kind at once: each is one or more prisms with the same owner."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from roadscope.envs.world.borders import Sites
from roadscope.envs.world.prisms import Prisms, padded, placed, rectangle

Value = np.ndarray | float


class Batch(NamedTuple):
    """Prisms in the making: the columns of `Prisms`, unchecked; owners are thing numbers."""

    footprints: np.ndarray
    corners: np.ndarray
    bottoms: np.ndarray
    tops: np.ndarray
    owners: np.ndarray
    extinctions: np.ndarray
    reflectivities: np.ndarray
    materials: np.ndarray
    headings: np.ndarray

    def select(self, index: np.ndarray) -> Batch:
        """Keep the rows that a mask or an index array names."""
        return Batch(*(column[index] for column in self))


def join(parts: Sequence[Batch | Prisms]) -> Batch:
    """Put batches one after the other."""
    parts = parts or [Prisms.empty()]
    return Batch(*(np.concatenate([getattr(p, n) for p in parts]) for n in Batch._fields))


def prisms_of(
    outlines: np.ndarray,
    bottoms: Value,
    tops: Value,
    reflectivities: Value,
    extinctions: Value = 0.0,
    *,
    materials: Value = 0.0,
    headings: Value = 0.0,
) -> Batch:
    """Make one prism for each of m things: (m, K, 2) outlines, numbers or (m,) arrays."""
    count = len(outlines)

    def full(value: Value) -> np.ndarray:
        column = np.empty(count)
        column[:] = value
        return column

    return Batch(
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


def scattered(
    sites: Sites, per_m: float, band_m: tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw things beside borders: (m, 2) centres and (m,) yaws of the border.

    Each piece of border has one or none; a density beyond one a piece is cut to that.
    """
    lengths = np.linalg.norm(sites.ends - sites.starts, axis=1)
    along, across, chance = rng.random((3, len(sites)))
    offsets = band_m[0] + across * (band_m[1] - band_m[0])
    centres = (
        sites.starts
        + along[:, None] * (sites.ends - sites.starts)
        + offsets[:, None] * sites.normals
    )
    taken = chance < per_m * lengths
    return centres[taken], sites.yaws[taken]


def ribbon(sites: Sites, offset_m: float, thickness_m: float) -> np.ndarray:
    """(S, 4, 2) outlines of a band that follows the border at a distance, piece by piece."""
    starts = sites.starts + offset_m * sites.start_normals
    ends = sites.ends + offset_m * sites.end_normals
    out = thickness_m * sites.start_normals, thickness_m * sites.end_normals
    # Outside to the right of the direction start to end or to the left: turn the same way round.
    quads = np.stack([starts, starts + out[0], ends + out[1], ends], axis=1)
    ahead, side = sites.ends - sites.starts, sites.normals
    left = ahead[:, 0] * side[:, 1] - ahead[:, 1] * side[:, 0] > 0
    quads[left] = quads[left, ::-1]
    return quads


def boxes(centres: np.ndarray, yaws: np.ndarray, length_m: Value, width_m: Value) -> np.ndarray:
    """(m, 4, 2) outlines of rectangles."""
    sizes = np.stack(np.broadcast_arrays(length_m, width_m, yaws)[:2], axis=-1)
    return placed(rectangle(1.0, 1.0) * sizes[:, None, :], centres, yaws)


def stretches(sites: Sites, share: float, rng: np.random.Generator) -> np.ndarray:
    """(S,) bool: pieces along which something runs; it goes on for eight pieces at a time."""
    groups, members = np.unique(
        np.stack([sites.lanes, sites.slots // 8], axis=1), axis=0, return_inverse=True
    )
    chosen = rng.random(len(groups)) < share
    result: np.ndarray = chosen[members.reshape(-1)]
    return result
