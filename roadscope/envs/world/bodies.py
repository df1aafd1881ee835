"""The shapes of road users, as stacks of upright prisms.

Proportions follow side views of common vehicles; reflectivities at 905 nm are diffuse values:
car paint spans 0.1 (black) to 0.8 (white), tyres and glass return little (ibeo and Velodyne
quote ranges at 10 % for dark cars and 80 % for white ones), cloth is brighter in the near
infrared than to the eye, skin 0.5 to 0.6 (NIST reference data set of human skin reflectance,
Cooksey 2015).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.envs.world import materials
from roadscope.envs.world.body_parts import (
    DARK_METAL,
    PAINTS,
    RUBBER,
    SKIN,
    WINDOW,
    Parts,
    Size,
    any_of,
    painted,
    slab,
)
from roadscope.envs.world.footprints import ellipse
from roadscope.envs.world.prisms import Prisms
from roadscope.envs.world.unseen_bodies import BY_SIZE

WHEEL = ((0.0, 0.15, 0.71), (0.15, 0.85, 1.0), (0.85, 1.0, 0.71))
"""Heights and breadth of the slabs of a wheel, shares of its diameter."""


def body_prisms(category: Category, size: np.ndarray, rng: np.random.Generator) -> Prisms:
    """Return the body of a road user, owner 0, box centre on the ground, x ahead.

    size: (3,) metres, length width height; the body touches its front, rear, sides and top. Those
        of `traffic.unseen` have shapes of their own.
    rng: chooses paint, clothes and variants.
    """
    length, width, height = (float(v) for v in size)
    build = BY_SIZE.get((length, width, height), _BUILDERS[category])
    return Prisms.join(build((length, width, height), rng))


def _car(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Saloon or hatchback: sill, deck, two steps of sloping glass, roof."""
    paint = float(rng.choice(PAINTS))
    rear = (0.02, 0.05, 0.09) if rng.random() < 0.5 else (0.10, 0.17, 0.23)
    colour = painted(paint, rng)
    return [
        slab(size, (0, 1), (0.12, 0.50), radius=0.35, **colour),
        slab(size, (0.01, 0.96), (0.50, 0.62), breadth=0.98, **colour),
        slab(size, (rear[0], 0.70), (0.62, 0.80), breadth=0.90, **WINDOW),
        slab(size, (rear[1], 0.62), (0.80, 0.94), breadth=0.82, **WINDOW),
        slab(size, (rear[2], 0.56), (0.94, 1), breadth=0.76, **colour),
    ]


