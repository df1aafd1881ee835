"""What rays can hit: upright prisms with convex footprints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record

MAX_EDGES = 12
"""Most corners that a footprint may have."""


@dataclass(frozen=True, slots=True, eq=False)
class Prisms(Record):
    """M upright prisms; every body is a stack of them.

    footprints: (M, 12, 2) float64, metres, convex, counter-clockwise, the last corner repeated
        up to 12; in the frame of the owner (box centre on the ground, x ahead) or, for scenery,
        in the world frame.
    corners: (M,) int32, how many of the 12 corners are distinct, at least 3.
    bottoms, tops: (M,) float64, metres above the ground, top above bottom.
    owners: (M,) int32, row of the owner among the actors, or -2 and below for scenery.
    extinctions: (M,) float64, 1/m; 0 is solid, otherwise a ray that enters meets something
        after an exponentially distributed path with this rate and may pass through (foliage).
    reflectivities: (M,) float32 in 0 to 1, at normal incidence, 905 nm.
    materials: (M,) int16, rows of `materials.MATERIALS`: what cameras see.
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
            np.empty((0, MAX_EDGES, 2)), np.empty(0, np.int32), none, none,
            np.empty(0, np.int32), none, np.empty(0, np.float32), np.empty(0, np.int16), none,
        )  # fmt: skip

    @staticmethod
    def of(
        footprint: np.ndarray, bottom_m: float, top_m: float,
        *, owner: int = 0, extinction: float = 0.0, reflectivity: float = 0.5,
        material: int = 0,
    ) -> Prisms:  # fmt: skip
        """Make one prism from a (K, 2) convex, counter-clockwise footprint, K up to 12."""
        corners = len(footprint)
        if not 3 <= corners <= MAX_EDGES:
            raise ValueError(f"a footprint has 3 to {MAX_EDGES} corners, got {corners}")
        padded = np.concatenate([footprint, np.repeat(footprint[-1:], MAX_EDGES - corners, axis=0)])
        return Prisms(
            padded[None],
            np.array([corners]),
            np.array([bottom_m]),
            np.array([top_m]),
            np.array([owner]),
            np.array([extinction]),
            np.array([reflectivity]),
            np.array([material]),
            np.zeros(1),
        )

    @staticmethod
    def join(parts: Sequence[Prisms]) -> Prisms:
        """Put prisms one after the other."""
        if not parts:
            return Prisms.empty()
        return Prisms(*(np.concatenate([getattr(p, n) for p in parts]) for n in Prisms.__slots__))

    def select(self, index: np.ndarray) -> Prisms:
        """Keep the rows that a mask or an index array names."""
        return Prisms(*(getattr(self, name)[index] for name in Prisms.__slots__))
