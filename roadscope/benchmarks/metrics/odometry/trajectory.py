"""Poses of one sensor, estimated and true, at the same stamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record

ASKEW = 1e-3
"""Rotations farther than this from orthonormal are none; files print few digits."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectories(Record):
    """Two trajectories to be compared; rotations that are a little askew are put right.

    estimate, truth: (N, 4, 4) float64, poses of the same sensor at the same stamps, each in a
        frame of its own.
    """

    estimate: np.ndarray
    truth: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, estimate=(np.float64, ("N", 4, 4)), truth=(np.float64, ("N", 4, 4)))
        for name in ("estimate", "truth"):
            object.__setattr__(self, name, self._proper(name))

    def __len__(self) -> int:
        return len(self.truth)

    def _proper(self, name: str) -> np.ndarray:
        poses: np.ndarray = getattr(self, name)
        if not len(poses):
            return poses
        left, stretch, right = np.linalg.svd(poses[:, :3, :3])
        upright = np.linalg.det(left @ right) > 0
        rigid = upright & (np.abs(stretch - 1).max(axis=1) < ASKEW)
        rigid &= (poses[:, 3] == (0, 0, 0, 1)).all(axis=1)
        wrong = np.flatnonzero(~rigid)
        shown = poses[wrong[0]].tolist() if len(wrong) else None
        require(not len(wrong), self, name, "rigid motions", shown)
        proper = poses.copy()
        proper[:, :3, :3] = left @ right
        return proper

    @property
    def distances(self) -> np.ndarray:
        """(N,) metres driven since the first pose, in truth."""
        steps = np.linalg.norm(np.diff(self.truth[:, :3, 3], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])[: len(self)]


def inverses(poses: np.ndarray) -> np.ndarray:
    """Return the inverses of (N, 4, 4) rigid motions."""
    undone = np.zeros_like(poses)
    undone[:, :3, :3] = poses[:, :3, :3].swapaxes(1, 2)
    undone[:, :3, 3] = -np.einsum("nij,nj->ni", undone[:, :3, :3], poses[:, :3, 3])
    undone[:, 3, 3] = 1
    return undone


def angles(rotations: np.ndarray) -> np.ndarray:
    """Return by how much (N, 3, 3) rotations turn, (N,) radians, exact for small turns too."""
    skew = rotations - rotations.swapaxes(1, 2)
    sine = np.sqrt(skew[:, 2, 1] ** 2 + skew[:, 0, 2] ** 2 + skew[:, 1, 0] ** 2) / 2
    turned: np.ndarray = np.arctan2(sine, (np.trace(rotations, axis1=1, axis2=2) - 1) / 2)
    return turned


def motions(poses: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Return the (K, 4, 4) motions `first_from_last` between poses by their numbers, (K,)."""
    between: np.ndarray = inverses(poses[first]) @ poses[last]
    return between
