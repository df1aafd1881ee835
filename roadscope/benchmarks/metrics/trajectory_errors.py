"""Errors of estimated trajectories: ATE, RPE, and drift as KITTI defines it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.names import unknown
from roadscope.core.record import Record

MOST_STRETCH = 1e-3
"""A singular value of a rotation may differ from 1 by this: files have few digits."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectories(Record):
    """An estimated and a true trajectory; rotations are made orthonormal.

    estimate, truth: (N, 4, 4) float64, poses of the same sensor at the same stamps, each in a
        frame of its own.
    """

    estimate: np.ndarray
    truth: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, estimate=(np.float64, ("N", 4, 4)), truth=(np.float64, ("N", 4, 4)))
        for name in ("estimate", "truth"):
            object.__setattr__(self, name, self._orthonormal(name))

    def __len__(self) -> int:
        return len(self.truth)

    def _orthonormal(self, name: str) -> np.ndarray:
        """Return poses with the nearest rotations; a pose that is no rigid motion is an error."""
        poses: np.ndarray = getattr(self, name)
        if not len(poses):
            return poses
        left, stretch, right = np.linalg.svd(poses[:, :3, :3])
        rigid = np.linalg.det(left @ right) > 0
        rigid &= np.abs(stretch - 1).max(axis=1) < MOST_STRETCH
        rigid &= (poses[:, 3] == (0, 0, 0, 1)).all(axis=1)
        wrong = np.flatnonzero(~rigid)
        shown = poses[wrong[0]].tolist() if len(wrong) else None
        require(not len(wrong), self, name, "rigid motions", shown)
        orthonormal = poses.copy()
        orthonormal[:, :3, :3] = left @ right
        return orthonormal

    @property
    def distances(self) -> np.ndarray:
        """(N,) true distance travelled since the first pose, metres."""
        steps = np.linalg.norm(np.diff(self.truth[:, :3, 3], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])[: len(self)]


def inverses(poses: np.ndarray) -> np.ndarray:
    """Return the inverses of (N, 4, 4) rigid motions."""
    inverted = np.zeros_like(poses)
    inverted[:, :3, :3] = poses[:, :3, :3].swapaxes(1, 2)
    inverted[:, :3, 3] = -np.einsum("nij,nj->ni", inverted[:, :3, :3], poses[:, :3, 3])
    inverted[:, 3, 3] = 1
    return inverted


def angles(rotations: np.ndarray) -> np.ndarray:
    """Return the angles of (N, 3, 3) rotations, (N,) radians, accurate for small ones too."""
    skew = rotations - rotations.swapaxes(1, 2)
    sine = np.sqrt(skew[:, 2, 1] ** 2 + skew[:, 0, 2] ** 2 + skew[:, 1, 0] ** 2) / 2
    cosine = (np.trace(rotations, axis1=1, axis2=2) - 1) / 2
    angle: np.ndarray = np.arctan2(sine, cosine)
    return angle


