"""Trees, bushes and hedges: what rays can pass through.

Foliage follows the Beer-Lambert law with extinction G x LAD (Ross 1981): leaf area density LAD
times G = 0.5 for leaves that face all ways. Crowns of street trees have 0.5 to 1.5 m2/m3,
shrubs 2 to 4, clipped hedges 5 to 8. Green leaves reflect 0.45 to 0.5 in the near infrared,
bark 0.3 (USGS spectral library). All set from these meanings; no detector's result moved them.
"""

from __future__ import annotations

import numpy as np

from roadscope.envs.world import materials
from roadscope.envs.world.borders import Sites
from roadscope.envs.world.footprints import ellipse, placed
from roadscope.envs.world.style import Style
from roadscope.envs.world.things import Batch, join, prisms_of, ribbon, scattered, stretches

LEAF_PROJECTION = 0.5
TREE_LAD = (0.5, 1.5)
BUSH_LAD = (2.0, 4.0)
HEDGE_LAD = (5.0, 8.0)
LEAF = 0.45
BARK = 0.3


def trees(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Trunk, and a crown of two steps."""
    centres, yaws = scattered(sites, style.trees, style.tree_band_m, rng)
    height, spread, trunk, lad = rng.random((4, len(centres)))
    tops = 5.0 + 7.0 * height
    # A crown stays clear of the lane beside it, so street trees are slender.
    radii = np.minimum((0.18 + 0.12 * spread) * tops, style.tree_band_m[0] - 1.0)
    bottoms = np.maximum(0.3 * tops, 2.2)
    extinction = _extinction(TREE_LAD, lad)
    leaves = materials.graded("leaves", spread)
    stems = _round(centres, yaws, 0.12 + 0.18 * trunk, 0.12 + 0.18 * trunk)
    return join(
        [
            prisms_of(stems, 0.0, bottoms, BARK, materials=materials.BARK),
            prisms_of(
                _round(centres, yaws, radii, radii),
                bottoms,
                0.8 * tops,
                LEAF,
                extinction,
                materials=leaves,
            ),
            prisms_of(
                _round(centres, yaws, 0.6 * radii, 0.6 * radii),
                0.8 * tops,
                tops,
                LEAF,
                extinction,
                materials=leaves,
            ),
        ]
    )


def bushes(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Shrubs half a metre to two metres high and wide."""
    centres, yaws = scattered(sites, style.bushes, style.bush_band_m, rng)
    length, width, height, lad = rng.random((4, len(centres)))
    outlines = _round(centres, yaws, 0.25 + 0.75 * length, 0.25 + 0.75 * width)
    return prisms_of(
        outlines, 0.0, 0.5 + 1.5 * height, LEAF, _extinction(BUSH_LAD, lad),
        materials=materials.graded("leaves", lad),
    )  # fmt: skip


def hedges(sites: Sites, style: Style, rng: np.random.Generator) -> Batch:
    """Clipped hedges along stretches of the border."""
    sites = sites.select(stretches(sites, style.hedge, rng))
    height, lad = rng.random((2, len(sites)))
    outlines = ribbon(sites, style.bush_band_m[0] + 1.0, 0.8)
    return prisms_of(
        outlines, 0.0, 1.0 + 0.3 * height, LEAF, _extinction(HEDGE_LAD, lad),
        materials=materials.first_of("leaves"),
    )  # fmt: skip


def _round(
    centres: np.ndarray, yaws: np.ndarray, radii_x: np.ndarray, radii_y: np.ndarray
) -> np.ndarray:
    """(m, 8, 2) outlines of ellipses."""
    sizes = np.stack([radii_x, radii_y], axis=-1)
    return placed(ellipse(2.0, 2.0) * sizes[:, None, :], centres, yaws)


def _extinction(density: tuple[float, float], draw: np.ndarray) -> np.ndarray:
    result: np.ndarray = LEAF_PROJECTION * (density[0] + (density[1] - density[0]) * draw)
    return result
