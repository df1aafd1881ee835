"""Densities of things beside a road, by style."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from roadscope.core import RecordError
from roadscope.core.bounds import Bounds
from roadscope.core.names import unknown

TREE_BAND_M, BUSH_BAND_M, BUILDING_SETBACK_M = (
    Bounds(5.0, 12.0),
    Bounds(1.5, 5.0),
    Bounds(8.0, 14.0),
)
"""Usual distances from the border, see `Style`; chosen by hand."""


@dataclass(frozen=True)
class Style:
    """Things beside an outer border of the road.

    guard_rail, noise_wall, hedge, tunnel_wall, ceiling: share of the border that each runs along,
        0 to 1.
    lamps, signs, trees, bushes, niches: number per metre of border; niches are in tunnel walls.
    parked_cars, buildings, tunnel_lamps: share of the slots along the border that are taken, 0 to
        1.
    tree_band_m, bush_band_m: nearest and farthest distance of their centres from the border.
    building_setback_m: from the border to the front of a building.
    """

    guard_rail: float = 0.0
    noise_wall: float = 0.0
    hedge: float = 0.0
    lamps: float = 0.0
    signs: float = 0.0
    trees: float = 0.0
    bushes: float = 0.0
    parked_cars: float = 0.0
    buildings: float = 0.0
    tunnel_wall: float = 0.0
    ceiling: float = 0.0
    tunnel_lamps: float = 0.0
    niches: float = 0.0
    tree_band_m: Bounds = TREE_BAND_M
    bush_band_m: Bounds = BUSH_BAND_M
    building_setback_m: Bounds = BUILDING_SETBACK_M


STYLES: Mapping[str, Style] = MappingProxyType(
    {
        "motorway": Style(
            guard_rail=0.9,
            noise_wall=0.2,
            lamps=0.01,
            signs=0.006,
            trees=0.03,
            bushes=0.02,
            tree_band_m=Bounds(9.0, 25.0),
            bush_band_m=Bounds(3.0, 8.0),
        ),
        "urban": Style(
            hedge=0.1,
            lamps=0.03,
            signs=0.015,
            trees=0.025,
            bushes=0.01,
            parked_cars=0.25,
            buildings=0.75,
            tree_band_m=Bounds(3.8, 5.0),
            bush_band_m=Bounds(3.5, 6.0),
        ),
        "town": Style(
            hedge=0.1,
            lamps=0.03,
            signs=0.015,
            trees=0.025,
            buildings=0.75,
            tree_band_m=Bounds(4.2, 5.4),
            bush_band_m=Bounds(3.9, 6.0),
            building_setback_m=Bounds(7.0, 12.0),
        ),
        "campus": Style(
            hedge=0.08,
            lamps=0.02,
            signs=0.006,
            trees=0.04,
            bushes=0.08,
            buildings=0.25,
            tree_band_m=Bounds(5.0, 14.0),
            building_setback_m=Bounds(15.0, 25.0),
        ),
        "bare": Style(),
        "barriers": Style(noise_wall=1.0, signs=0.003),
        "tunnel": Style(tunnel_wall=1.0, ceiling=1.0, tunnel_lamps=0.95, niches=0.01),
    }
)
"""In `town` no cars park on the pavements, where people walk. `barriers` and `tunnel` have few
features that distinguish places along the road. Chosen by hand from how such roads look, not from
results of detectors."""


def find_style(name: str) -> Style:
    """Return the style of that name; raise `RecordError` with the known names for any other."""
    if name not in STYLES:
        raise RecordError(unknown("roadside style", name, STYLES))
    return STYLES[name]
