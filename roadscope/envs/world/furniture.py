"""What road authorities put beside a road: rails, noise walls, lamps and signs.

Dimensions follow common European practice: W-beam guard rails 0.75 m high on posts, lamp posts
6 to 10 m, sign plates from 2 m up. Reflectivities at 905 nm: galvanised steel 0.4, concrete
0.35, retroreflective sheeting the most that the scale has.
"""

from __future__ import annotations

import numpy as np

from roadscope.envs.world import materials
from roadscope.envs.world.borders import Sites
from roadscope.envs.world.footprints import ellipse, placed
from roadscope.envs.world.style import Style
from roadscope.envs.world.things import Batch, boxes, join, prisms_of, ribbon, scattered, stretches

STEEL = 0.4
CONCRETE = 0.35
RETROREFLECTOR = 1.0
RAIL_M = 0.8
"""From the border to the face of a guard rail."""
WALL_M = 4.5
"""From the border to the face of a noise wall."""


def guard_rails(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Beam 0.45 to 0.75 m above the ground, one post a piece."""
    sites = sites.select(stretches(sites, style.guard_rail, rng))
    posts = sites.starts + (RAIL_M + 0.14) * sites.start_normals
    return join(
        [
            prisms_of(ribbon(sites, RAIL_M, 0.08), 0.45, 0.75, STEEL, materials=materials.STEEL),
            prisms_of(
                boxes(posts, sites.yaws, 0.06, 0.12), 0.0, 0.72, STEEL, materials=materials.STEEL
            ),
        ]
    )


def noise_walls(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Concrete walls 3.5 m high along stretches of the border."""
    sites = sites.select(stretches(sites, style.noise_wall, rng))
    return prisms_of(ribbon(sites, WALL_M, 0.2), 0.0, 3.5, CONCRETE, materials=materials.CONCRETE)


def lamps(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Lamp posts whose lantern overhangs no lane."""
    centres, yaws = scattered(sites, style.lamps, (1.3, 1.8), rng)
    tops = 6.0 + 4.0 * rng.random(len(centres))
    posts = placed(ellipse(0.18, 0.18), centres, yaws)
    lanterns = boxes(centres, yaws, 0.6, 0.25)
    look = {"materials": materials.STEEL}
    return join(
        [
            prisms_of(posts, 0.0, tops, STEEL, **look),
            prisms_of(lanterns, tops, tops + 0.15, STEEL, **look),
        ]
    )


def signs(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Plates across the border's direction on thin posts."""
    centres, yaws = scattered(sites, style.signs, (1.3, 2.2), rng)
    sides = 0.6 + 0.4 * rng.random(len(centres))
    posts = placed(ellipse(0.08, 0.08), centres, yaws)
    plates = boxes(centres, yaws, 0.03, sides)
    return join(
        [
            prisms_of(posts, 0.0, 2.0, STEEL, materials=materials.STEEL),
            prisms_of(
                plates,
                2.0,
                2.0 + sides,
                RETROREFLECTOR,
                materials=materials.graded("sign", (sides - 0.6) / 0.4),
                headings=yaws,
            ),
        ]
    )
