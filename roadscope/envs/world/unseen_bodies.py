"""Bodies of the shapes of `traffic.unseen`, as stacks of upright prisms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from roadscope.envs.traffic.mix import Size
from roadscope.envs.traffic.unseen import UNSEEN
from roadscope.envs.world import materials
from roadscope.envs.world.body_parts import (
    DARK_METAL,
    PAINTS,
    RUBBER,
    WINDOW,
    Parts,
    any_of,
    painted,
    slab,
)
from roadscope.envs.world.prisms import Prisms

STEEL: Parts = MappingProxyType({"reflectivity": DARK_METAL, "look": materials.STEEL})
TYRES: Parts = MappingProxyType(
    {"radius": 0.1, "reflectivity": RUBBER, "look": materials.RUBBER, "breadth": 0.96}
)


def _colour(rng: np.random.Generator) -> Parts:
    return painted(float(rng.choice(PAINTS)), rng)


def _tall_box(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Build a small car as high as it is wide, upright all round."""
    colour = _colour(rng)
    return [
        slab(size, (0, 1), (0.10, 0.52), radius=0.2, **colour),
        slab(size, (0.02, 0.88), (0.52, 0.88), breadth=0.95, radius=0.2, **WINDOW),
        slab(size, (0.02, 0.84), (0.88, 1), breadth=0.92, radius=0.2, **colour),
    ]


def _pickup(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Build a car with an open bed behind the cab."""
    colour = _colour(rng)
    return [
        slab(size, (0, 1), (0.14, 0.52), radius=0.25, **colour),
        slab(size, (0, 0.40), (0.52, 0.62), breadth=0.98, radius=0.1, **colour),
        slab(size, (0.40, 0.74), (0.52, 0.90), breadth=0.92, radius=0.2, **WINDOW),
        slab(size, (0.43, 0.68), (0.90, 1), breadth=0.80, radius=0.2, **colour),
    ]


def _dropside(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Put a van's cab before a low open bed."""
    colour = _colour(rng)
    return [
        slab(size, (0.60, 1), (0.10, 0.55), radius=0.2, **colour),
        slab(size, (0.60, 0.93), (0.55, 0.85), breadth=0.95, radius=0.2, **WINDOW),
        slab(size, (0.60, 0.88), (0.85, 1), breadth=0.95, radius=0.2, **colour),
        slab(size, (0, 0.58), (0.30, 0.50), radius=0.05, **colour),
        slab(size, (0.08, 0.24), (0, 0.30), **TYRES),
    ]


def _camper(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Build a cabin that reaches out over the cab, with a small window in either side."""
    white = painted(float(PAINTS[-1]), rng)
    return [
        slab(size, (0, 1), (0.10, 0.40), radius=0.2, **white),
        slab(size, (0.70, 0.90), (0.40, 0.62), breadth=0.9, radius=0.15, **WINDOW),
        slab(size, (0, 0.70), (0.40, 0.62), radius=0.1, **white),
        slab(size, (0, 0.94), (0.62, 0.74), radius=0.1, **white),
        slab(size, (0.20, 0.60), (0.74, 0.84), breadth=0.99, radius=0.1, **WINDOW),
        slab(size, (0, 0.90), (0.84, 1), breadth=0.97, radius=0.1, **white),
    ]


def _cab(size: Size, colour: Parts) -> tuple[list[Prisms], float]:
    """Cab of a lorry, all of 2 m long, and where it begins."""
    begin = 1 - 2.0 / size[0]
    top = min(1.0, 3.0 / size[2])
    return [
        slab(size, (begin, 1), (0.10, 0.5 * top), radius=0.2, **colour),
        slab(size, (begin, 0.995), (0.5 * top, 0.8 * top), breadth=0.97, radius=0.2, **WINDOW),
        slab(size, (begin, 0.99), (0.8 * top, top), breadth=0.97, radius=0.2, **colour),
    ], begin


def _wheels(size: Size, begin: float) -> list[Prisms]:
    high = 0.95 / size[2]
    rear = 2.4 / size[0] if size[0] > 9 else 1.0 / size[0]
    return [
        slab(size, (0.8 / size[0], 0.8 / size[0] + rear), (0, high), **TYRES),
        slab(size, (begin + 0.4 / size[0], begin + 1.3 / size[0]), (0, high), **TYRES),
    ]


def _flatbed(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Put an empty platform behind the cab, with a wall before it."""
    cab, begin = _cab(size, _colour(rng))
    high = 1.1 / size[2]
    wall = (begin - 0.3 / size[0], begin - 0.15 / size[0])
    return [
        *cab, *_wheels(size, begin),
        slab(size, (0, begin - 0.15 / size[0]), (high, high + 0.08), radius=0.05, **STEEL),
        slab(size, wall, (high + 0.08, 0.97), breadth=0.95, radius=0.02, **STEEL),
        slab(size, (0.02, begin), (0.6 * high, high), breadth=0.4, radius=0.05, **STEEL),
    ]  # fmt: skip


def _tanker(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Lay a cylinder, in five steps, behind the cab."""
    cab, begin = _cab(size, _colour(rng))
    tank: Parts = {"reflectivity": float(rng.uniform(0.4, 0.8)), "look": any_of("box", rng)}
    end, low = begin - (0.9 if size[0] >= 10 else 0.25) / size[0], 1.0 / size[2]
    steps = np.linspace(low, 1.0, 6)
    middles = (steps[1:] + steps[:-1] - low - 1) / (1 - low)
    breadths = np.sqrt(1 - (middles / 1.05) ** 2)
    breadths[2] = 1.0
    return [
        *cab, *_wheels(size, begin),
        *(
            slab(size, (0, end), (float(a), float(b)), breadth=float(c), radius=0.3, **tank)
            for a, b, c in zip(steps[:-1], steps[1:], breadths, strict=True)
        ),
        slab(size, (0.02, begin), (0.7 * low, low), breadth=0.4, radius=0.05, **STEEL),
    ]  # fmt: skip


def _double_decker(size: Size, rng: np.random.Generator) -> list[Prisms]:
    """Set two bands of windows, one above the other."""
    colour = painted(float(rng.choice(PAINTS)), rng, "coach")
    return [
        slab(size, (0, 1), (0.06, 0.24), radius=0.25, **colour),
        slab(size, (0.003, 0.995), (0.24, 0.44), breadth=0.98, radius=0.25, **WINDOW),
        slab(size, (0, 1), (0.44, 0.58), breadth=0.99, radius=0.25, **colour),
        slab(size, (0.003, 0.995), (0.58, 0.85), breadth=0.98, radius=0.25, **WINDOW),
        slab(size, (0.01, 0.99), (0.85, 1), breadth=0.96, radius=0.25, **colour),
    ]


_SHAPES: Mapping[str, Callable[[Size, np.random.Generator], list[Prisms]]] = {
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

BY_SIZE: Mapping[Size, Callable[[Size, np.random.Generator], list[Prisms]]] = MappingProxyType(
    {size: _SHAPES[name] for models in UNSEEN.values() for name, size in models.items()}
)
"""A body of exactly one of these sizes has a shape of its own."""
