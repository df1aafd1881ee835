"""Upright prisms with convex footprints: all bodies and things consist of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record
from roadscope.core.tables import ArrayTable

# --------------------------------------------------------------------------------------------------
# Convex outlines from above.


def rectangle(length_m: float, width_m: float) -> np.ndarray:
    """(4, 2) corners of a rectangle along x, counter-clockwise."""
    half = np.array([length_m, width_m]) / 2
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half


_ARC = np.array([[0.0, -1.0], [np.sqrt(0.5), -np.sqrt(0.5)], [1.0, 0.0]])
_TURNED = _ARC[:, ::-1] * (-1, 1)
_QUARTERS = np.stack([_ARC, _TURNED, -_ARC, -_TURNED])
"""Three points on each quarter of the unit circle, from below the x axis on."""
_SIDES = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]])


def rounded(
    length_m: float, width_m: float, radius_m: float, centre_x_m: float = 0.0
) -> np.ndarray:
    """(12, 2) corners of a rectangle along x whose corners are arcs of three points.

    Its extents are exactly length and width; the radius is cut to half the shorter side.
    """
    radius = min(radius_m, 0.499 * length_m, 0.499 * width_m)
    middles = _SIDES * (length_m / 2 - radius, width_m / 2 - radius) + (centre_x_m, 0.0)
    corners: np.ndarray = (radius * _QUARTERS + middles[:, None]).reshape(12, 2)
    return corners


def ellipse(length_m: float, width_m: float, corners: int = 8) -> np.ndarray:
    """(corners, 2) polygon inscribed in an ellipse, touching its four extreme points.

    corners: a multiple of four up to 12.
    """
    angles = 2 * np.pi * np.arange(corners) / corners
    return np.stack([length_m / 2 * np.cos(angles), width_m / 2 * np.sin(angles)], axis=1)


def placed(template: np.ndarray, centres: np.ndarray, yaws: np.ndarray) -> np.ndarray:
    """Return (m, K, 2) outlines, turned and shifted to (m, 2) centres and (m,) yaws."""
    cos, sin = np.cos(yaws), np.sin(yaws)
    turn = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], 1)
    result: np.ndarray = template @ turn + centres[:, None, :]
    return result


def padded(outlines: np.ndarray) -> np.ndarray:
    """Return (m, K, 2) outlines with the last corner repeated up to 12 corners."""
    missing = MAX_EDGES - outlines.shape[1]
    return np.concatenate([outlines, np.repeat(outlines[:, -1:], missing, axis=1)], axis=1)


# --------------------------------------------------------------------------------------------------
# Upright prisms.

MAX_EDGES = 12
"""Most corners that a footprint may have."""


class Slab(NamedTuple):
    """One prism under construction, unchecked; fields as in `Prisms`.

    outline: (K, 2) metres, convex, counter-clockwise, K up to 12.
    """

    outline: np.ndarray
    bottom_m: float
    top_m: float
    owner: int = 0
    extinction: float = 0.0
    reflectivity: float = 0.5
    material: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Prisms(ArrayTable, Record):
    """M upright prisms; every body is a stack of them.

    footprints: (M, 12, 2) float64, metres, convex, counter-clockwise, the last corner repeated
        up to 12; in the frame of the owner (box centre on the ground, x ahead) or, for scenery,
        in the world frame.
    corners: (M,) int32, how many of the 12 corners are distinct, at least 3.
    bottoms, tops: (M,) float64, metres above the ground, top above bottom.
    owners: (M,) int32, row of the owner among the actors, or -2 and below for scenery.
    extinctions: (M,) float64, 1/m; 0 is solid, otherwise a ray that enters hits a leaf
        after an exponentially distributed path with this rate and may pass through (foliage).
    reflectivities: (M,) float32 in 0 to 1, at normal incidence, 905 nm.
    materials: (M,) int16, rows of `materials.MATERIALS`, for cameras.
    headings: (M,) float64, radians, the direction ahead of the thing in the footprint's frame.
    """

    footprints: np.ndarray
    corners: np.ndarray
    bottoms: np.ndarray
    tops: np.ndarray
    owners: np.ndarray
    extinctions: np.ndarray
    reflectivities: np.ndarray
    materials: np.ndarray
    headings: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            footprints=(np.float64, ("M", MAX_EDGES, 2)),
            corners=(np.int32, ("M",)),
            bottoms=(np.float64, ("M",)),
            tops=(np.float64, ("M",)),
            owners=(np.int32, ("M",)),
            extinctions=(np.float64, ("M",)),
            reflectivities=(np.float32, ("M",)),
            materials=(np.int16, ("M",)),
            headings=(np.float64, ("M",)),
        )
        require(
            bool((self.tops > self.bottoms).all()), self, "tops", "tops above bottoms", "others"
        )
        require(bool((self.corners >= 3).all()), self, "corners", "at least 3 corners", "fewer")

    def __len__(self) -> int:
        return len(self.corners)

    @staticmethod
    def empty() -> Prisms:
        """Return no prisms."""
        none = np.empty(0)
        return Prisms(
            np.empty((0, MAX_EDGES, 2)),
            np.empty(0, np.int32),
            none,
            none,
            np.empty(0, np.int32),
            none,
            np.empty(0, np.float32),
            np.empty(0, np.int16),
            none,
        )

    @staticmethod
    def of(
        footprint: np.ndarray,
        bottom_m: float,
        top_m: float,
        *,
        owner: int = 0,
        extinction: float = 0.0,
        reflectivity: float = 0.5,
        material: int = 0,
    ) -> Prisms:
        """Return one prism with a (K, 2) convex, counter-clockwise footprint, K up to 12."""
        return Prisms.stacked(
            [Slab(footprint, bottom_m, top_m, owner, extinction, reflectivity, material)]
        )

    @staticmethod
    def stacked(slabs: Sequence[Slab]) -> Prisms:
        """Return a prism for each slab."""
        if not slabs:
            return Prisms.empty()
        outlines, bottoms, tops, owners, extinctions, reflectivities, materials = zip(
            *slabs, strict=True
        )
        footprints = np.empty((len(slabs), MAX_EDGES, 2))
        for footprint, outline in zip(footprints, outlines, strict=True):
            if not 3 <= len(outline) <= MAX_EDGES:
                raise ValueError(f"a footprint has 3 to {MAX_EDGES} corners, got {len(outline)}")
            footprint[: len(outline)], footprint[len(outline) :] = outline, outline[-1]
        return Prisms(
            footprints,
            np.array(list(map(len, outlines)), np.int32),
            np.array(bottoms, np.float64),
            np.array(tops, np.float64),
            np.array(owners, np.int32),
            np.array(extinctions, np.float64),
            np.array(reflectivities, np.float32),
            np.array(materials, np.int16),
            np.zeros(len(slabs)),
        )

    @staticmethod
    def join(parts: Sequence[Prisms]) -> Prisms:
        """Return all prisms one after the other."""
        if not parts:
            return Prisms.empty()
        return Prisms(*(np.concatenate([getattr(p, n) for p in parts]) for n in Prisms.__slots__))
