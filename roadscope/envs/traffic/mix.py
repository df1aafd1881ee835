"""Mixes of road users for kinds of places, with published outer dimensions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.envs.traffic.timeline import Timeline


class Size(NamedTuple):
    """Outer dimensions of a road user."""

    length_m: float
    width_m: float
    height_m: float


@dataclass(frozen=True, slots=True)
class RoadUserBody:
    """Category and outer dimensions of a road user."""

    category: Category
    size: Size


# Length, width without mirrors and height as the makers' data sheets give them.
CARS: tuple[Size, ...] = (
    Size(3.571, 1.627, 1.488),  # Fiat 500 (2016)
    Size(4.050, 1.798, 1.440),  # Renault Clio V
    Size(4.074, 1.751, 1.451),  # Volkswagen Polo VI
    Size(4.284, 1.789, 1.456),  # Volkswagen Golf 8
    Size(4.370, 1.790, 1.435),  # Toyota Corolla hatchback (E210)
    Size(4.509, 1.839, 1.675),  # Volkswagen Tiguan II
    Size(4.600, 1.855, 1.685),  # Toyota RAV4 (XA50)
    Size(4.689, 1.829, 1.468),  # Skoda Octavia IV estate
    Size(4.694, 1.849, 1.443),  # Tesla Model 3
    Size(4.709, 1.827, 1.442),  # BMW 3 Series (G20)
    Size(4.939, 1.886, 1.457),  # Audi A6 (C8)
)
VANS: tuple[Size, ...] = (
    Size(4.500, 1.855, 1.797),  # Volkswagen Caddy V
    Size(4.904, 1.904, 1.990),  # Volkswagen Transporter T6.1
    Size(5.413, 2.050, 2.524),  # Fiat Ducato L2H2
    Size(5.932, 2.020, 2.638),  # Mercedes-Benz Sprinter (907), standard length, high roof
)
LIGHT_TRUCKS: tuple[Size, ...] = (
    Size(6.000, 2.140, 2.900),  # box body on a Fuso Canter 7C15 class chassis
    Size(7.500, 2.500, 3.400),  # box body on a Mercedes-Benz Atego 818 class chassis
    Size(8.600, 2.550, 3.600),  # box body on a MAN TGL 12.220 class chassis
)
# The longest that Directive 96/53/EC, annex I, allows: rigid and articulated.
HEAVY_TRUCKS: tuple[Size, ...] = (Size(12.000, 2.550, 3.800), Size(16.500, 2.550, 4.000))
BUSES: tuple[Size, ...] = (
    Size(10.633, 2.550, 3.120),  # Mercedes-Benz Citaro K
    Size(12.135, 2.550, 3.120),  # Mercedes-Benz Citaro
)
# Height with a seated rider.
MOTORCYCLES: tuple[Size, ...] = (
    Size(1.852, 0.735, 1.650),  # Vespa Primavera 125
    Size(2.085, 0.780, 1.700),  # Yamaha MT-07
    Size(2.207, 0.952, 1.800),  # BMW R 1250 GS
)

EGO = RoadUserBody(Category.CAR, Size(5.0, 1.9, 1.5))
"""A saloon as long as highway-env's vehicles (a BMW 5 Series, G60, is 5.060 x 1.900 x 1.515)."""


class MixPart(NamedTuple):
    """One category in a mix of traffic: its share and the sizes to choose from."""

    category: Category
    share: float
    sizes: tuple[Size, ...]


