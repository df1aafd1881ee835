"""The information floor: the least error that any estimator can have on Zhang 2017's drives.

The posterior of the car's pose is computed from all that the sensor measured near the car, with the
model that made the measurements. Its covariance is the mean square error of the best possible
estimator of a pose that is not known beforehand. Rays that pass close by the silhouette inform as
much as rays that meet it, and they bound the pose instead of having a slope: a Cramer-Rao bound of
the ranges misses this, sampling does not.

An estimator that does not know the radius of the car's corners, or its acceleration, has a higher
floor. Then the posterior covers these too, with the priors of our own pose fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from research.importance_sampling import LogDensity, SampledPosterior, sampled_posterior
from research.ray_likelihood import CandidateStates, FrameLikelihood, PrismBodies, frame_likelihood
from roadscope.benchmarks.papers.zhang2017_methods import FEWEST_RETURNS, ford_fusion
from roadscope.benchmarks.papers.zhang2017_scene import FRAME_S, SensedDrive
from roadscope.core.pose import wrap_angle
from roadscope.detectors.pose.body_model import RADIUS, VALUES, part_of
from roadscope.detectors.pose.smoother import ACCELERATION_SD
from roadscope.envs.world.prisms import Prisms
from roadscope.envs.world.saloon_body import CORNER_RADII_M, with_corners

START_SDS = 0.3, 0.3, 0.1
"""Standard deviations of the first proposal of a pose: metres, metres, radians."""
LEAST_COLUMNS, THINNING = 12, 4
"""The search begins with at least this many columns; each step multiplies their number by the
second."""
PASSING_SHARE = 0.1
"""Effective share of samples that is enough before all columns are used."""
WIDENING = 2.0
"""The first proposal is this many times as wide as the posterior of the frame before."""
LEAST_SAMPLES = 8.0
"""Effective samples behind a covariance, below which its NEES is not given."""
MOST_RAYS, DRAWS_OVER_LEAST = 500_000, 6
"""A round of sampling casts at most this many rays, by drawing fewer samples, but at least a
sixth."""
QUANTILES = 20_000
RADII = 81
"""Radii between the least and the greatest, 5 mm apart: a surface is off by 1 mm at most."""
SPEED_SD_M_S, TURN_SD_RAD_S = 20.0, np.radians(60.0)
"""Standard deviations of the first proposal of speed and turn rate; their prior is flat."""
MOVING_STATE = 5
"""Offsets of x, y, yaw, speed and turn rate; the acceleration follows them where it is unknown."""
DERIVATIVE_STEP = 1e-5


class Knowledge(NamedTuple):
    """What the best estimator knows beforehand.

    corners: the radius of the car's corners. acceleration: that of the car along its heading.
    """

    corners: bool = True
    acceleration: bool = True


KNOWS_ALL = Knowledge()
KNOWS_AS_MUCH_AS_OURS = Knowledge(corners=False, acceleration=False)


@dataclass(frozen=True, slots=True)
class InformationFloor:
    """Posteriors of K frames. Where a frame has too few returns, errors and covariances are NaN.

    errors: (K, 3) posterior mean minus truth: along and across the car (metres), yaw (radians).
    covariances: (K, 3, 3) of the same.
    shares: (K,) effective share of the samples, 0 where the sampling failed.
    counts: (K,) effective number of samples, likewise.
    """

    errors: np.ndarray
    covariances: np.ndarray
    shares: np.ndarray
    counts: np.ndarray

    @property
    def nees(self) -> np.ndarray:
        """(K,) squared errors of the posterior mean in units of the covariance, NEES.

        Corrected for what mean and covariance of few samples add on average (Hotelling's
        distribution). Its mean is 3 over all that the priors cover; of one body on one drive it
        need not be 3.
        """
        values = np.full(len(self.shares), np.nan)
        used = (self.shares > 0) & (self.counts > LEAST_SAMPLES)
        errors, n = self.errors[used], self.counts[used]
        weighted = np.linalg.solve(self.covariances[used], errors[..., None])[..., 0]
        values[used] = (errors * weighted).sum(axis=1) * (n - 5) / (n - 1) * n / (n + 1)
        return values

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


def floor(
    run: SensedDrive,
    frames: int = 1,
    *,
    lag: int | None = None,
    draws: int = 2048,
    knowledge: Knowledge = KNOWS_ALL,
) -> InformationFloor:
    """Return the floor of each frame's pose, given a number of frames around it.

    frames: consecutive frames that are used; at the ends of the run those that exist.
    lag: how many of them come after the frame in question; half of them if left out.
    draws: samples of each round.
    """
    return floors(run, (frames,), lag=lag, draws=draws, knowledge=knowledge)[frames]


def floors(
    run: SensedDrive,
    frames: Sequence[int],
    *,
    lag: int | None = None,
    draws: int = 2048,
    knowledge: Knowledge = KNOWS_ALL,
) -> dict[int, InformationFloor]:
    """Return the floor for each of several numbers of frames; see `floor`."""
    bodies = known_corners(run.body) if knowledge.corners else unknown_corners()
    likelihoods = [frame_likelihood(run, k, bodies.bodies) for k in range(len(run.sweeps))]
    singles: list[FramePosterior] = []
    for shot, likelihood in zip(run.sweeps, likelihoods, strict=True):
        before = singles[-1] if singles else _no_posterior(bodies)
        enough = shot.target.sum() >= FEWEST_RETURNS
        singles.append(
            _single(likelihood, bodies, before, draws) if enough else _no_posterior(bodies)
        )
    filtered = _FilteredRun(run, bodies, likelihoods, singles, knowledge.acceleration)
    return {
        many: _stacked(
            [_joint(filtered, w, draws) for w in _windows(len(likelihoods), many, lag)]
            if many > 1
            else singles
        )
        for many in frames
    }


class _Window(NamedTuple):
    """A frame and the frames from which its pose is estimated."""

    frame: int
    used: range


def _windows(count: int, frames: int, lag: int | None) -> list[_Window]:
    after = frames // 2 if lag is None else lag
    return [
        _Window(k, range(max(k + after - frames + 1, 0), min(k + after + 1, count)))
        for k in range(count)
    ]


class FramePosterior(NamedTuple):
    """Posterior of a frame's pose and of E unknowns of the corners.

    mean: (3 + E,). covariance: (3 + E, 3 + E).
    share, samples: effective share and effective number of samples.
    """

    mean: np.ndarray
    covariance: np.ndarray
    share: float
    samples: float

    @classmethod
    def of(cls, sampled: SampledPosterior, draws: int) -> FramePosterior:
        """Count the effective samples of a posterior; draws: samples of a round."""
        share = sampled.effective_share
        return cls(sampled.mean, sampled.covariance, share, share * draws)


@dataclass(frozen=True, slots=True)
class _FilteredRun:
    """A run with the posteriors of its single frames."""

    run: SensedDrive
    bodies: CornerPrior
    likelihoods: list[FrameLikelihood]
    singles: list[FramePosterior]
    knows_acceleration: bool


def _no_posterior(bodies: CornerPrior) -> FramePosterior:
    size = 3 + bodies.unknowns
    return FramePosterior(np.full(size, np.nan), np.full((size, size), np.nan), 0.0, 0.0)


def _stacked(posteriors: Sequence[FramePosterior]) -> InformationFloor:
    return InformationFloor(
        np.stack([each.mean[:3] for each in posteriors]),
        np.stack([each.covariance[:3, :3] for each in posteriors]),
        np.array([each.share for each in posteriors]),
        np.array([each.samples for each in posteriors]),
    )


def _single(
    likelihood: FrameLikelihood, bodies: CornerPrior, before: FramePosterior, draws: int
) -> FramePosterior:
    """Return the posterior of one frame's pose.

    Where there are many columns the search begins around the truth with the width of the frame
    before, or else with few columns.
    """
    mean = np.zeros(3 + bodies.unknowns)
    covariance = np.diag([*START_SDS, *[1.0] * bodies.unknowns]) ** 2
    stride = 1
    while len(likelihood.rays.origins) >= LEAST_COLUMNS * stride * THINNING:
        stride *= THINNING
    if stride > 1 and before.share > 0:
        mean[3:], covariance, stride = before.mean[3:], WIDENING**2 * before.covariance, 1
    while stride > 1:
        mean, covariance, _ = sampled_posterior(
            _log_density(likelihood.thinned(stride), bodies),
            mean,
            covariance,
            draws=draws // 2,
            wanted_share=PASSING_SHARE,
        )
        stride //= THINNING
    affordable = _affordable_draws([likelihood], draws)
    density = _log_density(likelihood, bodies)
    return FramePosterior.of(
        sampled_posterior(density, mean, covariance, draws=affordable), affordable
    )


def _log_density(likelihood: FrameLikelihood, bodies: CornerPrior) -> LogDensity:
    def log_density(states: np.ndarray) -> np.ndarray:
        offsets, unknowns = np.ascontiguousarray(states[:, :3]), states[:, 3:]
        out = likelihood.log_density(CandidateStates(offsets, bodies.rows_of(unknowns)))
        out += _log_prior_of_unknowns(unknowns)
        return out

    return log_density


def _log_prior_of_unknowns(unknowns: np.ndarray) -> np.ndarray:
    log_prior: np.ndarray = -0.5 * (unknowns**2).sum(axis=1)
    return log_prior


def _affordable_draws(likelihoods: Sequence[FrameLikelihood], draws: int) -> int:
    """Return how many samples to draw: a sharp posterior near the sensor needs fewer."""
    rays = sum(each.rays.observed_m.size for each in likelihoods)
    return int(np.clip(MOST_RAYS // rays, draws // DRAWS_OVER_LEAST, draws))


def _joint(filtered: _FilteredRun, window: _Window, draws: int) -> FramePosterior:
    """Return the posterior of a frame's pose given a window of frames."""
    singles, bodies, frame = filtered.singles, filtered.bodies, window.frame
    usable = [j for j in window.used if singles[j].share > 0]
    if len(usable) < 2 or singles[frame].share == 0:
        # One frame does not inform about the motion.
        return singles[frame]
    motion = motion_of(filtered.run, frame)
    acceleration = None
    if not filtered.knows_acceleration:
        acceleration = acceleration_of(filtered.run, frame)
    moving = MOVING_STATE + (acceleration is not None)
    times_s = {j: FRAME_S * (j - frame) for j in usable}

    def log_density(states: np.ndarray) -> np.ndarray:
        unknowns = states[:, moving:]
        out, rows = _log_prior_of_unknowns(unknowns), bodies.rows_of(unknowns)
        if acceleration is not None:
            out += _log_prior_of_acceleration(states[:, MOVING_STATE], acceleration)
        for j, time_s in times_s.items():
            offsets = offsets_after(states[:, :moving], motion, time_s)
            out += filtered.likelihoods[j].log_density(CandidateStates(offsets, rows))
        return out

    timed = [TimedPosterior(time_s, singles[j]) for j, time_s in times_s.items()]
    mean, covariance = joined_posteriors(motion, timed, acceleration)
    affordable = _affordable_draws([filtered.likelihoods[j] for j in usable], draws)
    sampled = sampled_posterior(log_density, mean, covariance, draws=affordable)
    # x, y and yaw lead the state; the rest of it is not asked for.
    pose = SampledPosterior(sampled.mean[:3], sampled.covariance[:3, :3], sampled.effective_share)
    return FramePosterior.of(pose, affordable)


