"""t_rel and r_rel: drift over stretches of given lengths, as KITTI has it.

A. Geiger, P. Lenz and R. Urtasun, "Are we ready for autonomous driving?", CVPR 2012.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.odometry.relative import pair_errors
from roadscope.benchmarks.metrics.odometry.trajectory import Trajectories
from roadscope.core.record import Record

SHORT_M = (50.0, 100.0, 200.0)
KITTI_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
KITTI_EVERY = 10
"""KITTI begins a stretch at every tenth frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Drift(Record):
    """Errors of motions over stretches of the way, divided by their length.

    lengths_m: (K,) metres, nominal length of each stretch. first: (K,) its first pose.
    translations: (K,) metres a metre. rotations: (K,) radians a metre.
    """

    lengths_m: np.ndarray
    first: np.ndarray
    translations: np.ndarray
    rotations: np.ndarray

    def __len__(self) -> int:
        return len(self.lengths_m)

    @property
    def t_rel(self) -> float:
        """Mean translation error in per cent of the length; NaN where no stretch is long enough."""
        return float(100 * self.translations.mean()) if len(self) else np.nan

    @property
    def r_rel(self) -> float:
        """Mean rotation error in degrees a 100 m."""
        return float(100 * np.rad2deg(self.rotations.mean())) if len(self) else np.nan

    def over(self, length_m: float) -> Drift:
        """Return the stretches of one length."""
        rows = self.lengths_m == length_m
        return Drift(
            self.lengths_m[rows], self.first[rows], self.translations[rows], self.rotations[rows]
        )

    def curve(self) -> list[tuple[float, float, float, int]]:
        """Return, by length in metres, t_rel, r_rel and the number of stretches."""
        parts = [(float(m), self.over(m)) for m in np.unique(self.lengths_m)]
        return [(m, part.t_rel, part.r_rel, len(part)) for m, part in parts]


def drift(
    both: Trajectories, lengths_m: Sequence[float] = SHORT_M, *, every: int = KITTI_EVERY
) -> Drift:
    """Return the drift over all stretches of these lengths that begin at every so many-th frame.

    A stretch ends with the first pose farther along the true way than its length; one that the
    way does not hold is left out. With `KITTI_M` this is KITTI's definition.
    """
    if every < 1:
        raise ValueError(f"every must be 1 or more frames, got {every}")
    if not all(length_m > 0 for length_m in lengths_m):
        raise ValueError(f"lengths must be above 0 m, got {tuple(lengths_m)}")
    way, begins = both.distances, np.arange(0, len(both), every)
    first, nominal = (a.ravel() for a in np.meshgrid(begins, lengths_m, indexing="ij"))
    last = np.searchsorted(way, way[first] + nominal, side="right")
    whole = last < len(both)
    first, last, nominal = first[whole], last[whole], nominal[whole]
    errors = pair_errors(both, first, last)
    return Drift(nominal, first, errors.translations_m / nominal, errors.rotations_rad / nominal)
