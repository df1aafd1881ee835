"""What a frame's rays measured near the car, and how likely that is wherever the car may stand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.papers.zhang2017_drives import FRAME_S
from roadscope.benchmarks.papers.zhang2017_floor_kernels import (
    Bodies,
    Rays,
    Receiver,
    add_log_likelihoods,
)
from roadscope.benchmarks.papers.zhang2017_scene import Run, sensor_path
from roadscope.envs.sensors.lidar_spec import LidarSpec
from roadscope.envs.world.ford_saloon import HEIGHT_M, LENGTH_M, WIDTH_M

PRIOR_M, PRIOR_RAD = 0.6, np.radians(15.0)
"""The prior is flat this far around the truth, so that half a turn is no second answer."""
REACH_M = float(np.hypot(LENGTH_M, WIDTH_M)) / 2 + PRIOR_M
GROUND = 0.15


class View(NamedTuple):
    """A frame's rays, those prisms of the bodies that they can meet, and the sensor."""

    rays: Rays
    bodies: Bodies
    receiver: Receiver

    def log_densities(self, offsets: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Return likelihood and prior of offsets (N, 3) of bodies (N,), as logarithms (N,)."""
        beyond = np.abs(offsets) / (PRIOR_M, PRIOR_M, PRIOR_RAD)
        out: np.ndarray = -1e3 * np.maximum(beyond.max(axis=1) - 1.0, 0.0)
        add_log_likelihoods((offsets, which), self.rays, self.bodies, self.receiver, out)
        return out

    def thinned(self, stride: int) -> View:
        """Keep one column of so many."""
        kept, rays = slice(stride // 2, None, stride), self.rays
        columns = (rays.origins[kept], rays.directions[kept], rays.observed[kept])
        thin = rays._replace(origins=columns[0], directions=columns[1], observed=columns[2])
        return self._replace(rays=thin)


def view_of(run: Run, k: int, bodies: Bodies) -> View:
    """Return how a frame sees bodies around the car's true pose."""
    rays = rays_of(run, k)
    away = np.linalg.norm(rays.origins, axis=1)
    ends = np.array([max(away.min() - REACH_M, 0.1), away.max() + REACH_M])
    heights = run.sensor_height_m + np.outer(rays.slopes, ends)
    low, high = heights.min(axis=1)[:, None], heights.max(axis=1)[:, None]
    met = ((low < bodies.spans[:, 1]) & (high > bodies.spans[:, 0])).any(axis=0)
    parts = Bodies(
        np.ascontiguousarray(bodies.planes[:, met]), np.ascontiguousarray(bodies.corners[:, met]),
        bodies.spans[met], bodies.reflectivities[met], bodies.boxes[met],
    )  # fmt: skip
    return View(rays, parts, receiver_of(run.spec))


def rays_of(run: Run, k: int) -> Rays:
    """Return the rays of a frame that may meet the car, as seen from its true pose."""
    shot, spec = run.shots[k], run.spec
    stamps = np.full(spec.columns, FRAME_S * k)
    if run.drive.rolling:
        stamps = stamps + spec.column_offsets_s()
    car = run.drive.car(stamps)
    rotations, positions = sensor_path(run.drive, run.sensor_height_m, shot.phase)(stamps)
    azimuths = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]) + spec.azimuths() - car[:, 2]
    c, s = np.cos(car[:, 2]), np.sin(car[:, 2])
    dx, dy = (positions[:, :2] - car[:, :2]).T
    origins = np.column_stack([c * dx + s * dy, c * dy - s * dx])
    directions = np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    columns = np.flatnonzero(_near(origins, directions))
    slopes = np.tan(spec.elevations)
    away = np.linalg.norm(origins[columns], axis=1)
    nearest, farthest = max(away.min() - REACH_M, 0.1), away.max() + REACH_M
    heights = run.sensor_height_m + np.outer(slopes, [nearest, farthest])
    beams = np.flatnonzero((heights.max(axis=1) > 0.0) & (heights.min(axis=1) < HEIGHT_M))
    observed = np.zeros((spec.columns, spec.beams))
    observed[shot.scan.column, shot.scan.ring] = np.linalg.norm(
        shot.scan.points.astype(np.float64), axis=1
    )
    return Rays(
        origins[columns], directions[columns], run.sensor_height_m,
        slopes[beams], np.cos(spec.elevations[beams]),
        np.ascontiguousarray(observed[np.ix_(columns, beams)]),
    )  # fmt: skip


def _near(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(C,) bool: lines that come near the box for some pose within the prior."""
    turns = np.array([-PRIOR_RAD, 0.0, PRIOR_RAD])
    c, s = np.cos(turns)[:, None], np.sin(turns)[:, None]
    x, y = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]).T * np.array([[LENGTH_M], [WIDTH_M]]) / 2
    corners = np.stack([c * x - s * y, s * x + c * y], axis=-1).reshape(-1, 2)
    offsets = corners[None] - origins[:, None]
    across = offsets[..., 0] * directions[:, 1:] - offsets[..., 1] * directions[:, :1]
    ahead = (offsets * directions[:, None]).sum(axis=2).max(axis=1) > -PRIOR_M
    near: np.ndarray = ahead & (across.min(axis=1) < PRIOR_M) & (across.max(axis=1) > -PRIOR_M)
    return near


def receiver_of(spec: LidarSpec) -> Receiver:
    """Return what the sensor does to a range."""
    return Receiver(
        spec.range_noise_m, spec.range_min_m, spec.range_max_m, spec.dropout,
        spec.detection_limit, GROUND,
    )  # fmt: skip
