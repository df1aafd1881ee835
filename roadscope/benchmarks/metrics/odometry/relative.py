"""RPE: how far off motions are from one pose to a later one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.odometry.trajectory import Trajectories, angles, inverses, motions
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class RelativeErrors(Record):
    """Relative pose errors (Sturm et al. 2012), one a pair of poses.

    translations_m: (K,) metres. rotations_rad: (K,) radians. lengths_m: (K,) metres driven
        from the first to the second of a pair, in truth.
    """

    translations_m: np.ndarray
    rotations_rad: np.ndarray
    lengths_m: np.ndarray

    def __len__(self) -> int:
        return len(self.translations_m)

    @property
    def rmse_m(self) -> float:
        """Root mean square of the translations' errors."""
        return float(np.sqrt(np.mean(self.translations_m**2))) if len(self) else np.nan

    @property
    def rmse_rad(self) -> float:
        """Root mean square of the rotations' errors."""
        return float(np.sqrt(np.mean(self.rotations_rad**2))) if len(self) else np.nan


def relative_errors(both: Trajectories, step: int = 1) -> RelativeErrors:
    """Return the errors of the motions between all poses that are so many frames apart."""
    if step < 1:
        raise ValueError(f"step must be 1 or more frames, got {step}")
    first = np.arange(max(len(both) - step, 0))
    return pair_errors(both, first, first + step)


def pair_errors(both: Trajectories, first: np.ndarray, last: np.ndarray) -> RelativeErrors:
    """Return the errors of the motions between poses by their numbers, (K,) each."""
    rest = inverses(motions(both.truth, first, last)) @ motions(both.estimate, first, last)
    lengths_m = both.distances[last] - both.distances[first]
    return RelativeErrors(
        np.linalg.norm(rest[:, :3, 3], axis=1), angles(rest[:, :3, :3]), lengths_m
    )
