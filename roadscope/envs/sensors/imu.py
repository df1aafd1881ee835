"""Inertial samples of a vehicle's motion."""

from __future__ import annotations

import numpy as np

from roadscope.core import ImuSamples
from roadscope.envs.sensors.ego_motion import EgoMotion
from roadscope.envs.sensors.imu_noise import ImuNoise
from roadscope.envs.sensors.rig import ImuMount

GRAVITY_M_S2 = 9.80665
"""Magnitude of gravity; it points down in the world frame."""


def measure(
    motion: EgoMotion, mount: ImuMount, noise: ImuNoise, first: int, last: int
) -> ImuSamples:
    """Return samples number first to last; sample n is taken n periods after 0.

    With bandwidth the unit answers a little late, as its low-pass does.
    """
    spec = mount.spec
    weights = spec.response()
    numbers = np.arange(first - len(weights) + 1, last + 1)
    values = felt(motion, mount, numbers / spec.rate_hz)
    drawn = np.maximum(numbers, 0)
    values = values + noise.white(int(drawn[0]), int(drawn[-1]))[drawn - drawn[0]]
    passed = np.zeros((last - first + 1, 6))
    for back, weight in enumerate(weights):
        end = len(values) - back
        passed += weight * values[end - len(passed) : end]
    passed += noise.biases(first, last)
    gyro = np.clip(passed[:, :3], -spec.gyro_range, spec.gyro_range)
    force = np.clip(passed[:, 3:], -spec.accelerometer_range, spec.accelerometer_range)
    return ImuSamples(np.arange(first, last + 1) / spec.rate_hz, gyro, force)


def felt(motion: EgoMotion, mount: ImuMount, stamps_s: np.ndarray) -> np.ndarray:
    """(T, 6) true angular velocity and specific force in the imu frame at (T,) stamps."""
    here = motion.at(stamps_s, mount.ego_from_imu.translation)
    ego_from_imu = mount.ego_from_imu.rotation
    gravity = np.array([0.0, 0.0, -GRAVITY_M_S2])
    force = np.einsum("tji,tj->ti", here.rotations @ ego_from_imu, here.accelerations - gravity)
    turn = np.einsum("ji,tj->ti", ego_from_imu, here.angular_velocities)
    return np.concatenate([turn, force], axis=1)
