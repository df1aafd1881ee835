"""The information floor: the least error that any estimator can have on Zhang 2017's drives.

The posterior of the car's pose is computed from everything the sensor measured near it, with the
very model that made the measurements: the body's prisms, every ray with its range noise or its
silence, lost returns, the way of car and sensor during a sweep. Its covariance is the mean square
error of the best estimator there is, for a pose not known beforehand. Rays that pass close by the
silhouette say as much as those that meet it, and what they say is a bound, not a slope: a
Cramer-Rao bound of the ranges misses it, sampling does not.

Over several frames the car keeps a constant speed and turn rate, both unknown, and moves along
its heading.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from roadscope.benchmarks.papers.posterior import moments
from roadscope.benchmarks.papers.zhang2017_drives import FRAME_S
from roadscope.benchmarks.papers.zhang2017_floor_kernels import (
    Body,
    Rays,
    Receiver,
    add_log_likelihoods,
)
from roadscope.benchmarks.papers.zhang2017_scene import Run, sensor_path, target_body
from roadscope.core.pose import wrap_angle
from roadscope.envs.sensors.lidar_spec import LidarSpec
from roadscope.envs.world.ford_fusion import HEIGHT_M, LENGTH_M, WIDTH_M

FEWEST = 3
"""Frames with fewer returns of the car have no floor: they are not scored."""
PRIOR_M, PRIOR_RAD = 0.6, np.radians(15.0)
"""The prior is flat this far around the truth, so that half a turn is no second answer."""
SPEED_M_S, RATE_RAD_S = 20.0, np.radians(60.0)
"""Standard deviations of the first proposal of speed and turn rate; their prior is flat."""
REACH_M = float(np.hypot(LENGTH_M, WIDTH_M)) / 2 + PRIOR_M
COLUMNS, RAYS = 120, 500_000
"""Columns with which the search begins, and rays a stage casts before it makes do with less."""
GROUND = 0.15


@dataclass(frozen=True, slots=True)
class Floor:
    """K frames; NaN where a frame has too few returns.

    errors: (K, 3) posterior mean minus truth: along and across the car (metres), yaw (radians).
    covariances: (K, 3, 3) of the same.
    shares: (K,) effective share of the sample, 0 where the sampling failed.
    """

    errors: np.ndarray
    covariances: np.ndarray
    shares: np.ndarray

    @property
    def position_m(self) -> np.ndarray:
        """(K,) root of the expected squared distance."""
        return _root(self.covariances[:, 0, 0] + self.covariances[:, 1, 1])

    @property
    def longitudinal_m(self) -> np.ndarray:
        """(K,) standard deviation along the car."""
        return _root(self.covariances[:, 0, 0])

    @property
    def heading_rad(self) -> np.ndarray:
        """(K,) standard deviation of the heading."""
        return _root(self.covariances[:, 2, 2])


def _root(variances: np.ndarray) -> np.ndarray:
    roots: np.ndarray = np.sqrt(variances)
    return roots


def floor(run: Run, frames: int = 1, *, lag: int | None = None, draws: int = 2048) -> Floor:
    """Return the floor of each frame's pose, given so many frames around it.

    frames: how many consecutive frames are used; at the ends of the run those that are there.
    lag: how many of them come after the one whose pose is asked, half of them if left out.
    """
    return floors(run, (frames,), lag=lag, draws=draws)[frames]


def floors(
    run: Run, frames: Sequence[int], *, lag: int | None = None, draws: int = 2048
) -> dict[int, Floor]:
    """Return the floor for each of several numbers of frames; see `floor`."""
    views = [_view(run, k) for k in range(len(run.shots))]
    singles = [_single(run, view, k, draws) for k, view in enumerate(views)]
    return {
        many: _stacked(
            [
                _joint(run, views, singles, (k, window), draws)
                for k, window in enumerate(_windows(len(views), many, lag))
            ]
            if many > 1
            else singles
        )
        for many in frames
    }


def _windows(count: int, frames: int, lag: int | None) -> list[range]:
    """Return which frames of a run are used for each."""
    after = frames // 2 if lag is None else lag
    return [range(max(k + after - frames + 1, 0), min(k + after + 1, count)) for k in range(count)]


Answer = tuple[np.ndarray, np.ndarray, float]
NONE: Answer = (np.full(3, np.nan), np.full((3, 3), np.nan), 0.0)


def _stacked(answers: list[Answer]) -> Floor:
    errors, covariances, shares = zip(*answers, strict=True)
    return Floor(np.stack(errors), np.stack(covariances), np.array(shares))


def _single(run: Run, view: _View, k: int, draws: int) -> Answer:
    if run.shots[k].target.sum() < FEWEST:
        return NONE
    mean, covariance = np.zeros(3), np.diag([0.3, 0.3, 0.1]) ** 2
    rays, body = view
    stride = len(rays.origins) // COLUMNS
    if stride > 1:
        thinned = _log_density((_thinned(rays, stride), body), receiver_of(run.spec))
        mean, covariance, _ = moments(thinned, mean, covariance, draws=draws // 2)
        covariance = covariance / stride
    sample = _affordable([view], draws)
    return moments(_log_density(view, receiver_of(run.spec)), mean, covariance, draws=sample)


def _log_density(view: _View, receiver: Receiver) -> Callable[[np.ndarray], np.ndarray]:
    def log_density(offsets: np.ndarray) -> np.ndarray:
        out = _log_prior(offsets)
        add_log_likelihoods(offsets, *view, receiver, out)
        return out

    return log_density


def _thinned(rays: Rays, stride: int) -> Rays:
    kept = slice(stride // 2, None, stride)
    columns = (rays.origins[kept], rays.directions[kept], rays.observed[kept])
    return rays._replace(origins=columns[0], directions=columns[1], observed=columns[2])


def _affordable(views: list[_View], draws: int) -> int:
    """Return how many draws to take: a sharp posterior near the sensor needs fewer."""
    rays = sum(view[0].observed.size for view in views)
    return int(np.clip(RAYS // rays, draws // 6, draws))


def _log_prior(offsets: np.ndarray) -> np.ndarray:
    beyond = np.abs(offsets) / (PRIOR_M, PRIOR_M, PRIOR_RAD)
    log_prior: np.ndarray = -1e3 * np.maximum(beyond.max(axis=1) - 1.0, 0.0)
    return log_prior


def _joint(
    run: Run, views: list[_View], singles: list[Answer], window: tuple[int, range], draws: int
) -> Answer:
    """Return the posterior of frame k's pose given a window of frames."""
    k, used = window
    usable = [j for j in used if singles[j][2] > 0]
    if len(usable) < 2 or singles[k][2] == 0:
        # One frame tells nothing of the motion.
        return singles[k]
    receiver = receiver_of(run.spec)
    motion = _motion(run, k)

    def log_density(states: np.ndarray) -> np.ndarray:
        out = np.zeros(len(states))
        for j in usable:
            offsets = offsets_after(states, motion, FRAME_S * (j - k))
            out += _log_prior(offsets)
            add_log_likelihoods(offsets, *views[j], receiver, out)
        return out

    first = _gaussian(motion, [(FRAME_S * (j - k), singles[j]) for j in usable])
    sample = _affordable([views[j] for j in usable], draws)
    mean, covariance, share = moments(log_density, *first, draws=sample)
    return mean[:3], covariance[:3, :3], share


