"""Drives for tests of inertial sensing, and a simple integrator of their samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import ImuSamples, Pose
from roadscope.envs.sensors import STANDARD_GRAVITY_M_S2
from roadscope.envs.traffic import Timeline
from tests.envs.worlds import platoon

STEP_S = 0.05


def driven(pushes: np.ndarray, bends: np.ndarray, speed: float = 0.0) -> Timeline:
    """One vehicle in Euler steps: (K,) m/s^2 along the vehicle and (K,) 1/m of curvature."""
    count = len(pushes) + 1
    axles, yaws, speeds = np.zeros((count, 2)), np.zeros(count), np.full(count, speed)
    for k in range(count - 1):
        axles[k + 1] = axles[k] + STEP_S * speeds[k] * np.array([np.cos(yaws[k]), np.sin(yaws[k])])
        yaws[k + 1] = yaws[k] + STEP_S * speeds[k] * bends[k]
        speeds[k + 1] = max(speeds[k] + STEP_S * pushes[k], 0.0)
    one = platoon(1)
    return replace(
        one,
        stamps_s=STEP_S * np.arange(count),
        present=np.ones((count, 1), bool),
        axles=axles[:, None] + [50.0, 2.0],
        yaws=yaws[:, None],
        speeds=speeds[:, None],
        crashed=np.zeros((count, 1), bool),
    )


def stop_and_go(duration_s: float = 21.0) -> Timeline:
    """Set off, turn left and right, brake to a standstill, and again."""
    t = STEP_S * np.arange(round(duration_s / STEP_S))
    pushes = np.select([t % 10 < 1, t % 10 < 4, t % 10 < 6], [0.0, 2.5, 0.0], -3.0)
    return driven(pushes, 0.03 * np.sin(t) * (t > 1))


def at_rest(duration_s: float = 3.0) -> Timeline:
    still = np.zeros(round(duration_s / STEP_S))
    return driven(still, still)


def steady(push: float, bend: float, speed: float) -> Timeline:
    ones = np.ones(100)
    return driven(push * ones, bend * ones, speed)


def integrated(samples: ImuSamples, pose: Pose, velocity: np.ndarray) -> tuple[Pose, np.ndarray]:
    """Dead-reckon from the first sample to the last, trapezium by trapezium."""
    from scipy.spatial.transform import Rotation

    rotation, place = pose.rotation, pose.translation.copy()
    steps = np.diff(samples.stamps_s)
    turns = 0.5 * (samples.angular_velocity[1:] + samples.angular_velocity[:-1])
    for k, step in enumerate(steps):
        after = rotation @ Rotation.from_rotvec(turns[k] * step).as_matrix()
        pull = 0.5 * (
            rotation @ samples.specific_force[k] + after @ samples.specific_force[k + 1]
        ) - [0.0, 0.0, STANDARD_GRAVITY_M_S2]
        place += velocity * step + 0.5 * pull * step**2
        velocity, rotation = velocity + pull * step, after
    left, _, right = np.linalg.svd(rotation)
    return Pose.from_parts(left @ right, place), velocity