# The car's corners


@dataclass(frozen=True, slots=True)
class CornerPrior:
    """G bodies with rising corner radii, and how likely each is.

    unknowns: 0 where the radius is known and G is 1, else 1.
    normal, rows: (Q,) rising values of a standard normal unknown, and the row of the body that
        each stands for, with fractions.
    """

    bodies: PrismBodies
    unknowns: int
    normal: np.ndarray
    rows: np.ndarray

    def rows_of(self, unknowns: np.ndarray) -> np.ndarray:
        """Return the (N,) rows of the bodies that (N, E) unknowns stand for."""
        if not self.unknowns:
            return np.zeros(len(unknowns), np.int64)
        rows: np.ndarray = np.rint(np.interp(unknowns[:, 0], self.normal, self.rows))
        return rows.astype(np.int64)


@cache
def known_corners(body: str) -> CornerPrior:
    """Return the car with its true corners; body: `sharp` or `rounded`."""
    return CornerPrior(bodies_of((CORNER_RADII_M[body],)), 0, np.empty(0), np.empty(0))


@cache
def unknown_corners() -> CornerPrior:
    """Return the car with corners of any radius, with the prior of our pose fit.

    The fit makes the radius from a standard normal unknown. Here a greater unknown always means a
    greater radius, so that the posterior has one mode; the prior is the same.
    """
    from scipy.special import ndtri

    least, most = ford_fusion().radius_m
    normal = ndtri((np.arange(QUANTILES) + 0.5) / QUANTILES)
    states = np.zeros((QUANTILES, VALUES))
    states[:, RADIUS] = normal
    radii_m = np.sort([part_of(ford_fusion().shape, 0, state).radius for state in states])
    rows = (radii_m - least) / (most - least) * (RADII - 1)
    bodies = bodies_of(tuple(np.linspace(least, most, RADII).tolist()))
    return CornerPrior(bodies, 1, normal, rows)