MIXES: Mapping[str, tuple[MixPart, ...]] = MappingProxyType(
    {
        "motorway": (
            MixPart(Category.CAR, 0.66, CARS),
            MixPart(Category.VAN, 0.13, VANS),
            MixPart(Category.TRUCK, 0.14, (*LIGHT_TRUCKS, *HEAVY_TRUCKS)),
            MixPart(Category.BUS, 0.03, BUSES[1:]),
            MixPart(Category.MOTORCYCLE, 0.04, MOTORCYCLES[1:]),
        ),
        "urban": (
            MixPart(Category.CAR, 0.70, CARS),
            MixPart(Category.VAN, 0.14, VANS),
            MixPart(Category.TRUCK, 0.05, LIGHT_TRUCKS[:2]),
            MixPart(Category.BUS, 0.04, BUSES),
            MixPart(Category.MOTORCYCLE, 0.07, MOTORCYCLES),
        ),
        "tight": (
            MixPart(Category.CAR, 0.76, CARS),
            MixPart(Category.VAN, 0.14, VANS),
            MixPart(Category.TRUCK, 0.03, LIGHT_TRUCKS[:1]),
            MixPart(Category.MOTORCYCLE, 0.07, MOTORCYCLES),
        ),
        "parked": (MixPart(Category.CAR, 0.88, CARS), MixPart(Category.VAN, 0.12, VANS[:2])),
        "convoy": (
            MixPart(Category.CAR, 0.38, CARS),
            MixPart(Category.VAN, 0.25, VANS[1:]),
            MixPart(Category.TRUCK, 0.27, (*LIGHT_TRUCKS, *HEAVY_TRUCKS)),
            MixPart(Category.BUS, 0.10, BUSES),
        ),
        "foreign": (
            MixPart(Category.CAR, 0.72, CARS),
            MixPart(Category.VAN, 0.13, VANS),
            MixPart(Category.TRUCK, 0.07, LIGHT_TRUCKS),
            MixPart(Category.BUS, 0.03, BUSES),
            MixPart(Category.MOTORCYCLE, 0.05, MOTORCYCLES),
        ),
    }
)
"""Categories, shares and sizes by kind of place; the shares are chosen by hand."""


def draw_body(mix: str, rng: np.random.Generator) -> RoadUserBody:
    """Draw a road user from a mix named in `MIXES`."""
    parts = MIXES[mix]
    part = parts[int(rng.choice(len(parts), p=[each.share for each in parts]))]
    return RoadUserBody(part.category, part.sizes[int(rng.integers(len(part.sizes)))])


# --------------------------------------------------------------------------------------------------
# Vehicles with shapes that no detector of the package was trained on.

UNSEEN: Mapping[Category, Mapping[str, Size]] = MappingProxyType(
    {
        Category.CAR: {"tall-box": Size(3.395, 1.475, 1.790), "pickup": Size(4.480, 1.732, 1.577)},
        Category.VAN: {"dropside": Size(4.220, 1.680, 1.920), "camper": Size(5.350, 2.010, 2.750)},
        Category.TRUCK: {
            "flatbed": Size(5.900, 2.100, 2.300),
            "tanker": Size(8.400, 2.500, 3.200),
            "tank-trailer": Size(16.000, 2.550, 3.600),
            "long-flatbed": Size(11.800, 2.540, 3.000),
        },
        Category.BUS: {"double-decker": Size(10.500, 2.520, 4.300)},
    }
)
"""Sizes of such vehicles, typical ones, rounded; chosen by hand. `world.bodies` builds a special
body for each of these sizes, and no mix contains them."""
SALT = 0x556E7365
"""Keeps this stream of random numbers apart from others of the same seed."""


def with_unseen_bodies(timeline: Timeline) -> Timeline:
    """Return the same traffic with unseen bodies, each no larger than the one it replaces.

    So no two vehicles come closer than before. Motorcycles, people and the ego stay the same.
    """
    sizes = timeline.sizes.copy()
    rows = zip(timeline.ids.tolist(), timeline.categories.tolist(), strict=True)
    for row, (actor, category) in enumerate(rows):
        unseen = UNSEEN.get(Category(category), {}).values()
        fit = [s for s in unseen if s.length_m <= sizes[row, 0] and s.width_m <= sizes[row, 1]]
        if row > 0 and fit:
            rng = np.random.default_rng([SALT, abs(actor)])
            sizes[row] = fit[int(rng.integers(len(fit)))]
    return replace(timeline, sizes=sizes)
