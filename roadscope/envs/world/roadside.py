"""Things beside a road; they depend on the road, the style and the seed only."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from roadscope.core import WEATHER, Category
from roadscope.core.bounds import Bounds
from roadscope.envs.traffic.road_maps import RoadMap
from roadscope.envs.world import materials
from roadscope.envs.world.bodies import body_prisms
from roadscope.envs.world.borders import (
    SITE_M,
    LaneDistances,
    Sites,
    border_sites,
    without_duplicates,
)
from roadscope.envs.world.materials import graded
from roadscope.envs.world.prisms import Prisms, ellipse, placed
from roadscope.envs.world.road_memo import cached_per_road
from roadscope.envs.world.style import STYLES, Style, find_style
from roadscope.envs.world.things import (
    ThingPrisms,
    boxes,
    join,
    prisms_of,
    ribbon,
    scatter_beside,
    stretches,
)

# --------------------------------------------------------------------------------------------------
# Guard rails, noise walls, lamps and signs.

STEEL = 0.4
CONCRETE = 0.35
RETROREFLECTOR = 1.0
RAIL_M = 0.8
"""From the border to the face of a guard rail."""
NOISE_WALL_M = 4.5
"""From the border to the face of a noise wall."""


def guard_rails(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return beams 0.45 to 0.75 m above the ground, with one post for each piece of border."""
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


