"""How large a vehicle is taken to be of which a part is seen."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
from roadscope.detectors.moving.links import Chain
from roadscope.detectors.shape.bodies import BODIES, Body

VEHICLES = (Category.CAR, Category.VAN, Category.TRUCK)
TWO_WHEELERS = [b for b in BODIES if b.category is Category.MOTORCYCLE]
RIDER_M = 1.3
"""Height that a rider reaches and a corner of a car does not."""
TURNS = tuple(float(turn) for turn in np.radians(np.arange(-24, 25, 4)))
"""By which a body may stand askew to the way that it goes."""


def usual(chain: Chain) -> tuple[Body, tuple[float, float, float]]:
    """Return the first usual body that has room for what is seen, and its size.

    Two-wheelers come first, and are told by their rider: as narrow a part of a car is low.
    """
    velocity = chain.velocity
    towards = float(np.arctan2(velocity[1], velocity[0]))
    spans = [_spans(s.at_stamp(velocity), towards) for s in chain.sightings]
    along, across = np.median(spans, axis=0)
    top = max(float(s.points[:, 2].max()) for s in chain.sightings)
    known = [b for b in BODIES if b.category in VEHICLES]
    tried = (TWO_WHEELERS if top > RIDER_M else []) + known
    body = next((b for b in tried if _room(b, along, across, top)), known[-1])
    return body, (max(body.length[0], float(along)), body.width[0], body.height[0])


@compiled()
def _spans(points: np.ndarray, towards: float) -> tuple[float, float]:
    """Return how far (N, 2) points reach along and across a body that goes about that way."""
    least, along, across = np.inf, 0.0, 0.0
    for turn in TURNS:
        cos, sin = np.cos(towards + turn), np.sin(towards + turn)
        low, high, right, left = np.inf, -np.inf, np.inf, -np.inf
        for i in range(len(points)):
            u = cos * points[i, 0] + sin * points[i, 1]
            v = cos * points[i, 1] - sin * points[i, 0]
            low, high, right, left = min(low, u), max(high, u), min(right, v), max(left, v)
        if (high - low) * (left - right) < least:
            along, across = high - low, left - right
            least = along * across
    return along, across


def _room(body: Body, along: float, across: float, top: float) -> bool:
    seen = zip((along, across, top), (body.length, body.width, body.height), strict=True)
    return all(extent <= mean + 2 * spread for extent, (mean, spread) in seen)
