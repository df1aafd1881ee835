"""The surface of the ground: road, lane markings, kerb and pavement, grass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.envs.traffic.road_maps import RoadMap
from roadscope.envs.world.borders import (
    SITE_M,
    LaneDistances,
    Sites,
    border_sites,
    without_duplicates,
)
from roadscope.envs.world.road_memo import cached_per_road

PIECE_M = 12.0
"""Lanes are cut into straight pieces at most this long."""
PIECE_TURN_RAD = 0.04
"""Such a piece turns by at most this much."""
INSIDE_M = 0.35
"""A border this far inside another lane has no line there."""
SPLIT_M = 1.0
"""Borders are split into pieces of this length."""
SPLITS = round(SITE_M / SPLIT_M)
BESIDE_M = 0.8
"""Pieces of borders whose middles are this close are the same line."""
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
    """Strips of road and the lines on them, world frame, metres.

    strips: (N, 5) float64, straight pieces of lanes: start x y, end x y, half width.
    lines: (M, 6) float64, pieces of lane markings: start x y, end x y, arc length of the start
        along its border, 1 if dashed.
    """

    strips: np.ndarray
    lines: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, strips=(np.float64, ("N", 5)), lines=(np.float64, ("M", 6)))


@cached_per_road
def surface_of(road: RoadMap) -> Surface:
    """Return the strips and lines of a road."""
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
    # Select a point where the length or the turn since the last one reaches its limit.
    used = np.cumsum(lengths / PIECE_M + turned / PIECE_TURN_RAD)
    selected = np.flatnonzero(np.diff(np.floor(used), prepend=-1.0, append=np.inf))
    selected = np.unique(np.concatenate([[0], selected, [len(points) - 1]]))
    half = (widths[selected[:-1]] + widths[selected[1:]]) / 4
    return np.column_stack([points[selected[:-1]], points[selected[1:]], half])


def _lines(road: RoadMap) -> np.ndarray:
    sites = border_sites(road)
    if len(sites) == 0:
        return np.empty((0, 6))
    lanes = LaneDistances(road)
    outer = np.repeat(lanes.outer(sites), SPLITS)
    single = np.repeat(without_duplicates(sites), SPLITS)
    pieces = _split(sites)
    selected = single & ~lanes.within(pieces, INSIDE_M)
    selected = _long_enough(selected & ~_drawn_already(pieces, selected & ~outer), pieces)
    arc_lengths = pieces.slots * SPLIT_M
    lines = np.column_stack([pieces.starts, pieces.ends, arc_lengths, ~outer])
    result: np.ndarray = lines[selected]
    return result


def _split(sites: Sites) -> Sites:
    """Cut every site into pieces of equal length."""
    shares = (np.arange(SPLITS + 1) / SPLITS)[None, :, None]

    def cuts(starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = starts[:, None] + shares * (ends - starts)[:, None]
        return points[:, :-1].reshape(-1, 2), points[:, 1:].reshape(-1, 2)

    slots = (SPLITS * sites.slots[:, None] + np.arange(SPLITS)).reshape(-1)
    return Sites(
        *cuts(sites.starts, sites.ends),
        *cuts(sites.start_normals, sites.end_normals),
        slots,
        np.repeat(sites.lanes, SPLITS),
    )


def _drawn_already(pieces: Sites, shared: np.ndarray) -> np.ndarray:
    """Return (S,) whether a shared border coincides with that of a lane of lower number.

    Otherwise the dashes of two lanes in opposite directions would fill each other's gaps.
    """
    from scipy.spatial import cKDTree

    rows = np.flatnonzero(shared)
    drawn = np.zeros(len(shared), bool)
    if len(rows) > 1:
        pairs = rows[cKDTree(pieces.middles[rows]).query_pairs(BESIDE_M, output_type="ndarray")]
        lanes = pieces.lanes[pairs]
        later = np.where(lanes[:, 0] > lanes[:, 1], pairs[:, 0], pairs[:, 1])
        drawn[later[lanes[:, 0] // 2 != lanes[:, 1] // 2]] = True
    return drawn


def _long_enough(selected: np.ndarray, pieces: Sites) -> np.ndarray:
    """Return (S,) whether a piece is selected and its stretch is long enough for a line."""
    begins = np.ones(len(selected), bool)
    begins[1:] = (pieces.lanes[1:] != pieces.lanes[:-1]) | (selected[1:] != selected[:-1])
    stretches = np.cumsum(begins) - 1
    result: np.ndarray = selected & (np.bincount(stretches)[stretches] * SPLIT_M >= SHORTEST_M)
    return result
