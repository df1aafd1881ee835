"""Materials of surfaces: colours as shares of reflected light, and patterns.

Colours are linear RGB, not sRGB. They are chosen by hand from how such things look in daylight, not
from results of detectors.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from functools import cache
from typing import NamedTuple

import numpy as np

Colour = tuple[float, float, float]
"""Linear red, green and blue; 1 is white."""


class Pattern(IntEnum):
    """Pattern of a surface; `imaging.patterns` draws it."""

    PLAIN = 0
    BODYWORK = 1
    GLASS = 2
    LEAVES = 3
    FACADE = 4
    CLADDING = 5
    SIGN = 6
    PLASTER = 7
    METAL = 8
    CLOTH = 9
    COACH = 10
    SKIN = 11
    LANTERN = 12


class Material(NamedTuple):
    """A surface: colour, pattern, and the share of light that it mirrors at normal incidence."""

    name: str
    colour: Colour
    pattern: Pattern = Pattern.PLAIN
    gloss: float = 0.0


def _family(
    name: str, colours: Sequence[Colour], pattern: Pattern, gloss: float = 0.0
) -> tuple[Material, ...]:
    return tuple(
        Material(f"{name}-{i}", colour, pattern, gloss) for i, colour in enumerate(colours)
    )


PAINT_COLOURS: tuple[tuple[Colour, ...], ...] = (
    ((0.012, 0.012, 0.013), (0.02, 0.02, 0.024), (0.014, 0.018, 0.016)),
    ((0.015, 0.03, 0.10), (0.02, 0.06, 0.05), (0.05, 0.012, 0.02)),
    ((0.07, 0.072, 0.078), (0.10, 0.012, 0.015), (0.03, 0.08, 0.16)),
    ((0.36, 0.02, 0.02), (0.04, 0.14, 0.42), (0.42, 0.13, 0.02)),
    ((0.36, 0.37, 0.38), (0.34, 0.30, 0.24), (0.16, 0.30, 0.24)),
    ((0.50, 0.51, 0.52), (0.28, 0.44, 0.58), (0.62, 0.48, 0.05)),
    ((0.78, 0.78, 0.77), (0.72, 0.72, 0.74), (0.74, 0.70, 0.60)),
)
"""Car paints, a row for each reflectivity of `bodies.PAINTS`."""
HUES = 3
"""Number of paints in a row."""

_PAINT = _family("paint", [c for row in PAINT_COLOURS for c in row], Pattern.BODYWORK, 0.05)
_COACH = _family("coach", [c for row in PAINT_COLOURS for c in row], Pattern.COACH, 0.05)
_BOX = _family(
    "box",
    [
        (0.74, 0.74, 0.73),
        (0.60, 0.60, 0.58),
        (0.10, 0.18, 0.42),
        (0.45, 0.08, 0.05),
        (0.08, 0.26, 0.14),
        (0.62, 0.46, 0.06),
    ],
    Pattern.CLADDING,
    0.02,
)
_CLOTH = _family(
    "cloth",
    [
        (0.02, 0.02, 0.025),
        (0.05, 0.07, 0.16),
        (0.12, 0.12, 0.13),
        (0.34, 0.05, 0.05),
        (0.06, 0.20, 0.10),
        (0.42, 0.34, 0.22),
        (0.55, 0.55, 0.56),
        (0.10, 0.28, 0.45),
        (0.50, 0.30, 0.04),
        (0.28, 0.08, 0.24),
        (0.20, 0.13, 0.08),
        (0.70, 0.68, 0.62),
    ],
    Pattern.CLOTH,
)
_SKIN = _family(
    "skin",
    [(0.50, 0.30, 0.22), (0.36, 0.20, 0.13), (0.19, 0.10, 0.06), (0.08, 0.04, 0.03)],
    Pattern.SKIN,
)
_FACADE = _family(
    "facade",
    [
        (0.24, 0.10, 0.07),
        (0.32, 0.20, 0.13),
        (0.45, 0.40, 0.33),
        (0.50, 0.43, 0.30),
        (0.56, 0.54, 0.50),
        (0.68, 0.66, 0.62),
    ],
    Pattern.FACADE,
)
_LEAVES = _family(
    "leaves",
    [(0.045, 0.09, 0.022), (0.06, 0.11, 0.03), (0.08, 0.12, 0.03), (0.035, 0.07, 0.025)],
    Pattern.LEAVES,
)
_SIGN = _family("sign", [(0.62, 0.62, 0.60), (0.02, 0.09, 0.36), (0.55, 0.42, 0.02)], Pattern.SIGN)

MATERIALS: tuple[Material, ...] = (
    Material("grey", (0.3, 0.3, 0.3)),
    Material("glass", (0.015, 0.018, 0.02), Pattern.GLASS, 0.10),
    Material("rubber", (0.018, 0.018, 0.018)),
    Material("steel", (0.28, 0.29, 0.30), Pattern.METAL, 0.03),
    Material("concrete", (0.33, 0.32, 0.30), Pattern.PLASTER),
    Material("bark", (0.09, 0.065, 0.045), Pattern.PLASTER),
    *_PAINT,
    *_COACH,
    *_BOX,
    *_CLOTH,
    *_SKIN,
    *_FACADE,
    *_LEAVES,
    *_SIGN,
)
"""All materials; a prism has the row of its material."""

GREY, GLASS, RUBBER, STEEL, CONCRETE, BARK = range(6)
"""Rows of the first materials."""
ROWS = {material.name: row for row, material in enumerate(MATERIALS)}


def first_of(family: str) -> int:
    """Return the row of a family's first material; the others follow."""
    return ROWS[f"{family}-0"]


@cache
def size_of(family: str) -> int:
    """Return how many materials a family has."""
    return sum(name.startswith(f"{family}-") for name in ROWS)


def graded(family: str, shares: np.ndarray | float) -> np.ndarray:
    """Return a row of the family for each share in 0 to 1, in the order of the family."""
    count = size_of(family)
    picked = np.minimum((np.asarray(shares) * count).astype(np.int64), count - 1)
    rows: np.ndarray = first_of(family) + np.maximum(picked, 0)
    return rows