def _van(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Box van: short bonnet, one step of windscreen, box."""
    colour = painted(float(rng.choice(PAINTS)), rng)
    return [
        slab(size, (0, 1), (0.1, 0.42), radius=0.25, **colour),
        slab(size, (0, 0.93), (0.42, 0.55), radius=0.2, **colour),
        slab(size, (0.76, 0.86), (0.55, 0.80), breadth=0.9, radius=0.15, **WINDOW),
        slab(size, (0, 0.76), (0.55, 1), breadth=0.97, radius=0.15, **colour),
    ]


def _truck(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Rigid truck, or tractor and trailer from 10 m on: box over a chassis, cab ahead of a gap."""
    paint, box = float(rng.choice(PAINTS)), float(rng.uniform(0.4, 0.8))
    length = size[0]
    long = length >= 10
    cab = 1 - (2.3 / length if length > 6 else 0.3)
    back = cab - (0.9 if long else 0.25) / length
    wheels = (0.05, 0.30) if long else (0.10, 0.32)
    colour = painted(paint, rng)
    cover: Parts = {"reflectivity": box, "look": any_of("box", rng)}
    rubber: Parts = {"radius": 0.1, "reflectivity": RUBBER, "look": materials.RUBBER}
    steel: Parts = {"reflectivity": DARK_METAL, "look": materials.STEEL}
    return [
        slab(size, (cab, 1), (0.09, 0.46), radius=0.2, **colour),
        slab(size, (cab, 0.995), (0.46, 0.92), breadth=0.98, radius=0.2, **colour),
        slab(size, (0, back), (0.32, 1), radius=0.05, **cover),
        slab(size, (0, cab), (0.22, 0.32), breadth=0.4, radius=0.05, **steel),
        slab(size, wheels, (0, 0.26), breadth=0.98, **rubber),
        slab(size, (back - 0.4 / length, 0.6 * cab + 0.4), (0, 0.25), breadth=0.96, **rubber),
    ]


def _bus(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """City bus: skirt, band of windows, roof."""
    colour = painted(float(rng.choice(PAINTS)), rng, "coach")
    return [
        slab(size, (0, 1), (0.09, 0.42), radius=0.25, **colour),
        slab(size, (0.003, 0.995), (0.42, 0.82), breadth=0.98, radius=0.25, **WINDOW),
        slab(size, (0.01, 0.985), (0.82, 1), breadth=0.96, radius=0.25, **colour),
    ]


def _motorcycle(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Motorcycle with rider: engine, tail, tank and fairing between broad wheels."""
    rider = _Rider.drawn(rng)
    steel: Parts = {"reflectivity": rider.machine, "look": materials.STEEL}
    colour = painted(float(rng.choice(PAINTS)), rng)
    return [
        *_wheels(size, diameter_m=0.62, breadth=0.22),
        slab(size, (0.22, 0.78), (0.13, 0.40), breadth=0.5, **steel),
        slab(size, (0.06, 0.46), (0.44, 0.55), breadth=0.45, **colour),
        slab(size, (0.44, 0.72), (0.40, 0.58), breadth=0.5, **colour),
        slab(size, (0.74, 0.92), (0.41, 0.68), breadth=0.5, **colour),
        slab(size, (0.70, 0.76), (0.62, 0.68), radius=0.05, **steel),
        slab(size, (0.38, 0.64), (0.20, 0.55), breadth=0.8, **rider.legs),
        slab(size, (0.28, 0.56), (0.55, 0.82), breadth=0.65, **rider.trunk),
        slab(size, (0.56, 0.72), (0.66, 0.74), breadth=0.85, **rider.trunk),
        rider.head(size, 0.5),
    ]


def _cyclist(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Bicycle with rider: a thin frame between tall, narrow wheels, the rider bent over it."""
    rider = _Rider.drawn(rng)
    steel: Parts = {"radius": 0.02, "reflectivity": rider.machine, "look": materials.STEEL}
    return [
        *_wheels(size, diameter_m=0.70, breadth=0.12),
        slab(size, (0.20, 0.76), (0.30, 0.35), breadth=0.1, **steel),
        slab(size, (0.70, 0.76), (0.35, 0.58), breadth=0.1, **steel),
        slab(size, (0.66, 0.74), (0.56, 0.60), **steel),
        slab(size, (0.38, 0.56), (0.08, 0.52), breadth=0.55, **rider.legs),
        slab(size, (0.32, 0.56), (0.52, 0.66), breadth=0.65, **rider.trunk),
        slab(size, (0.40, 0.66), (0.66, 0.82), breadth=0.75, **rider.trunk),
        rider.head(size, 0.58),
    ]


class _Rider(NamedTuple):
    """What somebody on two wheels wears; how bright the machine is."""

    legs: Parts
    trunk: Parts
    skin: Parts
    machine: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> _Rider:
        cloth, machine = float(rng.uniform(0.25, 0.7)), float(rng.uniform(0.1, 0.4))
        trousers, shirt, skin = (any_of(family, rng) for family in ("cloth", "cloth", "skin"))
        return cls(
            {"reflectivity": cloth, "look": trousers}, {"reflectivity": cloth, "look": shirt},
            {"reflectivity": SKIN, "look": skin}, machine,
        )  # fmt: skip

    def head(self, size: Size, middle: float) -> Prisms:
        """Place the head on top, x a share of the length."""
        length, width, _ = size
        side = min(0.26, 0.6 * width, 0.6 * length)
        half = side / length / 2
        return slab(size, (middle - half, middle + half), (0.82, 1), breadth=side / width,
                    **self.skin)  # fmt: skip


def _wheels(size: Size, *, diameter_m: float, breadth: float) -> list[Prisms]:
    """Two wheels, each of three slabs, the rear one at the rear end, the front one ahead."""
    length, _, height = size
    across, tall = min(diameter_m / length, 0.45), min(diameter_m / height, 0.45)
    rubber: Parts = {"radius": 0.02, "reflectivity": RUBBER, "look": materials.RUBBER}
    return [
        slab(
            size, (hub - share * across / 2, hub + share * across / 2),
            (low * tall, high * tall), breadth=breadth, **rubber,
        )
        for hub in (across / 2, 1 - across / 2)
        for low, high, share in WHEEL
    ]  # fmt: skip


def _pedestrian(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Legs in mid-stride, trunk with arms, head."""
    length, width, height = size
    trousers, shirt = (float(v) for v in rng.uniform(0.25, 0.7, 2))
    head = min(0.24, 0.7 * length, 0.7 * width)
    hip, neck = 0.47 * height, 0.85 * height
    legs, trunk, skin = (any_of(family, rng) for family in ("cloth", "cloth", "skin"))
    return [
        Prisms.of(ellipse(length, 0.6 * width), 0, hip, reflectivity=trousers, material=legs),
        Prisms.of(ellipse(0.7 * length, width), hip, neck, reflectivity=shirt, material=trunk),
        Prisms.of(ellipse(head, head), neck, height, reflectivity=SKIN, material=skin),
    ]


_BUILDERS: dict[Category, Callable[[Size, np.random.Generator], list[Prisms]]] = {
    Category.CAR: _car,
    Category.VAN: _van,
    Category.TRUCK: _truck,
    Category.BUS: _bus,
    Category.MOTORCYCLE: _motorcycle,
    Category.CYCLIST: _cyclist,
    Category.PEDESTRIAN: _pedestrian,
}