def noise_walls(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return concrete walls 3.5 m high along stretches of the border."""
    sites = sites.select(stretches(sites, style.noise_wall, rng))
    return prisms_of(
        ribbon(sites, NOISE_WALL_M, 0.2), 0.0, 3.5, CONCRETE, materials=materials.CONCRETE
    )


def lamps(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return lamp posts whose lanterns do not hang over a lane."""
    centres, yaws = scatter_beside(sites, style.lamps, Bounds(1.3, 1.8), rng)
    tops = 6.0 + 4.0 * rng.random(len(centres))
    posts = placed(ellipse(0.18, 0.18), centres, yaws)
    lanterns = boxes(centres, yaws, 0.6, 0.25)
    surface = {"materials": materials.STEEL}
    return join(
        [
            prisms_of(posts, 0.0, tops, STEEL, **surface),
            prisms_of(lanterns, tops, tops + 0.15, STEEL, **surface),
        ]
    )


def signs(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return signs on thin posts, perpendicular to the border."""
    centres, yaws = scatter_beside(sites, style.signs, Bounds(1.3, 2.2), rng)
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


# --------------------------------------------------------------------------------------------------
# Buildings and parked cars.

PLASTER = Bounds(0.3, 0.7)
"""Reflectivity of facades, dark brick to white plaster, at 905 nm."""
BUILDING_SLOT = 6
"""Pieces of border for each building: 24 m."""
PARKING_SLOT = 2
"""Pieces of border for each parked car: 8 m."""
MODELS = 32
"""Number of different parked cars."""
WIDEST_M = 1.88
"""Greatest width of a parked car."""
PARKED_SALT = 0x43617273
"""Keeps the random numbers of parked cars apart from others."""


def buildings(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return blocks of two to six floors, with a smaller top floor."""
    sites = sites.select(sites.straight & (sites.slots % BUILDING_SLOT == BUILDING_SLOT // 2))
    front, side, depth, floors, paint, chance = rng.random((6, len(sites)))
    near, far = style.building_setback_m
    lengths = (0.55 + 0.37 * side) * BUILDING_SLOT * SITE_M
    depths = 8.0 + 6.0 * depth
    offsets = near + (far - near) * front + depths / 2
    taken = chance < style.buildings
    centres = (sites.middles + offsets[:, None] * sites.normals)[taken]
    yaws, lengths, depths = sites.yaws[taken], lengths[taken], depths[taken]
    tops = 3.0 * (2 + np.floor(5 * floors[taken]))
    shades = PLASTER.low + (PLASTER.high - PLASTER.low) * paint[taken]
    surface = {"materials": graded("facade", paint[taken]), "headings": yaws}
    return join(
        [
            prisms_of(boxes(centres, yaws, lengths, depths), 0.0, tops, shades, **surface),
            prisms_of(
                boxes(centres, yaws, lengths - 2, depths - 2), tops, tops + 2.5, shades, **surface
            ),
        ]
    )


def parked_cars(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return cars at the kerb, half a metre from the lane."""
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


def _standing(body: Prisms, centre: np.ndarray, yaw: float, thing: int) -> ThingPrisms:
    count = len(body)
    outlines = placed(body.footprints, np.tile(centre, (count, 1)), np.full(count, yaw))
    return ThingPrisms(
        outlines,
        body.corners,
        body.bottoms,
        body.tops,
        np.full(count, thing),
        body.extinctions,
        body.reflectivities,
        body.materials,
        body.headings + yaw,
    )


@lru_cache(maxsize=MODELS)
def _model(number: int) -> Prisms:
    """Return the body of a parked car: about as large as a small family car, with some paint."""
    rng = np.random.default_rng([PARKED_SALT, number])
    size = np.array([4.4, WIDEST_M - 0.08, 1.5]) + rng.uniform(-1, 1, 3) * (0.5, 0.08, 0.08)
    return body_prisms(Category.CAR, size, rng)


# --------------------------------------------------------------------------------------------------
# Trees, bushes and hedges: rays may pass through them.

LEAF_PROJECTION = 0.5
"""Mean projected area of a leaf over its area, for leaves in all directions."""
TREE_LAD = Bounds(0.5, 1.5)
BUSH_LAD = Bounds(2.0, 4.0)
HEDGE_LAD = Bounds(5.0, 8.0)
"""Leaf area densities, m^2 of leaves in each m^3; chosen by hand."""
LEAF = 0.45
BARK = 0.3
"""Reflectivities at 905 nm; chosen by hand."""


def trees(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return trees: a trunk, and a crown of two steps."""
    centres, yaws = scatter_beside(sites, style.trees, style.tree_band_m, rng)
    height, spread, trunk, lad = rng.random((4, len(centres)))
    tops = 5.0 + 7.0 * height
    # A crown stays clear of the lane beside it, so street trees are slender.
    radii = np.minimum((0.18 + 0.12 * spread) * tops, style.tree_band_m.low - 1.0)
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


def bushes(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return bushes, half a metre to two metres high and wide."""
    centres, yaws = scatter_beside(sites, style.bushes, style.bush_band_m, rng)
    length, width, height, lad = rng.random((4, len(centres)))
    outlines = _round(centres, yaws, 0.25 + 0.75 * length, 0.25 + 0.75 * width)
    return prisms_of(
        outlines,
        0.0,
        0.5 + 1.5 * height,
        LEAF,
        _extinction(BUSH_LAD, lad),
        materials=materials.graded("leaves", lad),
    )


def hedges(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return clipped hedges along stretches of the border."""
    sites = sites.select(stretches(sites, style.hedge, rng))
    height, lad = rng.random((2, len(sites)))
    outlines = ribbon(sites, style.bush_band_m.low + 1.0, 0.8)
    return prisms_of(
        outlines,
        0.0,
        1.0 + 0.3 * height,
        LEAF,
        _extinction(HEDGE_LAD, lad),
        materials=materials.first_of("leaves"),
    )


def _round(
    centres: np.ndarray, yaws: np.ndarray, radii_x: np.ndarray, radii_y: np.ndarray
) -> np.ndarray:
    """Return (m, 8, 2) outlines of ellipses."""
    sizes = np.stack([radii_x, radii_y], axis=-1)
    return placed(ellipse(2.0, 2.0) * sizes[:, None, :], centres, yaws)


def _extinction(density: Bounds, draw: np.ndarray) -> np.ndarray:
    result: np.ndarray = LEAF_PROJECTION * (density.low + (density.high - density.low) * draw)
    return result


# --------------------------------------------------------------------------------------------------
# Road tunnels: walls with niches, a ceiling, lamps.

TUNNEL_WALL_M = 1.0
"""From the border to the face of a wall."""
BACK_M = 2.5
"""From the border to the back of the wall; behind it is rock."""
NICHE_M = 1.2
"""Depth of a niche."""
CEILING_M, ROOF_M = 5.0, 5.6
"""Height of the ceiling and of its upper side."""
OVER_LANES_M = 5.75
"""How far a ceiling reaches inwards; from both borders it covers up to three lanes."""
LAMP_SLOT = 3
"""Pieces of border for each lamp: 12 m."""


def tunnel_walls(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return smooth walls up to the ceiling; at a niche the wall stands farther back."""
    sites = sites.select(stretches(sites, style.tunnel_wall, rng))
    lengths = np.linalg.norm(sites.ends - sites.starts, axis=1)
    niche = rng.random(len(sites)) < style.niches * lengths
    surface = {"materials": materials.CONCRETE}
    plain, behind = sites.select(~niche), sites.select(niche)
    back = TUNNEL_WALL_M + NICHE_M
    walls = prisms_of(
        ribbon(plain, TUNNEL_WALL_M, BACK_M - TUNNEL_WALL_M), 0.0, CEILING_M, CONCRETE, **surface
    )
    niches = prisms_of(ribbon(behind, back, BACK_M - back), 0.0, CEILING_M, CONCRETE, **surface)
    return join([walls, niches._replace(owners=len(plain) + niches.owners)])


def ceilings(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return slabs over the lanes next to a border; none where the road bends sharply."""
    sites = sites.select(stretches(sites, style.ceiling, rng) & sites.straight)
    slabs = ribbon(sites, -OVER_LANES_M, OVER_LANES_M + BACK_M)
    return prisms_of(slabs, CEILING_M, ROOF_M, CONCRETE, materials=materials.CONCRETE)


def tunnel_lamps(sites: Sites, style: Style, rng: np.random.Generator) -> ThingPrisms:
    """Return a row of lamps along each wall, below the ceiling."""
    sites = sites.select(sites.slots % LAMP_SLOT == 0)
    sites = sites.select(rng.random(len(sites)) < style.tunnel_lamps)
    lamps = boxes(sites.middles + 0.6 * sites.normals, sites.yaws, 1.2, 0.3)
    return prisms_of(lamps, CEILING_M - 0.45, CEILING_M - 0.2, STEEL, materials=materials.STEEL)


# --------------------------------------------------------------------------------------------------
# All scenery of a road, made tile by tile.

__all__ = ["CLEARANCE_M", "KINDS", "OVERHEAD", "STYLES", "Scenery", "grow", "kinds_of", "off_lanes"]

Grower = Callable[[Sites, Style, np.random.Generator], ThingPrisms]

TILE_M = 50.0
REACH_M = 45.0
"""No thing extends farther than this from the border it belongs to."""
CLEARANCE_M = 0.3
"""Least distance between a thing's outline and the edge of any lane."""
BUILDING_CLEARANCE_M = 4.0
"""Least distance of a building from any lane: there is a pavement between them."""
CACHED_PLACES = 8
"""Number of cached results of `Scenery.around`."""
SALT = 0x526F6164
"""Keeps this stream of random numbers apart from others of the same seed."""
KINDS: Mapping[str, Grower] = MappingProxyType(
    {
        "guard_rail": guard_rails,
        "noise_wall": noise_walls,
        "lamps": lamps,
        "signs": signs,
        "trees": trees,
        "bushes": bushes,
        "hedge": hedges,
        "parked_cars": parked_cars,
        "buildings": buildings,
        "tunnel_wall": tunnel_walls,
        "ceiling": ceilings,
        "tunnel_lamps": tunnel_lamps,
    }
)
"""Every kind of thing, under the name of its density in `Style`."""
OVERHEAD = frozenset({"ceiling"})
"""Kinds that hang over lanes; all others keep off them."""
MOST_KINDS = 16
OBSTACLE_KIND = MOST_KINDS - 1
"""Kind of the obstacles of a timeline, which are not scenery of a style."""
MOST_THINGS = 512
"""Most things of a kind in a tile; further ones are left out."""


class Borders:
    """The outer borders of a road by tile; independent of style and seed."""

    def __init__(self, road: RoadMap) -> None:
        """Find the outer borders."""
        self.lanes = LaneDistances(road)
        sites = border_sites(road)
        sites = sites.select(self.lanes.outer(sites))
        sites = sites.select(without_duplicates(sites))
        tiles = np.floor(sites.middles / TILE_M).astype(np.int64).reshape(-1, 2)
        order = np.lexsort((tiles[:, 1], tiles[:, 0]))
        self.sites = sites.select(order)
        self.tiles, counts = np.unique(tiles[order], axis=0, return_counts=True)
        self.bounds = np.concatenate([[0], np.cumsum(counts)])

    def tile_sites(self, rank: int) -> Sites:
        """Return the pieces of border in the rank-th occupied tile."""
        return self.sites.select(np.arange(self.bounds[rank], self.bounds[rank + 1]))

    def tiles_near(self, tile: np.ndarray, radius_m: float) -> np.ndarray:
        """Return ranks of tiles whose things may come within the radius of some point of a tile."""
        gaps = np.maximum(np.abs(self.tiles - tile) - 1, 0) * TILE_M
        return np.flatnonzero(np.hypot(gaps[:, 0], gaps[:, 1]) <= radius_m + REACH_M)


class Scenery:
    """The things beside a road; tiles are created on first use and kept."""

    def __init__(self, road: RoadMap, style: str, seed: int) -> None:
        """Prepare the scenery of a road in a style; nothing is created yet."""
        self._style = find_style(style)
        self._borders = _borders(road)
        self._seed = int(seed)
        self._tiles: dict[int, Prisms] = {}
        self._places: dict[tuple[int, int, float], Prisms] = {}

    def around(self, position: np.ndarray, radius_m: float = 200.0) -> Prisms:
        """Return at least all prisms within the radius of an (x, y) position, world frame.

        Owners are -2 and below, one for each thing, the same in every call. Calls from the same
        tile return the same object.
        """
        tile = np.floor(np.asarray(position, np.float64)[:2] / TILE_M).astype(np.int64)
        key = (int(tile[0]), int(tile[1]), float(radius_m))
        if key not in self._places:
            if len(self._places) >= CACHED_PLACES:
                del self._places[next(iter(self._places))]
            ranks = self._borders.tiles_near(tile, radius_m)
            self._places[key] = Prisms.join([self._tile(int(rank)) for rank in ranks])
        return self._places[key]

    def along(self, path: np.ndarray, radius_m: float = 200.0) -> Prisms:
        """Return at least all prisms within the radius of any of (K, 2) positions."""
        tiles = np.unique(np.floor(np.asarray(path)[:, :2] / TILE_M).astype(np.int64), axis=0)
        near = [self._borders.tiles_near(tile, radius_m) for tile in tiles]
        ranks = np.unique(np.concatenate([np.empty(0, np.int64), *near]))
        return Prisms.join([self._tile(int(rank)) for rank in ranks])

    def _tile(self, rank: int) -> Prisms:
        if rank not in self._tiles:
            self._tiles[rank] = self._grow(rank)
        return self._tiles[rank]

    def _grow(self, rank: int) -> Prisms:
        sites = self._borders.tile_sites(rank)
        # Seeds take no negative numbers: fold both halves of the plane into one.
        place = [2 * t if t >= 0 else -2 * t - 1 for t in map(int, self._borders.tiles[rank])]
        streams = np.random.SeedSequence([SALT, self._seed, *place]).spawn(len(KINDS))
        things, clearances_m = [], [np.empty(0)]
        for number, (name, kind) in enumerate(KINDS.items()):
            if getattr(self._style, name) == 0.0:
                continue
            grown = kind(sites, self._style, np.random.default_rng(streams[number]))
            grown = grown.select(grown.owners < MOST_THINGS)
            first = (rank * MOST_KINDS + number) * MOST_THINGS
            things.append(grown._replace(owners=-2 - first - grown.owners))
            clearances_m.append(np.full(len(grown.owners), _clearance_m(name)))
        joined = join(things)
        clear = off_lanes(joined, self._borders.lanes, np.concatenate(clearances_m))
        return Prisms(*joined.select(clear))


def grow(road: RoadMap, path: np.ndarray, style: str, rng: np.random.Generator) -> Prisms:
    """Return the scenery within 200 m of a (K, 2) path, world frame, owners -2 and below."""
    return Scenery(road, style, int(rng.integers(2**63))).along(path)


def kinds_of(owners: np.ndarray) -> np.ndarray:
    """Return (M,) indices into `KINDS` of owners; -1 for owners that are not scenery.

    Obstacles on the road have `OBSTACLE_KIND`.
    """
    owners = np.asarray(owners, np.int64)
    grown = (owners <= -2) & (owners != WEATHER)
    return np.where(grown, (-2 - owners) // MOST_THINGS % MOST_KINDS, -1)


def off_lanes(
    things: ThingPrisms | Prisms,
    lanes: LaneDistances,
    clearances_m: np.ndarray | float = CLEARANCE_M,
) -> np.ndarray:
    """Return (M,) whether a prism belongs to a thing that keeps its clearance from all lanes.

    clearances_m: a number for all prisms or an (M,) array; -inf for those that may be anywhere.
    """
    near = lanes.clearances(things.footprints, clearances_m) < clearances_m
    return ~np.isin(things.owners, things.owners[near])


def _clearance_m(kind: str) -> float:
    if kind in OVERHEAD:
        return -np.inf
    return BUILDING_CLEARANCE_M if kind == "buildings" else CLEARANCE_M


@cached_per_road
def _borders(road: RoadMap) -> Borders:
    return Borders(road)