@cache
def bodies_of(radii_m: Sequence[float]) -> PrismBodies:
    """Return the car's prisms for each radius of its corners."""
    cars = [with_corners(radius_m) for radius_m in radii_m]
    footprints = np.concatenate([car.footprints for car in cars], axis=1)
    low, high = footprints.min(axis=1), footprints.max(axis=1)
    return PrismBodies(
        np.stack([_planes(car) for car in cars]),
        np.stack([car.corners.astype(np.int64) for car in cars]),
        np.column_stack([cars[0].bottoms, cars[0].tops]),
        cars[0].reflectivities.astype(np.float64),
        np.column_stack([(low + high) / 2, (high - low) / 2]),
    )


def _planes(prisms: Prisms) -> np.ndarray:
    """Return (M, 12, 3) unit normals and offsets of the sides."""
    edges = np.roll(prisms.footprints, -1, axis=1) - prisms.footprints
    for m, corners in enumerate(prisms.corners):
        edges[m, corners - 1] = prisms.footprints[m, 0] - prisms.footprints[m, corners - 1]
    lengths = np.maximum(np.linalg.norm(edges, axis=2), 1e-12)
    normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1) / lengths[..., None]
    distances = (normals * prisms.footprints).sum(axis=2)
    return np.concatenate([normals, distances[..., None]], axis=2)


