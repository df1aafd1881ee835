"""How large a vehicle is taken to be of which a part is seen."""

from __future__ import annotations

import math
from statistics import median

from roadscope.core import Category
from roadscope.detectors.moving.link_kernels import spans
from roadscope.detectors.moving.links import Chain
from roadscope.detectors.shape.bodies import BODIES, Body

VEHICLES = (Category.CAR, Category.VAN, Category.TRUCK)
FOUR_WHEELERS = [b for b in BODIES if b.category in VEHICLES]
TWO_WHEELERS = [b for b in BODIES if b.category is Category.MOTORCYCLE]
RIDER_M = 1.3
"""Height that a rider reaches and a corner of a car does not."""


def usual(chain: Chain) -> tuple[Body, tuple[float, float, float]]:
    """Return the first usual body that has room for what is seen, and its size.

    Two-wheelers come first, and are told by their rider: as narrow a part of a car is low.
    """
    velocity = chain.velocity
    x, y = velocity.tolist()
    towards = math.atan2(y, x)
    seen = [spans(s.points, s.candidate.times_s, velocity, towards) for s in chain.sightings]
    along, across = median(s[0] for s in seen), median(s[1] for s in seen)
    top = max(s[2] for s in seen)
    tried = (TWO_WHEELERS if top > RIDER_M else []) + FOUR_WHEELERS
    body = next((b for b in tried if _room(b, along, across, top)), FOUR_WHEELERS[-1])
    return body, (max(body.length[0], float(along)), body.width[0], body.height[0])


def _room(body: Body, along: float, across: float, top: float) -> bool:
    sides = (along, body.length), (across, body.width), (top, body.height)
    return all(extent <= mean + 2 * spread for extent, (mean, spread) in sides)