def motions(poses: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Return (K, 4, 4) motions `first_from_last` between poses with numbers (K,) and (K,)."""
    first_from_last: np.ndarray = inverses(poses[first]) @ poses[last]
    return first_from_last


# --------------------------------------------------------------------------------------------------
# Alignment: which motion brings an estimated trajectory nearest to the true one.

Alignment = Literal["none", "origin", "yaw", "se3"]
ALIGNMENTS = ("none", "origin", "yaw", "se3")


def aligned(trajectories: Trajectories, alignment: Alignment) -> np.ndarray:
    """Return the (N, 4, 4) estimated poses in the truth's frame.

    none: as they are, for poses in the same frame. origin: first pose on first pose, which uses
    no later pose. yaw: the shift and the turn about z, se3: the rigid motion, that give the least
    sum of squared distances (Umeyama 1991, without scale).
    """
    estimate, truth = trajectories.estimate, trajectories.truth
    if alignment not in ALIGNMENTS:
        raise ValueError(unknown("alignment", alignment, ALIGNMENTS))
    if alignment == "none" or not len(trajectories):
        return estimate
    if alignment == "origin":
        moved: np.ndarray = truth[0] @ np.linalg.inv(estimate[0]) @ estimate
        return moved
    moved = (
        truth_from_estimate(estimate[:, :3, 3], truth[:, :3, 3], yaw_only=alignment == "yaw")
        @ estimate
    )
    return moved


def truth_from_estimate(
    estimate: np.ndarray, truth: np.ndarray, *, yaw_only: bool = False
) -> np.ndarray:
    """Return the (4, 4) motion that brings (N, 3) positions nearest to others.

    Where positions leave a rotation open (all on one line, say), one of the best is returned.
    """
    centre, truth_centre = estimate.mean(axis=0), truth.mean(axis=0)
    covariance = (truth - truth_centre).T @ (estimate - centre) / len(truth)
    matrix = np.eye(4)
    if yaw_only:
        yaw = np.arctan2(covariance[1, 0] - covariance[0, 1], covariance[0, 0] + covariance[1, 1])
        cos, sin = np.cos(yaw), np.sin(yaw)
        matrix[:2, :2] = [[cos, -sin], [sin, cos]]
    else:
        left, _, right = np.linalg.svd(covariance)
        mirror = np.sign(np.linalg.det(left) * np.linalg.det(right))
        matrix[:3, :3] = left @ np.diag([1.0, 1.0, mirror]) @ right
    matrix[:3, 3] = truth_centre - matrix[:3, :3] @ centre
    return matrix


# --------------------------------------------------------------------------------------------------
# ATE: errors of positions.


@dataclass(frozen=True, slots=True, eq=False)
class AbsoluteErrors(Record):
    """Absolute trajectory errors of N aligned poses (Sturm et al. 2012), 0 and more.

    positions_m: (N,) distance from the true position. rotations_rad: (N,) angle from the true
    rotation, 0 to pi. distances_m: (N,) true distance travelled so far.
    """

    positions_m: np.ndarray
    rotations_rad: np.ndarray
    distances_m: np.ndarray

    def __len__(self) -> int:
        return len(self.positions_m)

    @property
    def rmse_m(self) -> float:
        """ATE, the root mean square of `positions_m`; nan without a pose."""
        return float(np.sqrt(np.mean(self.positions_m**2))) if len(self) else np.nan

    @property
    def end_m(self) -> float:
        """Error of the last position, metres; nan without a pose."""
        return float(self.positions_m[-1]) if len(self) else np.nan


def absolute_errors(trajectories: Trajectories, alignment: Alignment = "se3") -> AbsoluteErrors:
    """Return the errors of each pose after the estimate is aligned with the truth."""
    errors = inverses(trajectories.truth) @ aligned(trajectories, alignment)
    return AbsoluteErrors(
        np.linalg.norm(errors[:, :3, 3], axis=1), angles(errors[:, :3, :3]), trajectories.distances
    )


# --------------------------------------------------------------------------------------------------
# RPE: errors of motions from one pose to a later one.


@dataclass(frozen=True, slots=True, eq=False)
class RelativeErrors(Record):
    """Relative pose errors of K pairs of poses (Sturm et al. 2012), 0 and more.

    translations_m: (K,) metres. rotations_rad: (K,) radians, 0 to pi.
    lengths_m: (K,) true distance travelled from the first to the second pose of a pair.
    """

    translations_m: np.ndarray
    rotations_rad: np.ndarray
    lengths_m: np.ndarray

    def __len__(self) -> int:
        return len(self.translations_m)

    @property
    def rmse_m(self) -> float:
        """RPE, the root mean square of `translations_m`; nan without a pair."""
        return float(np.sqrt(np.mean(self.translations_m**2))) if len(self) else np.nan

    @property
    def rmse_rad(self) -> float:
        """RPE of rotation, the root mean square of `rotations_rad`; nan without a pair."""
        return float(np.sqrt(np.mean(self.rotations_rad**2))) if len(self) else np.nan


def relative_errors(trajectories: Trajectories, step: int = 1) -> RelativeErrors:
    """Return the errors of the motions between all poses that are `step` frames apart."""
    if step < 1:
        raise ValueError(f"step must be 1 or more frames, got {step}")
    first = np.arange(max(len(trajectories) - step, 0))
    return pair_errors(trajectories, first, first + step)


def pair_errors(trajectories: Trajectories, first: np.ndarray, last: np.ndarray) -> RelativeErrors:
    """Return the errors of the motions between poses with numbers (K,) and (K,)."""
    truth, estimate = (motions(p, first, last) for p in (trajectories.truth, trajectories.estimate))
    errors = inverses(truth) @ estimate
    distances_m = trajectories.distances
    return RelativeErrors(
        np.linalg.norm(errors[:, :3, 3], axis=1),
        angles(errors[:, :3, :3]),
        distances_m[last] - distances_m[first],
    )


# --------------------------------------------------------------------------------------------------
# Drift: errors of motions over stretches of given lengths, as KITTI has it.

SHORT_M = (50.0, 100.0, 200.0)
"""Lengths of stretches for episodes of this house, which are too short for KITTI's."""
KITTI_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
KITTI_EVERY = 10
"""KITTI begins a stretch at every tenth frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Drift(Record):
    """Errors of motions over K stretches, divided by their length (Geiger et al. 2012).

    lengths_m: (K,) nominal length of each stretch. first: (K,) its first pose.
    translations: (K,) metres per metre. rotations: (K,) radians per metre.
    """

    lengths_m: np.ndarray
    first: np.ndarray
    translations: np.ndarray
    rotations: np.ndarray

    def __len__(self) -> int:
        return len(self.lengths_m)

    @property
    def t_rel(self) -> float:
        """Mean translation error, per cent of the length; nan if no stretch is long enough."""
        return float(100 * self.translations.mean()) if len(self) else np.nan

    @property
    def r_rel(self) -> float:
        """Mean rotation error, degrees per 100 m; nan if no stretch is long enough."""
        return float(100 * np.rad2deg(self.rotations.mean())) if len(self) else np.nan

    def over(self, length_m: float) -> Drift:
        """Return the stretches of one length."""
        rows = self.lengths_m == length_m
        return Drift(
            self.lengths_m[rows], self.first[rows], self.translations[rows], self.rotations[rows]
        )

    def curve(self) -> list[tuple[float, float, float, int]]:
        """Return for each length: metres, t_rel, r_rel and the number of stretches."""
        parts = [(float(m), self.over(m)) for m in np.unique(self.lengths_m)]
        return [(m, part.t_rel, part.r_rel, len(part)) for m, part in parts]


def drift(
    trajectories: Trajectories, lengths_m: Sequence[float] = SHORT_M, *, every: int = KITTI_EVERY
) -> Drift:
    """Return the drift over all stretches of these lengths that begin at every `every`-th frame.

    A stretch ends with the first pose that is farther along the true trajectory than its length;
    one that is longer than the rest of the trajectory is left out. With `KITTI_M` this is KITTI's
    definition (Geiger et al. 2012).
    """
    if every < 1:
        raise ValueError(f"every must be 1 or more frames, got {every}")
    if not all(length_m > 0 for length_m in lengths_m):
        raise ValueError(f"lengths must be above 0 m, got {tuple(lengths_m)}")
    distances_m, begins = trajectories.distances, np.arange(0, len(trajectories), every)
    first, nominal = (a.ravel() for a in np.meshgrid(begins, lengths_m, indexing="ij"))
    last = np.searchsorted(distances_m, distances_m[first] + nominal, side="right")
    complete = last < len(trajectories)
    first, last, nominal = first[complete], last[complete], nominal[complete]
    errors = pair_errors(trajectories, first, last)
    return Drift(nominal, first, errors.translations_m / nominal, errors.rotations_rad / nominal)
