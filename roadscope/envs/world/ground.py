"""What lies on the ground: road surface, lane markings, kerb and pavement, grass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.envs.traffic.road_map import RoadMap
from roadscope.envs.world.borders import (
    SITE_M,
    LaneIndex,
    Sites,
    border_sites,
    without_doubles,
)
from roadscope.envs.world.road_memo import once_a_road

PIECE_M = 12.0
"""Lanes are cut into straight pieces at most this long."""
TURN = 0.04
"""And turning by at most this much, radians."""
INSIDE_M = 0.35
"""A border this far inside another lane crosses it and bears no line."""
CUT_M = 1.0
"""Borders are looked at in pieces this long."""
CUTS = round(SITE_M / CUT_M)
BESIDE_M = 0.8
"""Pieces of borders whose middles are this close are one line."""
SHORTEST_M = 4.0
"""Shorter stretches of a line are left out."""
SHOULDERS_M: Mapping[str, float] = MappingProxyType(
    {
        "motorway": 2.0,
        "urban": 2.6,
        "town": 3.8,
        "campus": 2.0,
        "bare": 0.5,
        "barriers": 2.0,
        "tunnel": 1.0,
    }
)
"""Width of the strip beside the outermost lane, by roadside style."""
PAVED = frozenset({"urban", "town", "campus"})
"""Styles whose strip is a pavement behind a kerb; elsewhere it is asphalt."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface(Record):
    """Strips of road and the lines on them, world frame.

    strips: (N, 5) float64, start x y, end x y, half width: straight pieces of lanes, metres.
    lines: (M, 6) float64, start x y, end x y, way of the start along its border, 1 if dashed.
    """

    strips: np.ndarray
    lines: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, strips=(np.float64, ("N", 5)), lines=(np.float64, ("M", 6)))


@once_a_road
def surface_of(road: RoadMap) -> Surface:
    """Find the strips and lines of a road."""
    strips = [np.empty((0, 5))]
    for points, widths in road.lanes():
        if len(points) > 1:
            strips.append(_strips(points, widths))
    return Surface(np.concatenate(strips), _lines(road))


def _strips(points: np.ndarray, widths: np.ndarray) -> np.ndarray:
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    turned = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])), prepend=0.0))
    turned[0] = 0.0
    # A point is kept wherever the way or the turn since the last one is used up.
    used = np.cumsum(lengths / PIECE_M + turned / TURN)
    kept = np.flatnonzero(np.diff(np.floor(used), prepend=-1.0, append=np.inf))
    kept = np.unique(np.concatenate([[0], kept, [len(points) - 1]]))
    half = (widths[kept[:-1]] + widths[kept[1:]]) / 4
    return np.column_stack([points[kept[:-1]], points[kept[1:]], half])


def _lines(road: RoadMap) -> np.ndarray:
    sites = border_sites(road)
    if len(sites) == 0:
        return np.empty((0, 6))
    lanes = LaneIndex(road)
    outer = np.repeat(lanes.outer(sites), CUTS)
    single = np.repeat(without_doubles(sites), CUTS)
    pieces = _cut(sites)
    kept = single & ~lanes.within(pieces, INSIDE_M)
    kept = _long_enough(kept & ~_drawn_already(pieces, kept & ~outer), pieces)
    ways = pieces.slots * CUT_M
    lines = np.column_stack([pieces.starts, pieces.ends, ways, ~outer])
    result: np.ndarray = lines[kept]
    return result


def _cut(sites: Sites) -> Sites:
    """Cut every site into pieces of equal length."""
    shares = (np.arange(CUTS + 1) / CUTS)[None, :, None]

    def cuts(starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = starts[:, None] + shares * (ends - starts)[:, None]
        return points[:, :-1].reshape(-1, 2), points[:, 1:].reshape(-1, 2)

    slots = (CUTS * sites.slots[:, None] + np.arange(CUTS)).reshape(-1)
    return Sites(
        *cuts(sites.starts, sites.ends),
        *cuts(sites.start_normals, sites.end_normals),
        slots,
        np.repeat(sites.lanes, CUTS),
    )


def _drawn_already(pieces: Sites, shared: np.ndarray) -> np.ndarray:
    """(S,) bool, shared borders along which that of a lane of lower number runs too.

    Two lanes in opposite directions would else fill each other's gaps between dashes.
    """
    from scipy.spatial import cKDTree

    rows = np.flatnonzero(shared)
    taken = np.zeros(len(shared), bool)
    if len(rows) > 1:
        pairs = rows[cKDTree(pieces.middles[rows]).query_pairs(BESIDE_M, output_type="ndarray")]
        lanes = pieces.lanes[pairs]
        later = np.where(lanes[:, 0] > lanes[:, 1], pairs[:, 0], pairs[:, 1])
        taken[later[lanes[:, 0] // 2 != lanes[:, 1] // 2]] = True
    return taken


def _long_enough(kept: np.ndarray, pieces: Sites) -> np.ndarray:
    """Leave out stretches of kept pieces that are too short to be a line."""
    begins = np.ones(len(kept), bool)
    begins[1:] = (pieces.lanes[1:] != pieces.lanes[:-1]) | (kept[1:] != kept[:-1])
    stretches = np.cumsum(begins) - 1
    result: np.ndarray = kept & (np.bincount(stretches)[stretches] * CUT_M >= SHORTEST_M)
    return result
