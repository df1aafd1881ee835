"""The rays of a scan that tell of one body: its returns, and the rays that passed beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import HIT, Rays
from roadscope.detectors.pose.body_sight_kernels import (
    ROUGHNESS_M,
    Beams,
    Motion,
    Returns,
    joined,
    need_of,
    picked,
    points_of,
    rays_of,
)
from roadscope.envs.sensors.lidar_spec import LidarSpec

BUDGET = 320
"""Returns above which neighbours are joined, unless said otherwise."""
BRINK = 3
"""Columns at either end of a sweep: of a body met there the rest may not have been met."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """What one scan tells of one body.

    rays: times in seconds from the scan's stamp.
    origin: (2,) of the sensor, metres, world frame. returns: how many the body sent back.
    cut: whether the sweep begins or ends on the body, so that only a part may have been met.
    """

    rays: Rays
    origin: np.ndarray
    returns: int
    cut: bool

    @property
    def points(self) -> np.ndarray:
        """(N, 2) returns of the body seen from above, metres, world frame."""
        return np.asarray(points_of(self.rays, np.zeros(2)))


def sight(
    spec: LidarSpec,
    scan: LidarScan,
    target: np.ndarray,
    world_from_lidar: Pose,
    *,
    sensor_velocity: np.ndarray | None = None,
    sensor_turn: float = 0.0,
    rolling: bool = True,
    budget: int = BUDGET,
    rough_m: float = ROUGHNESS_M,
) -> Sighting:
    """Pick out the rays that tell of a body.

    target: (N,) bool, which returns of the scan are the body's. world_from_lidar: at the stamp,
    z = 0 on the road. sensor_velocity: (2,) metres per second, world frame; sensor_turn: radians
    per second about its z axis. rolling: whether columns were measured one after the other, as a
    real sweep is, or all at the stamp.
    budget: returns above which neighbours are joined. rough_m: departure of the body's surface
    from the drawn one, metres.
    Of several returns of one ray the nearest counts, so duplicates and order change nothing.
    """
    target = np.asarray(target)
    if target.shape != (len(scan),) or target.dtype != np.bool_:
        raise ValueError(
            f"target must be one bool for each of the {len(scan)} returns, got "
            f"{target.dtype} {target.shape}"
        )
    returns = Returns(scan.points, scan.ring, scan.column, scan.intensity)
    told = np.zeros(2) if sensor_velocity is None else sensor_velocity
    velocity = settled_velocity("sensor_velocity", told)
    motion = Motion(world_from_lidar.matrix, velocity, float(sensor_turn), float(rolling))
    rays, hits = _rays(beams_of(spec), returns, target, motion, (budget, rough_m))
    met = scan.column[target]
    cut = rolling and bool(((met < BRINK) | (met >= spec.columns - BRINK)).any())
    return Sighting(rays, motion.matrix[:2, 3].copy(), int(hits), cut)


@compiled()
def _rays(
    beams: Beams,
    returns: Returns,
    target: np.ndarray,
    motion: Motion,
    told: tuple[int, float],
) -> tuple[Rays, int]:
    budget, rough_m = told
    grid = picked(returns, target, beams, budget)
    rays = rays_of(grid, beams, motion, (need_of(returns, target, beams), rough_m))
    return joined(rays, grid, budget, rough_m), (grid.kind == HIT).sum()


def settled_velocity(name: str, velocity: np.ndarray) -> np.ndarray:
    """Return a (2,) float64 velocity, m/s; ValueError when it is no finite one."""
    settled = np.ascontiguousarray(velocity, dtype=np.float64)
    if settled.shape != (2,) or not np.isfinite(settled).all():
        raise ValueError(f"{name} must be finite x and y in metres per second, got {velocity!r}")
    return settled


def beams_of(spec: LidarSpec) -> Beams:
    """Return a LiDAR as kernels want it."""
    step = spec.azimuth_span / spec.columns
    sweep = float(spec.azimuth_start), float(step), float(spec.sweep_s)
    limits = float(spec.range_noise_m), float(spec.range_max_m), float(spec.detection_limit)
    return Beams(spec.elevations, spec.firing_offsets_s, spec.columns, sweep, limits)
