"""What grows beside a road: the same for the same road, style and seed, wherever one drives.

The plane is cut into tiles. What stands beside the borders in a tile is drawn from the seed and
the tile alone, and tiles are made when somebody comes near, so a 10 km motorway costs what is
seen of it, and a live environment sees what a recording of it sees.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from roadscope.core import WEATHER
from roadscope.envs.traffic.road_map import RoadMap
from roadscope.envs.world.borders import LaneIndex, Sites, border_sites, without_doubles
from roadscope.envs.world.furniture import guard_rails, lamps, noise_walls, signs
from roadscope.envs.world.neighbourhood import buildings, parked_cars
from roadscope.envs.world.prisms import Prisms
from roadscope.envs.world.road_memo import once_a_road
from roadscope.envs.world.style import STYLES, Style, style_named
from roadscope.envs.world.things import Batch, join
from roadscope.envs.world.tunnel import ceilings, tunnel_lamps, tunnel_walls
from roadscope.envs.world.vegetation import bushes, hedges, trees

__all__ = ["CLEARANCE_M", "KINDS", "OVERHEAD", "STYLES", "Scenery", "grow", "kinds_of", "off_lanes"]

Grower = Callable[[Sites, Style, np.random.Generator], Batch]

TILE_M = 50.0
REACH_M = 45.0
"""No thing extends farther than this from the border it belongs to."""
CLEARANCE_M = 0.3
"""Least distance between a thing's outline and the edge of any lane."""
BUILDING_CLEARANCE_M = 4.0
"""The same for a building, which leaves room for a pavement."""
PLACES = 8
"""Answers kept for the next call."""
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
"""Kind of what a timeline says stands on the road; nothing grown."""
MOST_THINGS = 512
"""Most things of a kind in a tile; what a denser network would add is left out."""


class Borders:
    """The outer borders of a road by tile; independent of style and seed."""

    def __init__(self, road: RoadMap) -> None:
        """Find the outer borders."""
        self.lanes = LaneIndex(road)
        sites = border_sites(road)
        sites = sites.select(self.lanes.outer(sites))
        sites = sites.select(without_doubles(sites))
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
    """The things beside a road; tiles are made on first use and kept."""

    def __init__(self, road: RoadMap, style: str, seed: int) -> None:
        """Take the road, the name of a style and the seed."""
        self._style = style_named(style)
        self._borders = _borders(road)
        self._seed = int(seed)
        self._tiles: dict[int, Prisms] = {}
        self._places: dict[tuple[int, int, float], Prisms] = {}

    def around(self, position: np.ndarray, radius_m: float = 200.0) -> Prisms:
        """Return at least all prisms within the radius of an (x, y) position, world frame.

        Owners are -2 and below, one per thing, the same whoever asks. Calls from the same tile
        return the same object.
        """
        tile = np.floor(np.asarray(position, np.float64)[:2] / TILE_M).astype(np.int64)
        key = (int(tile[0]), int(tile[1]), float(radius_m))
        if key not in self._places:
            if len(self._places) >= PLACES:
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
        things = []
        for number, (name, kind) in enumerate(KINDS.items()):
            if getattr(self._style, name) == 0.0:
                continue
            grown = kind(sites, self._style, np.random.default_rng(streams[number]))
            grown = grown.select(grown.owners < MOST_THINGS)
            if name not in OVERHEAD:
                grown = grown.select(off_lanes(grown, self._borders.lanes, _clearance_m(name)))
            first = (rank * MOST_KINDS + number) * MOST_THINGS
            things.append(grown._replace(owners=-2 - first - grown.owners))
        return Prisms(*join(things))


def grow(road: RoadMap, path: np.ndarray, style: str, rng: np.random.Generator) -> Prisms:
    """Return what stands within 200 m of a (K, 2) path, world frame, owners -2 and below."""
    return Scenery(road, style, int(rng.integers(2**63))).along(path)


def kinds_of(owners: np.ndarray) -> np.ndarray:
    """(M,) int64 index into `KINDS` of what each owner is; -1 for all that is no scenery.

    Obstacles on the road, which do not grow, are `OBSTACLE_KIND`.
    """
    owners = np.asarray(owners, np.int64)
    grown = (owners <= -2) & (owners != WEATHER)
    return np.where(grown, (-2 - owners) // MOST_THINGS % MOST_KINDS, -1)


def off_lanes(
    things: Batch | Prisms, lanes: LaneIndex, clearance_m: float = CLEARANCE_M
) -> np.ndarray:
    """(M,) bool: prisms of things that keep off every lane strip with their whole outline."""
    near = lanes.clearances(things.footprints, clearance_m) < clearance_m
    return ~np.isin(things.owners, things.owners[near])


def _clearance_m(kind: str) -> float:
    return BUILDING_CLEARANCE_M if kind == "buildings" else CLEARANCE_M


@once_a_road
def _borders(road: RoadMap) -> Borders:
    return Borders(road)
