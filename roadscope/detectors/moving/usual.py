"""How large a vehicle is taken to be of which a part is seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.core import Category
from roadscope.detectors.moving.link_kernels import roomy
from roadscope.detectors.moving.links import Chain
from roadscope.detectors.shape.bodies import BODIES, Body

VEHICLES = (Category.CAR, Category.VAN, Category.TRUCK)
"""Buses go as trucks: what tells them apart is their height, and roofs are often above the beams.
"""
TWO_WHEELERS = [b for b in BODIES if b.category is Category.MOTORCYCLE]
TRIED = TWO_WHEELERS + [b for b in BODIES if b.category in VEHICLES]
ROOM_M = np.array(
    [[mean + 2 * spread for mean, spread in (b.length, b.width, b.height)] for b in TRIED]
)
"""(B, 3) length, width and height that a body of each kind hardly exceeds."""
RIDER_M = 1.3
"""Height that a rider reaches and a corner of a car does not."""

Size = tuple[float, float, float]


def usual(chains: Sequence[Chain]) -> list[tuple[Body, Size]]:
    """Return the first usual body that has room for what is seen of each, and its size.

    Two-wheelers come first, and are told by their rider: as narrow a part of a car is low.
    """
    sightings = [s for chain in chains for s in chain.sightings]
    if not sightings:
        return []
    kinds, along = roomy(
        np.concatenate([s.points for s in sightings]),
        np.concatenate([s.candidate.times_s for s in sightings]),
        np.cumsum([0, *(len(s.points) for s in sightings)]),
        np.cumsum([0, *(len(chain.sightings) for chain in chains)]),
        np.array([chain.velocity for chain in chains]),
        (ROOM_M, len(TWO_WHEELERS), RIDER_M),
    )
    bodies = [TRIED[kind] for kind in kinds.tolist()]
    lengths = [max(b.length[0], a) for b, a in zip(bodies, along.tolist(), strict=True)]
    return [
        (b, (length, b.width[0], b.height[0])) for b, length in zip(bodies, lengths, strict=True)
    ]
