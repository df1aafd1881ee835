"""The shapes of road users, as stacks of upright prisms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.envs.traffic.mix import UNSEEN, Size
from roadscope.envs.world import materials
from roadscope.envs.world.prisms import Prisms, Slab, ellipse, rounded

# --------------------------------------------------------------------------------------------------
# Slabs and colours of the bodies of road users.

Parts = Mapping[str, Any]
"""Options of a slab."""

GLASS = 0.08
RUBBER = 0.05
DARK_METAL = 0.2
SKIN = 0.55
"""Reflectivities at 905 nm; chosen by hand."""
WINDOW: Parts = MappingProxyType({"reflectivity": GLASS, "material": materials.GLASS})
PAINTS = np.array([0.1, 0.15, 0.25, 0.35, 0.45, 0.6, 0.8])
"""Reflectivities at 905 nm of black, dark blue, dark grey, red, silver, light grey and white paint;
chosen by hand."""


class Section(NamedTuple):
    """Extents of a slab: shares of the length from the rear end, of the height from below."""

    rear: float
    front: float
    bottom: float
    top: float


def slab(
    size: Size,
    section: Section,
    *,
    breadth: float = 1.0,
    radius: float = 0.3,
    reflectivity: float,
    material: int = materials.GREY,
) -> Slab:
    """Return a slab with rounded corners, part of a body of that size.

    breadth: share of the body's width. radius: of the corners, metres.
    """
    length, width, height = size
    rear, front, bottom, top = section
    outline = rounded(
        (front - rear) * length, breadth * width, radius, ((rear + front) / 2 - 0.5) * length
    )
    return Slab(
        outline, bottom * height, top * height, reflectivity=reflectivity, material=material
    )


def painted(paint: float, rng: np.random.Generator, family: str = "paint") -> Parts:
    """Return the options of a slab in a random colour with that reflectivity."""
    row = int(np.searchsorted(PAINTS, paint)) * materials.HUES + int(rng.integers(materials.HUES))
    return {"reflectivity": paint, "material": materials.first_of(family) + row}


def random_material(family: str, rng: np.random.Generator) -> int:
    """Return a random material of a family."""
    return materials.first_of(family) + int(rng.integers(materials.size_of(family)))


# --------------------------------------------------------------------------------------------------
# Bodies of the sizes in `traffic.mix.UNSEEN`.

STEEL: Parts = MappingProxyType({"reflectivity": DARK_METAL, "material": materials.STEEL})
TYRES: Parts = MappingProxyType(
    {"radius": 0.1, "reflectivity": RUBBER, "material": materials.RUBBER, "breadth": 0.96}
)


def _colour(rng: np.random.Generator) -> Parts:
    return painted(float(rng.choice(PAINTS)), rng)


def _tall_box(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Build a small car as high as it is wide, upright all round."""
    colour = _colour(rng)
    return [
        slab(size, Section(0, 1, 0.10, 0.52), radius=0.2, **colour),
        slab(size, Section(0.02, 0.88, 0.52, 0.88), breadth=0.95, radius=0.2, **WINDOW),
        slab(size, Section(0.02, 0.84, 0.88, 1), breadth=0.92, radius=0.2, **colour),
    ]


