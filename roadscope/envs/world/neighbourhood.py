"""Buildings and parked cars."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from roadscope.core import Category
from roadscope.envs.world.bodies import body_prisms
from roadscope.envs.world.borders import SITE_M, Sites
from roadscope.envs.world.footprints import placed
from roadscope.envs.world.materials import graded
from roadscope.envs.world.prisms import Prisms
from roadscope.envs.world.style import Style
from roadscope.envs.world.things import Batch, boxes, join, prisms_of

PLASTER = (0.3, 0.7)
"""Reflectivity of facades, dark brick to white plaster, at 905 nm."""
BUILDING_SLOT = 6
"""Pieces of border for each building: 24 m."""
PARKING_SLOT = 2
"""Pieces of border for each parked car: 8 m."""
MODELS = 32
"""How many different cars park."""
WIDEST_M = 1.88
SALT = 0x43617273


def buildings(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Blocks of two to six storeys, with a smaller top storey."""
    sites = sites.select(sites.straight & (sites.slots % BUILDING_SLOT == BUILDING_SLOT // 2))
    front, side, depth, storeys, paint, chance = rng.random((6, len(sites)))
    near, far = style.building_setback_m
    lengths = (0.55 + 0.37 * side) * BUILDING_SLOT * SITE_M
    depths = 8.0 + 6.0 * depth
    offsets = near + (far - near) * front + depths / 2
    taken = chance < style.buildings
    centres = (sites.middles + offsets[:, None] * sites.normals)[taken]
    yaws, lengths, depths = sites.yaws[taken], lengths[taken], depths[taken]
    tops = 3.0 * (2 + np.floor(5 * storeys[taken]))
    shades = PLASTER[0] + (PLASTER[1] - PLASTER[0]) * paint[taken]
    look = {"materials": graded("facade", paint[taken]), "headings": yaws}
    return join(
        [
            prisms_of(boxes(centres, yaws, lengths, depths), 0.0, tops, shades, **look),
            prisms_of(
                boxes(centres, yaws, lengths - 2, depths - 2), tops, tops + 2.5, shades, **look
            ),
        ]
    )


def parked_cars(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Cars at the kerb, half a metre off the lane."""
    sites = sites.select(sites.straight & (sites.slots % PARKING_SLOT == 0))
    sites = sites.select(rng.random(len(sites)) < style.parked_cars)
    models = rng.integers(MODELS, size=len(sites))
    kerb, turn = rng.normal(0.0, (0.05, 0.01), (len(sites), 2)).T
    headings = sites.yaws + np.pi * rng.integers(2, size=len(sites)) + turn
    offsets = 0.5 + WIDEST_M / 2 + kerb
    centres = sites.middles + offsets[:, None] * sites.normals
    return join(
        [
            _standing(_model(int(model)), centre, float(heading), thing)
            for thing, (model, centre, heading) in enumerate(
                zip(models, centres, headings, strict=True)
            )
        ]
    )


def _standing(body: Prisms, centre: np.ndarray, yaw: float, thing: int) -> Batch:
    count = len(body)
    outlines = placed(body.footprints, np.tile(centre, (count, 1)), np.full(count, yaw))
    return Batch(
        outlines, body.corners, body.bottoms, body.tops,
        np.full(count, thing), body.extinctions, body.reflectivities, body.materials,
        body.headings + yaw,
    )  # fmt: skip


@lru_cache(maxsize=MODELS)
def _model(number: int) -> Prisms:
    """One of the cars that park: a size around that of a small family car, and a paint."""
    rng = np.random.default_rng([SALT, number])
    size = np.array([4.4, WIDEST_M - 0.08, 1.5]) + rng.uniform(-1, 1, 3) * (0.5, 0.08, 0.08)
    return body_prisms(Category.CAR, size, rng)