# The car's motion between the frames of a window. It moves along its heading; its speed and turn
# rate are off their true values by unknown constants, and its acceleration where that is unknown.


class TrueMotion(NamedTuple):
    """Speed (m/s) and turn rate (rad/s) of the car at one time."""

    speed_m_s: float
    turn_rad_s: float


class TimedPosterior(NamedTuple):
    """A frame's posterior, and how many seconds after the frame in question it is."""

    time_s: float
    posterior: FramePosterior


def motion_of(run: SensedDrive, frame: int) -> TrueMotion:
    """Return the true motion of the car at a frame."""
    step_s = 1e-3
    before, after = run.drive.car(FRAME_S * frame + np.array([-step_s, step_s]))
    change = after - before
    return TrueMotion(
        float(np.hypot(*change[:2]) / (2 * step_s)), float(wrap_angle(change[2]) / (2 * step_s))
    )


def acceleration_of(run: SensedDrive, frame: int) -> float:
    """Return the true acceleration along the heading at a frame, m/s2."""
    step_s = 1e-2
    before, now, after = run.drive.car(FRAME_S * frame + np.array([-step_s, 0.0, step_s]))
    change = (after - 2 * now + before)[:2] / step_s**2
    return float(change @ [np.cos(now[2]), np.sin(now[2])])


