"""A Ford Fusion saloon as a stack of upright prisms: nose, bonnet, cabin, boot.

Length, width and height are the maker's (second generation, from 2013). Heights and set-backs of
the slabs were estimated from side views against the 0.67 m wheels, so they are good to a few
centimetres. From above, the body narrows ahead of the front axle and behind the rear axle.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from roadscope.envs.world.prisms import Prisms

LENGTH_M, WIDTH_M, HEIGHT_M = 4.87, 1.85, 1.48
CORNER_RADII_M: Mapping[str, float] = MappingProxyType({"sharp": 0.0, "rounded": 0.35})
"""Radius of the vertical corners, by the name of the body."""
AXLES_M = (-1.36, 1.49)
"""Rear and front axle from the box centre; between them the sides are straight."""
NARROWING = (0.97, 0.95)
"""Width at the tail and at the nose as a share of the width between the axles."""
SILVER, GLASS = 0.45, 0.08
"""Reflectivities at 905 nm."""
ARC_POINTS = 4
"""Points on the arc of a rounded corner."""


class SaloonSlab(NamedTuple):
    """One slab: heights, distances from tail and nose, share of the width, reflectivity."""

    bottom_m: float
    top_m: float
    from_tail_m: float
    from_nose_m: float
    breadth: float
    reflectivity: float


SLABS = (
    SaloonSlab(0.16, 0.76, 0.0, 0.0, 1.0, SILVER),
    SaloonSlab(0.76, 0.88, 0.0, 0.15, 1.0, SILVER),
    SaloonSlab(0.88, 1.00, 0.03, 0.70, 0.97, SILVER),
    SaloonSlab(1.00, 1.18, 0.45, 1.45, 0.88, GLASS),
    SaloonSlab(1.18, 1.36, 0.95, 1.85, 0.80, GLASS),
    SaloonSlab(1.36, 1.48, 1.45, 2.15, 0.72, SILVER),
)
"""Bumpers and doors up to the edge of the bonnet; bonnet and boot up to the window line in two
steps, the tail almost upright; glass in two steps; roof."""


def ford_saloon(corners: str = "sharp") -> Prisms:
    """Return the body, owner 0, box centre on the ground, x ahead.

    corners: `sharp` or `rounded`, the key of `CORNER_RADII_M`.
    """
    if corners not in CORNER_RADII_M:
        raise ValueError(f"no body '{corners}'; known: {', '.join(CORNER_RADII_M)}")
    return with_corners(CORNER_RADII_M[corners])


def with_corners(radius_m: float) -> Prisms:
    """Return the same body with vertical corners of any radius."""
    halves = [
        Prisms.of(outline, slab.bottom_m, slab.top_m, reflectivity=slab.reflectivity)
        for slab in SLABS
        for outline in _halves(slab, radius_m)
    ]
    return Prisms.join(halves)


def _halves(slab: SaloonSlab, radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the outlines behind and ahead of the slab's middle: one alone has too many corners."""
    tail, nose = slab.from_tail_m - LENGTH_M / 2, LENGTH_M / 2 - slab.from_nose_m
    middle = (tail + nose) / 2
    side = slab.breadth * WIDTH_M / 2
    behind = _half(-tail, -AXLES_M[0], side, NARROWING[0], radius_m)
    ahead = _half(nose, AXLES_M[1], side, NARROWING[1], radius_m)
    ahead[[0, -1], 0], behind[[0, -1], 0] = middle, -middle
    return -behind, ahead


def _half(
    reach_m: float, axle_m: float, side_m: float, narrowing: float, radius_m: float
) -> np.ndarray:
    """Return the (K, 2) outline ahead of x = 0: straight to the axle, then narrowing, then arcs.

    The first and the last corner are at x = 0.
    """
    beyond = max(reach_m - axle_m, 0.0) / (LENGTH_M / 2 - axle_m)
    end = side_m * (1.0 - (1.0 - narrowing) * beyond)
    return half_outline(reach_m, axle_m, side_m, end, min(radius_m, 0.999 * end))


def half_outline(
    reach_m: float, axle_m: float, side_m: float, end_m: float, radius_m: float
) -> np.ndarray:
    """Return (K, 2) corners ahead of x = 0, counter-clockwise, the first and the last at x = 0.

    The side is straight up to the axle and narrows to half the end's width where its arcs begin.
    """
    angles = np.linspace(-np.pi / 2, 0.0, ARC_POINTS) if radius_m > 0 else np.zeros(1)
    arc = radius_m * np.column_stack([np.cos(angles), np.sin(angles)])
    arc += np.array([reach_m - radius_m, radius_m - end_m])
    before = axle_m < reach_m - radius_m
    start = (axle_m, -side_m) if before else (reach_m - radius_m, -end_m)
    right = np.concatenate([[[0.0, -side_m], start], arc])
    right = right[np.append(True, np.abs(np.diff(right, axis=0)).sum(axis=1) > 1e-9)]
    outline: np.ndarray = np.concatenate([right, right[::-1] * (1, -1)])
    return outline
