"""Slabs and colours that bodies of road users are made of."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from roadscope.envs.world import materials
from roadscope.envs.world.footprints import rounded
from roadscope.envs.world.prisms import Prisms

Size = tuple[float, float, float]
Parts = Mapping[str, Any]
"""Options of a slab."""

GLASS = 0.08
RUBBER = 0.05
DARK_METAL = 0.2
SKIN = 0.55
WINDOW: Parts = MappingProxyType({"reflectivity": GLASS, "look": materials.GLASS})
PAINTS = np.array([0.1, 0.15, 0.25, 0.35, 0.45, 0.6, 0.8])
"""Black, dark blue, dark grey, red, silver, light grey, white."""


def slab(
    size: Size, x: tuple[float, float], z: tuple[float, float],
    *, breadth: float = 1.0, radius: float = 0.3, reflectivity: float, look: int = materials.GREY,
) -> Prisms:  # fmt: skip
    """Make a rounded slab; x from the rear end, z and breadth are fractions of the size."""
    length, width, height = size
    outline = rounded(
        (x[1] - x[0]) * length, breadth * width, radius, ((x[0] + x[1]) / 2 - 0.5) * length
    )
    return Prisms.of(
        outline, z[0] * height, z[1] * height, reflectivity=reflectivity, material=look
    )  # fmt: skip


def painted(paint: float, rng: np.random.Generator, family: str = "paint") -> Parts:
    """One of the colours that are as bright as the reflectivity."""
    row = int(np.searchsorted(PAINTS, paint)) * materials.HUES + int(rng.integers(materials.HUES))
    return {"reflectivity": paint, "look": materials.first_of(family) + row}


def any_of(family: str, rng: np.random.Generator) -> int:
    """One of the materials of a family."""
    return materials.first_of(family) + int(rng.integers(materials.size_of(family)))
