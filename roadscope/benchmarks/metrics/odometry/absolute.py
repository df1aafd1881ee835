"""ATE: how far estimated places are from true ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.odometry.alignment import Alignment, aligned
from roadscope.benchmarks.metrics.odometry.trajectory import (
    Trajectories,
    angles,
    inverses,
)
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class AbsoluteErrors(Record):
    """Absolute trajectory errors (Sturm et al. 2012) of each pose.

    positions_m: (N,) metres. rotations_rad: (N,) radians. distances_m: (N,) driven so far.
    """

    positions_m: np.ndarray
    rotations_rad: np.ndarray
    distances_m: np.ndarray

    def __len__(self) -> int:
        return len(self.positions_m)

    @property
    def rmse_m(self) -> float:
        """Root mean square of the positions' errors: what is called ATE."""
        return float(np.sqrt(np.mean(self.positions_m**2))) if len(self) else np.nan

    @property
    def end_m(self) -> float:
        """Error of the last position."""
        return float(self.positions_m[-1]) if len(self) else np.nan


def absolute_errors(both: Trajectories, alignment: Alignment = "se3") -> AbsoluteErrors:
    """Return how far each pose is from the true one, once the trajectories are aligned."""
    rest = inverses(both.truth) @ aligned(both, alignment)
    return AbsoluteErrors(
        np.linalg.norm(rest[:, :3, 3], axis=1), angles(rest[:, :3, :3]), both.distances
    )
