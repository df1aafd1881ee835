"""What a road tunnel is made of: walls with niches, a ceiling, lamps.

Measures follow common European practice for a rectangular section (headroom of at least 4.5 m,
kerb strips of about a metre, emergency niches every 100 to 150 m): smooth concrete, which reflects
0.35 at 905 nm.
"""

from __future__ import annotations

import numpy as np

from roadscope.envs.world import materials
from roadscope.envs.world.borders import Sites
from roadscope.envs.world.furniture import CONCRETE, STEEL
from roadscope.envs.world.style import Style
from roadscope.envs.world.things import Batch, boxes, join, prisms_of, ribbon, stretches

WALL_M = 1.0
"""From the border to the face of a wall."""
BACK_M = 2.5
"""From the border to where the rock is supposed to begin."""
NICHE_M = 1.2
"""Depth of a niche."""
CEILING_M, ROOF_M = 5.0, 5.6
"""Height of the ceiling, and of what lies on it."""
OVER_LANES_M = 5.75
"""How far a ceiling reaches inwards; from both borders it covers up to three lanes."""
LAMP_SLOT = 3
"""Pieces of border for each lamp: 12 m."""


def tunnel_walls(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Raise smooth walls to the ceiling; where a niche is, a piece of them stands farther back."""
    sites = sites.select(stretches(sites, style.tunnel_wall, rng))
    lengths = np.linalg.norm(sites.ends - sites.starts, axis=1)
    niche = rng.random(len(sites)) < style.niches * lengths
    look = {"materials": materials.CONCRETE}
    plain, behind = sites.select(~niche), sites.select(niche)
    back = WALL_M + NICHE_M
    walls = prisms_of(ribbon(plain, WALL_M, BACK_M - WALL_M), 0.0, CEILING_M, CONCRETE, **look)
    niches = prisms_of(ribbon(behind, back, BACK_M - back), 0.0, CEILING_M, CONCRETE, **look)
    return join([walls, niches._replace(owners=len(plain) + niches.owners)])


def ceilings(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Lay slabs over the lanes next to a border; none where the road bends sharply."""
    sites = sites.select(stretches(sites, style.ceiling, rng) & sites.straight)
    slabs = ribbon(sites, -OVER_LANES_M, OVER_LANES_M + BACK_M)
    return prisms_of(slabs, CEILING_M, ROOF_M, CONCRETE, materials=materials.CONCRETE)


def tunnel_lamps(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Hang a row of lamps along each wall, below the ceiling."""
    sites = sites.select(sites.slots % LAMP_SLOT == 0)
    sites = sites.select(rng.random(len(sites)) < style.tunnel_lamps)
    lamps = boxes(sites.middles + 0.6 * sites.normals, sites.yaws, 1.2, 0.3)
    return prisms_of(lamps, CEILING_M - 0.45, CEILING_M - 0.2, STEEL, materials=materials.STEEL)
