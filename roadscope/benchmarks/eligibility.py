"""Eligibility: which objects an entry has to detect, decided from truth alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.benchmarks.metrics.matching import Pairing, centre_distances
from roadscope.core import Category, Detections, Family, Tracks, Truth
from roadscope.core.checks import require
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class Eligibility(Record):
    """The rule of a suite for which objects are eligible, the same for every entry.

    range_m: nearest and farthest distance of the box centre from the ego's rear axle, seen
        from above, metres.
    min_returns: least number of LiDAR returns in the scan; objects with fewer are invisible. Where
        the number is unknown (-1), they count as visible.
    families: which road users are eligible; others are neither misses nor false alarms.
    """

    range_m: tuple[float, float] = (0.0, 60.0)
    min_returns: int = 10
    families: tuple[str, ...] = (Family.VEHICLE.value,)

    def __post_init__(self) -> None:
        near, far = self.range_m
        require(0 <= near < far < np.inf, self, "range_m", "0 <= near < far", list(self.range_m))
        require(self.min_returns >= 1, self, "min_returns", "at least 1", self.min_returns)
        possible = [f.value for f in Family]
        are_known = bool(self.families) and all(f in possible for f in self.families)
        require(are_known, self, "families", f"some of {', '.join(possible)}", list(self.families))

    def of(self, truth: Truth) -> np.ndarray:
        """Return (M,) bool, which objects of a frame are eligible."""
        few = (truth.lidar_returns >= 0) & (truth.lidar_returns < self.min_returns)
        eligible: np.ndarray = self._in_scope(truth) & ~few
        return eligible

    def unseen(self, truth: Truth) -> int:
        """Return how many objects are not eligible only because they have too few returns."""
        return int((self._in_scope(truth) & ~self.of(truth)).sum())

    def _in_scope(self, truth: Truth) -> np.ndarray:
        """Return (M,) bool, which objects are of the families and in the range band."""
        of_families = _of_families(tuple(self.families))[truth.categories]
        chosen: np.ndarray = self.within(truth.centres, truth) & of_families
        return chosen

    def within(self, centres: np.ndarray, truth: Truth) -> np.ndarray:
        """Return (N,) bool, which world points lie in the range band around the ego."""
        distances = centre_distances(centres, truth.world_from_ego.translation[None])[:, 0]
        near, far = self.range_m
        inside: np.ndarray = (distances >= near) & (distances <= far)
        return inside

    def pairing(
        self, boxes: Detections | Tracks, truth: Truth, parked: np.ndarray | None = None
    ) -> Pairing:
        """Return the distances of detections or tracks, world frame, to the objects of a frame.

        parked: (P, 2) metres, world frame, parked cars: they come after the objects and are not
            eligible.
        """
        parked = np.empty((0, 2)) if parked is None else parked
        return Pairing(
            distances=centre_distances(
                boxes.centres, np.concatenate([truth.centres[:, :2], parked])
            ),
            eligible=np.concatenate([self.of(truth), np.zeros(len(parked), bool)]),
            counted=self.within(boxes.centres, truth),
        )

    def pairings(
        self,
        boxes: Sequence[Detections | Tracks],
        truths: Sequence[Truth],
        parked: np.ndarray | None = None,
    ) -> list[Pairing]:
        """Return `pairing` of every frame of an episode."""
        return [self.pairing(b, t, parked) for b, t in zip(boxes, truths, strict=True)]


@cache
def _of_families(families: tuple[str, ...]) -> np.ndarray:
    """Return (C,) bool, which categories are of these families."""
    return np.array([category.family.value in families for category in Category])