def _pickup(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Build a car with an open bed behind the cab."""
    colour = _colour(rng)
    return [
        slab(size, Section(0, 1, 0.14, 0.52), radius=0.25, **colour),
        slab(size, Section(0, 0.40, 0.52, 0.62), breadth=0.98, radius=0.1, **colour),
        slab(size, Section(0.40, 0.74, 0.52, 0.90), breadth=0.92, radius=0.2, **WINDOW),
        slab(size, Section(0.43, 0.68, 0.90, 1), breadth=0.80, radius=0.2, **colour),
    ]


def _dropside(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Build a van's cab with a low open bed behind it."""
    colour = _colour(rng)
    return [
        slab(size, Section(0.60, 1, 0.10, 0.55), radius=0.2, **colour),
        slab(size, Section(0.60, 0.93, 0.55, 0.85), breadth=0.95, radius=0.2, **WINDOW),
        slab(size, Section(0.60, 0.88, 0.85, 1), breadth=0.95, radius=0.2, **colour),
        slab(size, Section(0, 0.58, 0.30, 0.50), radius=0.05, **colour),
        slab(size, Section(0.08, 0.24, 0, 0.30), **TYRES),
    ]


def _camper(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Build a cabin that reaches out over the cab, with a small window in either side."""
    white = painted(float(PAINTS[-1]), rng)
    return [
        slab(size, Section(0, 1, 0.10, 0.40), radius=0.2, **white),
        slab(size, Section(0.70, 0.90, 0.40, 0.62), breadth=0.9, radius=0.15, **WINDOW),
        slab(size, Section(0, 0.70, 0.40, 0.62), radius=0.1, **white),
        slab(size, Section(0, 0.94, 0.62, 0.74), radius=0.1, **white),
        slab(size, Section(0.20, 0.60, 0.74, 0.84), breadth=0.99, radius=0.1, **WINDOW),
        slab(size, Section(0, 0.90, 0.84, 1), breadth=0.97, radius=0.1, **white),
    ]


def _cab(size: Size, colour: Parts) -> tuple[list[Slab], float]:
    """Return the cab of a lorry, 2 m long, and the share of the length at which it begins."""
    begin = 1 - 2.0 / size[0]
    top = min(1.0, 3.0 / size[2])
    return [
        slab(size, Section(begin, 1, 0.10, 0.5 * top), radius=0.2, **colour),
        slab(size, Section(begin, 0.995, 0.5 * top, 0.8 * top), breadth=0.97, radius=0.2, **WINDOW),
        slab(size, Section(begin, 0.99, 0.8 * top, top), breadth=0.97, radius=0.2, **colour),
    ], begin


def _lorry_wheels(size: Size, begin: float) -> list[Slab]:
    high = 0.95 / size[2]
    rear = 2.4 / size[0] if size[0] > 9 else 1.0 / size[0]
    return [
        slab(size, Section(0.8 / size[0], 0.8 / size[0] + rear, 0, high), **TYRES),
        slab(size, Section(begin + 0.4 / size[0], begin + 1.3 / size[0], 0, high), **TYRES),
    ]


def _flatbed(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Build a cab with an empty platform behind it, and a wall between them."""
    cab, begin = _cab(size, _colour(rng))
    high = 1.1 / size[2]
    wall = (begin - 0.3 / size[0], begin - 0.15 / size[0])
    return [
        *cab,
        *_lorry_wheels(size, begin),
        slab(size, Section(0, begin - 0.15 / size[0], high, high + 0.08), radius=0.05, **STEEL),
        slab(size, Section(*wall, high + 0.08, 0.97), breadth=0.95, radius=0.02, **STEEL),
        slab(size, Section(0.02, begin, 0.6 * high, high), breadth=0.4, radius=0.05, **STEEL),
    ]


def _tanker(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Lay a cylinder, in five steps, behind the cab."""
    cab, begin = _cab(size, _colour(rng))
    tank: Parts = {
        "reflectivity": float(rng.uniform(0.4, 0.8)),
        "material": random_material("box", rng),
    }
    end, low = begin - (0.9 if size[0] >= 10 else 0.25) / size[0], 1.0 / size[2]
    steps = np.linspace(low, 1.0, 6)
    middles = (steps[1:] + steps[:-1] - low - 1) / (1 - low)
    breadths = np.sqrt(1 - (middles / 1.05) ** 2)
    breadths[2] = 1.0
    return [
        *cab,
        *_lorry_wheels(size, begin),
        *(
            slab(size, Section(0, end, float(a), float(b)), breadth=float(c), radius=0.3, **tank)
            for a, b, c in zip(steps[:-1], steps[1:], breadths, strict=True)
        ),
        slab(size, Section(0.02, begin, 0.7 * low, low), breadth=0.4, radius=0.05, **STEEL),
    ]


def _double_decker(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Set two bands of windows, one above the other."""
    colour = painted(float(rng.choice(PAINTS)), rng, "coach")
    return [
        slab(size, Section(0, 1, 0.06, 0.24), radius=0.25, **colour),
        slab(size, Section(0.003, 0.995, 0.24, 0.44), breadth=0.98, radius=0.25, **WINDOW),
        slab(size, Section(0, 1, 0.44, 0.58), breadth=0.99, radius=0.25, **colour),
        slab(size, Section(0.003, 0.995, 0.58, 0.85), breadth=0.98, radius=0.25, **WINDOW),
        slab(size, Section(0.01, 0.99, 0.85, 1), breadth=0.96, radius=0.25, **colour),
    ]


_SHAPES: Mapping[str, Callable[[Size, np.random.Generator], list[Slab]]] = {
    "tall-box": _tall_box,
    "pickup": _pickup,
    "dropside": _dropside,
    "camper": _camper,
    "flatbed": _flatbed,
    "long-flatbed": _flatbed,
    "tanker": _tanker,
    "tank-trailer": _tanker,
    "double-decker": _double_decker,
}

BY_SIZE: Mapping[Size, Callable[[Size, np.random.Generator], list[Slab]]] = MappingProxyType(
    {size: _SHAPES[name] for models in UNSEEN.values() for name, size in models.items()}
)
"""Builders of the unseen bodies, by their exact size."""

# --------------------------------------------------------------------------------------------------
# Bodies of the usual road users.

WHEEL = ((0.0, 0.15, 0.71), (0.15, 0.85, 1.0), (0.85, 1.0, 0.71))
"""Bottom, top and length of the slabs of a wheel, shares of its diameter."""


def body_prisms(category: Category, size: np.ndarray, rng: np.random.Generator) -> Prisms:
    """Return the body of a road user, owner 0, box centre on the ground, x ahead.

    size: (3,) metres, length width height; the body touches its front, rear, sides and top. The
        sizes of `traffic.mix.UNSEEN` have special shapes.
    rng: draws paint, clothes and variants.
    """
    length, width, height = (float(v) for v in size)
    exact = Size(length, width, height)
    build = BY_SIZE.get(exact, _BUILDERS[category])
    return Prisms.stacked(build(exact, rng))


def _car(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Saloon or hatchback: sill, deck, two steps of sloping glass, roof."""
    paint = float(rng.choice(PAINTS))
    rear = (0.02, 0.05, 0.09) if rng.random() < 0.5 else (0.10, 0.17, 0.23)
    colour = painted(paint, rng)
    return [
        slab(size, Section(0, 1, 0.12, 0.50), radius=0.35, **colour),
        slab(size, Section(0.01, 0.96, 0.50, 0.62), breadth=0.98, **colour),
        slab(size, Section(rear[0], 0.70, 0.62, 0.80), breadth=0.90, **WINDOW),
        slab(size, Section(rear[1], 0.62, 0.80, 0.94), breadth=0.82, **WINDOW),
        slab(size, Section(rear[2], 0.56, 0.94, 1), breadth=0.76, **colour),
    ]


def _van(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Box van: short bonnet, one step of windscreen, box."""
    colour = painted(float(rng.choice(PAINTS)), rng)
    return [
        slab(size, Section(0, 1, 0.1, 0.42), radius=0.25, **colour),
        slab(size, Section(0, 0.93, 0.42, 0.55), radius=0.2, **colour),
        slab(size, Section(0.76, 0.86, 0.55, 0.80), breadth=0.9, radius=0.15, **WINDOW),
        slab(size, Section(0, 0.76, 0.55, 1), breadth=0.97, radius=0.15, **colour),
    ]


def _truck(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Rigid truck, or tractor and trailer from 10 m on: box over a chassis, cab ahead of a gap."""
    paint, box = float(rng.choice(PAINTS)), float(rng.uniform(0.4, 0.8))
    length = size[0]
    long = length >= 10
    cab = 1 - (2.3 / length if length > 6 else 0.3)
    back = cab - (0.9 if long else 0.25) / length
    wheels = (0.05, 0.30) if long else (0.10, 0.32)
    colour = painted(paint, rng)
    cover: Parts = {"reflectivity": box, "material": random_material("box", rng)}
    rubber: Parts = {"radius": 0.1, "reflectivity": RUBBER, "material": materials.RUBBER}
    return [
        slab(size, Section(cab, 1, 0.09, 0.46), radius=0.2, **colour),
        slab(size, Section(cab, 0.995, 0.46, 0.92), breadth=0.98, radius=0.2, **colour),
        slab(size, Section(0, back, 0.32, 1), radius=0.05, **cover),
        slab(size, Section(0, cab, 0.22, 0.32), breadth=0.4, radius=0.05, **STEEL),
        slab(size, Section(*wheels, 0, 0.26), breadth=0.98, **rubber),
        slab(size, Section(back - 0.4 / length, 0.6 * cab + 0.4, 0, 0.25), breadth=0.96, **rubber),
    ]


def _bus(size: Size, rng: np.random.Generator) -> list[Slab]:
    """City bus: skirt, band of windows, roof."""
    colour = painted(float(rng.choice(PAINTS)), rng, "coach")
    return [
        slab(size, Section(0, 1, 0.09, 0.42), radius=0.25, **colour),
        slab(size, Section(0.003, 0.995, 0.42, 0.82), breadth=0.98, radius=0.25, **WINDOW),
        slab(size, Section(0.01, 0.985, 0.82, 1), breadth=0.96, radius=0.25, **colour),
    ]


def _motorcycle(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Motorcycle with rider: engine, tail, tank and fairing between broad wheels."""
    rider = _Rider.drawn(rng)
    steel: Parts = {"reflectivity": rider.machine, "material": materials.STEEL}
    colour = painted(float(rng.choice(PAINTS)), rng)
    return [
        *_wheels(size, diameter_m=0.62, breadth=0.22),
        slab(size, Section(0.22, 0.78, 0.13, 0.40), breadth=0.5, **steel),
        slab(size, Section(0.06, 0.46, 0.44, 0.55), breadth=0.45, **colour),
        slab(size, Section(0.44, 0.72, 0.40, 0.58), breadth=0.5, **colour),
        slab(size, Section(0.74, 0.92, 0.41, 0.68), breadth=0.5, **colour),
        slab(size, Section(0.70, 0.76, 0.62, 0.68), radius=0.05, **steel),
        slab(size, Section(0.38, 0.64, 0.20, 0.55), breadth=0.8, **rider.legs),
        slab(size, Section(0.28, 0.56, 0.55, 0.82), breadth=0.65, **rider.trunk),
        slab(size, Section(0.56, 0.72, 0.66, 0.74), breadth=0.85, **rider.trunk),
        rider.head(size, 0.5),
    ]


def _cyclist(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Bicycle with rider: a thin frame between tall, narrow wheels, the rider bent over it."""
    rider = _Rider.drawn(rng)
    steel: Parts = {"radius": 0.02, "reflectivity": rider.machine, "material": materials.STEEL}
    return [
        *_wheels(size, diameter_m=0.70, breadth=0.12),
        slab(size, Section(0.20, 0.76, 0.30, 0.35), breadth=0.1, **steel),
        slab(size, Section(0.70, 0.76, 0.35, 0.58), breadth=0.1, **steel),
        slab(size, Section(0.66, 0.74, 0.56, 0.60), **steel),
        slab(size, Section(0.38, 0.56, 0.08, 0.52), breadth=0.55, **rider.legs),
        slab(size, Section(0.32, 0.56, 0.52, 0.66), breadth=0.65, **rider.trunk),
        slab(size, Section(0.40, 0.66, 0.66, 0.82), breadth=0.75, **rider.trunk),
        rider.head(size, 0.58),
    ]


class _Rider(NamedTuple):
    """Slab options of a rider, and the reflectivity of the motorcycle or bicycle."""

    legs: Parts
    trunk: Parts
    skin: Parts
    machine: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> _Rider:
        cloth, machine = float(rng.uniform(0.25, 0.7)), float(rng.uniform(0.1, 0.4))
        trousers, shirt, skin = (
            random_material(family, rng) for family in ("cloth", "cloth", "skin")
        )
        return cls(
            {"reflectivity": cloth, "material": trousers},
            {"reflectivity": cloth, "material": shirt},
            {"reflectivity": SKIN, "material": skin},
            machine,
        )

    def head(self, size: Size, middle: float) -> Slab:
        """Return the head, on top, with its middle at a share of the length."""
        length, width, _ = size
        side = min(0.26, 0.6 * width, 0.6 * length)
        half = side / length / 2
        return slab(
            size, Section(middle - half, middle + half, 0.82, 1), breadth=side / width, **self.skin
        )


def _wheels(size: Size, *, diameter_m: float, breadth: float) -> list[Slab]:
    """Return two wheels of three slabs each, at the rear and at the front end."""
    length, _, height = size
    across, tall = min(diameter_m / length, 0.45), min(diameter_m / height, 0.45)
    rubber: Parts = {"radius": 0.02, "reflectivity": RUBBER, "material": materials.RUBBER}
    return [
        slab(
            size,
            Section(hub - share * across / 2, hub + share * across / 2, low * tall, high * tall),
            breadth=breadth,
            **rubber,
        )
        for hub in (across / 2, 1 - across / 2)
        for low, high, share in WHEEL
    ]


def _pedestrian(size: Size, rng: np.random.Generator) -> list[Slab]:
    """Legs in mid-stride, trunk with arms, head."""
    length, width, height = size
    trousers, shirt = (float(v) for v in rng.uniform(0.25, 0.7, 2))
    head = min(0.24, 0.7 * length, 0.7 * width)
    hip, neck = 0.47 * height, 0.85 * height
    legs, trunk, skin = (random_material(family, rng) for family in ("cloth", "cloth", "skin"))
    return [
        Slab(ellipse(length, 0.6 * width), 0, hip, reflectivity=trousers, material=legs),
        Slab(ellipse(0.7 * length, width), hip, neck, reflectivity=shirt, material=trunk),
        Slab(ellipse(head, head), neck, height, reflectivity=SKIN, material=skin),
    ]


_BUILDERS: dict[Category, Callable[[Size, np.random.Generator], list[Slab]]] = {
    Category.CAR: _car,
    Category.VAN: _van,
    Category.TRUCK: _truck,
    Category.BUS: _bus,
    Category.MOTORCYCLE: _motorcycle,
    Category.CYCLIST: _cyclist,
    Category.PEDESTRIAN: _pedestrian,
}