def _motion(run: Run, k: int) -> tuple[float, float]:
    """Return speed and turn rate of the car at a frame."""
    step = 1e-3
    before, after = run.drive.car(FRAME_S * k + np.array([-step, step]))
    way = after - before
    return float(np.hypot(*way[:2]) / (2 * step)), float(wrap_angle(way[2]) / (2 * step))


def offsets_after(states: np.ndarray, motion: tuple[float, float], time_s: float) -> np.ndarray:
    """Return (N, 3) offsets from the true pose a time later.

    states: (N, 5) offsets of x, y, yaw, speed and turn rate from the truth now.
    motion: true speed and turn rate. Offsets are in the frame of the true pose then.
    """
    truth = _arrived(np.zeros((1, 5)), motion, time_s)[0]
    moved = _arrived(states, motion, time_s) - truth
    c, s = np.cos(truth[2]), np.sin(truth[2])
    return np.ascontiguousarray(moved @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def _arrived(states: np.ndarray, motion: tuple[float, float], time_s: float) -> np.ndarray:
    x, y, yaw, speed, rate = states.T
    half = 0.5 * (motion[1] + rate) * time_s
    way = (motion[0] + speed) * time_s * np.sinc(half / np.pi)
    return np.column_stack(
        [x + way * np.cos(yaw + half), y + way * np.sin(yaw + half), yaw + 2 * half]
    )


def _gaussian(
    motion: tuple[float, float], answers: list[tuple[float, Answer]]
) -> tuple[np.ndarray, np.ndarray]:
    """Join the frames' posteriors as if they were normal: where the sampling begins."""
    information = np.diag([0.0, 0.0, 0.0, SPEED_M_S**-2, RATE_RAD_S**-2])
    pull = np.zeros(5)
    for time_s, (mean, covariance, _) in answers:
        slopes = np.column_stack(
            [
                (offsets_after(h * e, motion, time_s) - offsets_after(-h * e, motion, time_s))[0]
                / (2 * h)
                for h in (1e-5,)
                for e in np.eye(5)[:, None, :]
            ]
        )
        weight = np.linalg.inv(covariance)
        information += slopes.T @ weight @ slopes
        pull += slopes.T @ weight @ mean
    covariance = np.linalg.inv(information)
    return covariance @ pull, covariance


_View = tuple[Rays, Body]


def _view(run: Run, k: int) -> _View:
    """Return a frame's rays and those prisms of the car that they can meet."""
    rays, body = rays_of(run, k), body_of(run.body)
    away = np.linalg.norm(rays.origins, axis=1)
    ends = np.array([max(away.min() - REACH_M, 0.1), away.max() + REACH_M])
    heights = run.sensor_height_m + np.outer(rays.slopes, ends)
    low, high = heights.min(axis=1)[:, None], heights.max(axis=1)[:, None]
    met = ((low < body.spans[:, 1]) & (high > body.spans[:, 0])).any(axis=0)
    return rays, Body(*(column[met] for column in body))


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


@cache
def body_of(body: str) -> Body:
    """Return the car's prisms as half-planes."""
    prisms = target_body(body)
    edges = np.roll(prisms.footprints, -1, axis=1) - prisms.footprints
    for m, corners in enumerate(prisms.corners):
        edges[m, corners - 1] = prisms.footprints[m, 0] - prisms.footprints[m, corners - 1]
    lengths = np.maximum(np.linalg.norm(edges, axis=2), 1e-12)
    normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1) / lengths[..., None]
    planes = np.concatenate([normals, (normals * prisms.footprints).sum(axis=2)[..., None]], axis=2)
    low, high = prisms.footprints.min(axis=1), prisms.footprints.max(axis=1)
    middles = (low + high) / 2
    radii = np.linalg.norm(prisms.footprints - middles[:, None], axis=2).max(axis=1)
    return Body(
        np.ascontiguousarray(planes), prisms.corners.astype(np.int64),
        np.column_stack([middles, radii]),
        np.column_stack([prisms.bottoms, prisms.tops]), prisms.reflectivities.astype(np.float64),
    )  # fmt: skip


def receiver_of(spec: LidarSpec) -> Receiver:
    """Return what the sensor does to a range."""
    return Receiver(
        spec.range_noise_m, spec.range_min_m, spec.range_max_m, spec.dropout,
        spec.detection_limit, GROUND,
    )  # fmt: skip
