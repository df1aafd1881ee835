"""Noise model of odometry: true poses with drift, noise and jumps of known size.

It is named by a string, as plug-ins are: `noisy-odometry?scale=0.02&turn_deg=1`. It belongs to the
benchmark; results that use it are labelled. On the odometry board it shows how metrics respond to
known errors; trackers can get the ego's poses from it, with a known drift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from roadscope.core import Pose, Registry
from roadscope.odometry.rigid import exp_se3


@dataclass(frozen=True, slots=True, kw_only=True)
class EgoNoise:
    """The sizes of the errors of estimated motions.

    scale: share by which all distances are too long; negative: too short.
    turn_deg: systematic error of the yaw, degrees per 100 m.
    shift_m, shake_deg: standard deviations of the motion from scan to scan, along each axis and
        about it; they add up as a random walk.
    jump: share of scans at which the pose jumps and does not come back. jump_m: standard deviation
        of a jump in x and y.
    """

    scale: float = 0.01
    turn_deg: float = 0.5
    shift_m: float = 0.005
    shake_deg: float = 0.01
    jump: float = 0.0
    jump_m: float = 1.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (isinstance(value, (int, float)) and np.isfinite(value)):
                raise ValueError(f"{field.name} must be a number, got {value!r}")
            if value < 0 and field.name not in ("scale", "turn_deg"):
                raise ValueError(f"{field.name} must be 0 or more, got {value!r}")
        if self.jump > 1 or self.scale <= -1:
            raise ValueError("jump must be at most 1 and scale above -1")


ODOMETRY_NOISES: Registry[EgoNoise] = Registry(
    "odometry noise model",
    {"noisy-odometry": "roadscope.benchmarks.noisy_odometry:EgoNoise"},
    summaries={"noisy-odometry": "True poses with drift, noise and jumps; on boards."},
)


def noisy_poses(noise: EgoNoise, truth: Sequence[Pose], seed: int) -> list[Pose]:
    """Return `start_from_lidar` for each true `world_from_lidar`; the first is the identity.

    The same noise, poses and seed give the same bytes.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    poses = [Pose.identity()] if truth else []
    for before, now in pairwise(truth):
        motion = before.inverse() @ now
        poses.append(poses[-1] @ _noisy_motion(noise, motion, rng))
    return poses


def _noisy_motion(noise: EgoNoise, motion: Pose, rng: np.random.Generator) -> Pose:
    """Return a motion from scan to scan with its errors."""
    matrix = motion.matrix.copy()
    distance_m = float(np.linalg.norm(matrix[:3, 3]))
    matrix[:3, 3] *= 1 + noise.scale
    error = np.concatenate(
        [
            noise.shift_m * rng.standard_normal(3),
            np.deg2rad(noise.shake_deg) * rng.standard_normal(3),
        ]
    )
    error[5] += np.deg2rad(noise.turn_deg) * distance_m / 100
    jumps, jump_m = rng.random() < noise.jump, noise.jump_m * rng.standard_normal(2)
    error[:2] += jumps * jump_m
    return Pose(matrix @ exp_se3(error))
