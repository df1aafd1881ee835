"""Which road users drive where, with published outer dimensions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from roadscope.core import Category
from roadscope.envs.traffic.timeline import Timeline

# --------------------------------------------------------------------------------------------------
# Which road users drive where, with published outer dimensions.

Size = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Body:
    """What a road user is: its category and its length, width and height in metres."""

    category: Category
    size: Size


# Length, width without mirrors and height as the makers' data sheets give them.
CARS: tuple[Size, ...] = (
    (3.571, 1.627, 1.488),  # Fiat 500 (2016)
    (4.050, 1.798, 1.440),  # Renault Clio V
    (4.074, 1.751, 1.451),  # Volkswagen Polo VI
    (4.284, 1.789, 1.456),  # Volkswagen Golf 8
    (4.370, 1.790, 1.435),  # Toyota Corolla hatchback (E210)
    (4.509, 1.839, 1.675),  # Volkswagen Tiguan II
    (4.600, 1.855, 1.685),  # Toyota RAV4 (XA50)
    (4.689, 1.829, 1.468),  # Skoda Octavia IV estate
    (4.694, 1.849, 1.443),  # Tesla Model 3
    (4.709, 1.827, 1.442),  # BMW 3 Series (G20)
    (4.939, 1.886, 1.457),  # Audi A6 (C8)
)
VANS: tuple[Size, ...] = (
    (4.500, 1.855, 1.797),  # Volkswagen Caddy V
    (4.904, 1.904, 1.990),  # Volkswagen Transporter T6.1
    (5.413, 2.050, 2.524),  # Fiat Ducato L2H2
    (5.932, 2.020, 2.638),  # Mercedes-Benz Sprinter (907), standard length, high roof
)
LIGHT_TRUCKS: tuple[Size, ...] = (
    (6.000, 2.140, 2.900),  # box body on a Fuso Canter 7C15 class chassis
    (7.500, 2.500, 3.400),  # box body on a Mercedes-Benz Atego 818 class chassis
    (8.600, 2.550, 3.600),  # box body on a MAN TGL 12.220 class chassis
)
# The longest that Directive 96/53/EC, annex I, allows: rigid and articulated.
HEAVY_TRUCKS: tuple[Size, ...] = ((12.000, 2.550, 3.800), (16.500, 2.550, 4.000))
BUSES: tuple[Size, ...] = (
    (10.633, 2.550, 3.120),  # Mercedes-Benz Citaro K
    (12.135, 2.550, 3.120),  # Mercedes-Benz Citaro
)
# Height with a seated rider.
MOTORCYCLES: tuple[Size, ...] = (
    (1.852, 0.735, 1.650),  # Vespa Primavera 125
    (2.085, 0.780, 1.700),  # Yamaha MT-07
    (2.207, 0.952, 1.800),  # BMW R 1250 GS
)

EGO = Body(Category.CAR, (5.0, 1.9, 1.5))
"""A saloon as long as highway-env's vehicles (a BMW 5 Series, G60, is 5.060 x 1.900 x 1.515)."""

Mix = tuple[tuple[Category, float, tuple[Size, ...]], ...]

MIXES: Mapping[str, Mix] = MappingProxyType(
    {
        "motorway": (
            (Category.CAR, 0.66, CARS),
            (Category.VAN, 0.13, VANS),
            (Category.TRUCK, 0.14, (*LIGHT_TRUCKS, *HEAVY_TRUCKS)),
            (Category.BUS, 0.03, BUSES[1:]),
            (Category.MOTORCYCLE, 0.04, MOTORCYCLES[1:]),
        ),
        "urban": (
            (Category.CAR, 0.70, CARS),
            (Category.VAN, 0.14, VANS),
            (Category.TRUCK, 0.05, LIGHT_TRUCKS[:2]),
            (Category.BUS, 0.04, BUSES),
            (Category.MOTORCYCLE, 0.07, MOTORCYCLES),
        ),
        "tight": (
            (Category.CAR, 0.76, CARS),
            (Category.VAN, 0.14, VANS),
            (Category.TRUCK, 0.03, LIGHT_TRUCKS[:1]),
            (Category.MOTORCYCLE, 0.07, MOTORCYCLES),
        ),
        "parked": ((Category.CAR, 0.88, CARS), (Category.VAN, 0.12, VANS[:2])),
        "convoy": (
            (Category.CAR, 0.38, CARS),
            (Category.VAN, 0.25, VANS[1:]),
            (Category.TRUCK, 0.27, (*LIGHT_TRUCKS, *HEAVY_TRUCKS)),
            (Category.BUS, 0.10, BUSES),
        ),
        "foreign": (
            (Category.CAR, 0.72, CARS),
            (Category.VAN, 0.13, VANS),
            (Category.TRUCK, 0.07, LIGHT_TRUCKS),
            (Category.BUS, 0.03, BUSES),
            (Category.MOTORCYCLE, 0.05, MOTORCYCLES),
        ),
    }
)
"""Shares of each category and the sizes to choose from, by kind of place."""


def draw_body(mix: str, rng: np.random.Generator) -> Body:
    """Draw a road user from a mix named in `MIXES`."""
    shares = MIXES[mix]
    category, _, sizes = shares[int(rng.choice(len(shares), p=[share for _, share, _ in shares]))]
    return Body(category, sizes[int(rng.integers(len(sizes)))])


# --------------------------------------------------------------------------------------------------
# Vehicles of shapes that no detector of the package was taught, in place of the usual ones.

UNSEEN: Mapping[Category, Mapping[str, Size]] = MappingProxyType(
    {
        Category.CAR: {"tall-box": (3.395, 1.475, 1.790), "pickup": (4.480, 1.732, 1.577)},
        Category.VAN: {"dropside": (4.220, 1.680, 1.920), "camper": (5.350, 2.010, 2.750)},
        Category.TRUCK: {
            "flatbed": (5.900, 2.100, 2.300),
            "tanker": (8.400, 2.500, 3.200),
            "tank-trailer": (16.000, 2.550, 3.600),
            "long-flatbed": (11.800, 2.540, 3.000),
        },
        Category.BUS: {"double-decker": (10.500, 2.520, 4.300)},
    }
)
"""Sizes of such vehicles, rounded and from memory, not of one model each. They stand for shapes:
`world.unseen_bodies` builds a body of its own for each of these sizes, and no mix has them."""
SALT = 0x556E7365


def with_unseen_bodies(timeline: Timeline) -> Timeline:
    """Return the same traffic with other bodies, each inside the one that it stands in for.

    So nobody comes closer to anybody than before. Motorcycles and people stay as they are, and
    so does the ego.
    """
    sizes = timeline.sizes.copy()
    rows = zip(timeline.ids.tolist(), timeline.categories.tolist(), strict=True)
    for row, (actor, category) in enumerate(rows):
        known = UNSEEN.get(Category(category), {}).values()
        fit = [s for s in known if s[0] <= sizes[row, 0] and s[1] <= sizes[row, 1]]
        if row > 0 and fit:
            rng = np.random.default_rng([SALT, abs(actor)])
            sizes[row] = fit[int(rng.integers(len(fit)))]
    return replace(timeline, sizes=sizes)