def _log_prior_of_acceleration(offsets: np.ndarray, true: float) -> np.ndarray:
    """Return the (N,) log prior of accelerations off the true one; the prior is our pose fit's."""
    logs: np.ndarray = -0.5 * ((offsets + true) / ACCELERATION_SD) ** 2
    return logs


def offsets_after(states: np.ndarray, motion: TrueMotion, time_s: float) -> np.ndarray:
    """Return the (N, 3) offsets from the true pose a time later, in the frame of that pose.

    states: (N, 5 or 6) offsets of x, y, yaw, speed, turn rate and acceleration from the truth now.
    """
    truth = _pose_after(np.zeros((1, MOVING_STATE)), motion, time_s)[0]
    moved = _pose_after(states, motion, time_s) - truth
    cos, sin = np.cos(truth[2]), np.sin(truth[2])
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.ascontiguousarray(moved @ turn)


def _pose_after(states: np.ndarray, motion: TrueMotion, time_s: float) -> np.ndarray:
    x, y, yaw, speed, turn = states.T[:MOVING_STATE]
    gained = 0.5 * states[:, MOVING_STATE:].sum(axis=1) * time_s
    half_turn = 0.5 * (motion.turn_rad_s + turn) * time_s
    chord = (motion.speed_m_s + speed + gained) * time_s * np.sinc(half_turn / np.pi)
    return np.column_stack(
        [
            x + chord * np.cos(yaw + half_turn),
            y + chord * np.sin(yaw + half_turn),
            yaw + 2 * half_turn,
        ]
    )


def joined_posteriors(
    motion: TrueMotion, posteriors: Iterable[TimedPosterior], acceleration: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance of the state as if the frames' posteriors were normal.

    acceleration: the true one, m/s2, where the estimator does not know it; else None. The E
    unknowns of the corners do not change and stand last in the state.
    """
    moving = MOVING_STATE + (acceleration is not None)
    information, pull = np.zeros((0, 0)), np.zeros(0)
    for time_s, posterior in posteriors:
        mean, covariance = posterior.mean, posterior.covariance
        if not len(pull):
            size = moving + len(mean) - 3
            information, pull = np.zeros((size, size)), np.zeros(size)
            information[3, 3], information[4, 4] = SPEED_SD_M_S**-2, TURN_SD_RAD_S**-2
            if acceleration is not None:
                information[MOVING_STATE, MOVING_STATE] = ACCELERATION_SD**-2
                pull[MOVING_STATE] = -acceleration * ACCELERATION_SD**-2
        slopes = np.zeros((len(mean), len(pull)))
        slopes[:3, :moving] = _derivatives(motion, time_s, moving)
        slopes[3:, moving:] = np.eye(len(mean) - 3)
        weight = np.linalg.inv(covariance)
        information += slopes.T @ weight @ slopes
        pull += slopes.T @ weight @ mean
    covariance = np.linalg.inv(information)
    return covariance @ pull, covariance


def _derivatives(motion: TrueMotion, time_s: float, size: int) -> np.ndarray:
    """Return the (3, size) derivatives of offsets a time later by those now."""
    steps = DERIVATIVE_STEP * np.eye(size)
    change = offsets_after(steps, motion, time_s) - offsets_after(-steps, motion, time_s)
    slopes: np.ndarray = change.T / (2 * DERIVATIVE_STEP)
    return slopes
