"""A vehicle's pose from one scan: every ray counts, those that passed it by too."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.detectors.pose.body_descent import EDGE_M, SLACKS_M, STEPS, descend
from roadscope.detectors.pose.body_kernels import POSE, Chances, Rays
from roadscope.detectors.pose.body_model import BodyModel
from roadscope.detectors.pose.body_posterior import around, posterior
from roadscope.detectors.pose.body_rays import Sighting, settled_velocity, sight
from roadscope.detectors.pose.body_sampling import WHOLE, Posterior, Problem, free_of
from roadscope.detectors.pose.body_sight_kernels import ROUGHNESS_M, points_of
from roadscope.detectors.pose.body_start import starts
from roadscope.detectors.pose.estimate import VehiclePose, axis_difference
from roadscope.envs.sensors.lidar_spec import LidarSpec

CHANCES = Chances(
    edge_m=EDGE_M, height_m=0.012, rough_m=ROUGHNESS_M,
    outlier=0.003, outlier_m=10.0, lost=0.004, through=0.001,
)  # fmt: skip
"""Of a body that is only roughly as drawn, as real ones are."""
AS_DRAWN = CHANCES._replace(edge_m=0.0013, height_m=0.0025, rough_m=0.0, steep=5)
"""Of a body that is exactly as drawn; samples need an edge of some width, and meet the posterior
worse with a sharper one. It is of one paint, whose brightest return tells within 3 to 6 % how much
light it sends back."""
COARSE_RAYS = 60
CLOSE = 15.0
"""How much more than the best of the first fits another may cost to be followed, too."""
APART = 3.0
"""Steps of a descent by which the answers of two differ that are not the same."""
TURN = 4
"""Place of the turn rate among all values."""
OFF = 1e3
"""Added to the cost of a heading that is known to be wrong."""
VELOCITY_SD, TURN_SD = 1.0, 0.7
"""Standard deviations of a speed that a tracker knows before the scan, m/s, and of a turn rate that
nobody knows, rad/s: a vehicle is met up to half a sweep from the stamp that is answered."""
QUARTER, NEAR = 0.0, float(np.cos(np.radians(50.0)))
"""Cosines up to which a heading may differ from the one that is known: told by a caller, or by a
velocity well above its standard deviation, for vehicles go where they head."""


class Likely(NamedTuple):
    """A posterior, one of several answers, and the log of how likely it is."""

    log: float
    found: Posterior


@dataclass(frozen=True, slots=True)
class BodyFit:
    """Fits a body of roughly known size to the rays of one scan.

    spec: the LiDAR, for its beam directions, noise and detection limit. model: the body.
    chances: how exactly it is drawn, `CHANCES` or `AS_DRAWN`.
    """

    spec: LidarSpec
    model: BodyModel
    chances: Chances = CHANCES

    def fit(
        self,
        scan: LidarScan,
        target: np.ndarray,
        world_from_lidar: Pose,
        *,
        sensor_velocity: np.ndarray | None = None,
        rolling: bool = True,
        towards: float | None = None,
        velocity: np.ndarray | None = None,
    ) -> VehiclePose | None:
        """Return the pose in the world frame, None without a return of the body.

        towards: heading known up to a quarter turn, as a tracker knows it, radians; left out, the
        better of the two ways round is taken. velocity: (2,) of the body as a tracker knows it,
        metres per second, world frame: the body heads that way, and moves while it is swept; left
        out, it is taken to stand.
        Other arguments as in `sight`.
        """
        if velocity is not None:
            velocity = settled_velocity("velocity", velocity)
        if towards is not None and not math.isfinite(towards):
            raise ValueError(f"towards must be a finite heading in radians, got {towards!r}")
        sighting = sight(
            self.spec, scan, target, world_from_lidar,
            sensor_velocity=sensor_velocity, rolling=rolling, rough_m=self.chances.rough_m,
        )  # fmt: skip
        if sighting.returns == 0:
            return None
        sighting = replace(sighting, rays=self.model.glazed(sighting.rays))
        speed = None if velocity is None or not rolling else float(np.hypot(*velocity))
        course = None if towards is None else (towards, QUARTER)
        if velocity is not None and towards is None:
            sure = np.hypot(*velocity) > 3.0 * VELOCITY_SD
            course = float(np.arctan2(velocity[1], velocity[0])), NEAR if sure else QUARTER
        return pose_of(*fit_sighting(sighting, self.model, self.chances, course, speed))


def fit_sighting(
    sighting: Sighting,
    model: BodyModel,
    chances: Chances = CHANCES,
    course: tuple[float, float] | None = None,
    speed: float | None = None,
) -> tuple[list[Likely], Problem]:
    """Return posteriors of x, y, yaw and what is uncertain of the body, and their problem.

    Where more than one answer is likely there are up to three.

    course: heading known before, and the least cosine of a departure from it.
    speed: of the body along its heading as known before, m/s; then it is uncertain, too.
    """
    problem = still_problem(sighting.rays, model, chances)
    coarse = still_problem(thinned(sighting.rays, COARSE_RAYS), model, chances, np.arange(3))
    if speed is not None:
        problem, coarse = moving(problem, speed), replace(coarse, fixed=at_speed(speed))
    points = _points(sighting, course, speed)
    guesses = starts(points, sighting.origin, model, cut=sighting.cut)
    rough = descend(coarse, guesses)
    costs = rough.costs
    if course is not None:
        costs = costs + OFF * (np.cos(rough.vectors[:, 2] - course[0]) < course[1])
    likely = rough.vectors[_likely(rough.vectors, costs, coarse)]
    vectors = np.tile(problem.centre[problem.free], (len(likely), 1))
    vectors[:, :3] = likely
    if sighting.cut and TURN in problem.free:
        vectors = _turning(vectors, problem)
    best = descend(problem, vectors, SLACKS_M[3:])
    tries = [
        posterior(problem, around(problem, best.vectors[k], best.covariances[k]))
        for k in _likely(best.vectors, best.costs, problem)
    ]
    return [
        Likely(found.evidence - _askew(found, course, speed), found) for found in tries
    ], problem


def _likely(vectors: np.ndarray, costs: np.ndarray, problem: Problem) -> list[int]:
    """Return which of (S, D) vectors are hardly worse than the best, at most three, and apart."""
    kept: list[int] = []
    for k in np.argsort(costs):
        away = np.abs(vectors[kept] - vectors[k]) > APART * STEPS[problem.free]
        if costs[k] <= costs.min() + CLOSE and away.any(axis=1).all():
            kept.append(int(k))
    return kept[:3]


def _turning(vectors: np.ndarray, problem: Problem) -> np.ndarray:
    """Return starts (3 S, D) that turn to the right, not, and to the left.

    A body that is met when a sweep begins and again when it ends has moved on, and on which way
    is a question with several answers.
    """
    place = np.searchsorted(problem.free, TURN)
    more = np.repeat(vectors, 3, axis=0)
    more[:, place] += TURN_SD * np.tile([-1.0, 0.0, 1.0], len(vectors))
    return more


def _askew(found: Posterior, course: tuple[float, float] | None, speed: float | None) -> float:
    """Return what a heading costs across which the body goes at a speed, m/s: it hardly does."""
    if course is None or speed is None:
        return 0.0
    across = speed * np.sin(found.mean[2] - course[0]) / VELOCITY_SD
    return float(0.5 * across**2)


def _points(
    sighting: Sighting, course: tuple[float, float] | None, speed: float | None
) -> np.ndarray:
    """Return where a body's returns are at the scan's stamp, (N, 2) metres, world frame."""
    if course is None or speed is None:
        return sighting.points
    velocity = speed * np.array([np.cos(course[0]), np.sin(course[0])])
    return np.asarray(points_of(sighting.rays, velocity))


def still_problem(
    rays: Rays, model: BodyModel, chances: Chances, free: np.ndarray | None = None
) -> Problem:
    """Return the problem of one scan: the pose and the body are free unless `free` is given."""
    prior = np.ones(WHOLE)
    prior[:3] = np.inf
    zero = np.zeros(WHOLE)
    return Problem(
        rays, model, chances, zero, free_of(model, False) if free is None else free, prior, zero
    )


def at_speed(speed: float) -> np.ndarray:
    """Return all 11 values, none but the speed (m/s) other than zero."""
    values = np.zeros(WHOLE)
    values[3] = speed
    return values


def moving(problem: Problem, speed: float) -> Problem:
    """Return the problem of a body that goes at roughly such a speed (m/s), and may turn."""
    free = np.insert(problem.free, 3, (3, 4))
    prior = problem.prior.copy()
    prior[3:5] = VELOCITY_SD, TURN_SD
    return replace(problem, free=free, prior=prior, centre=at_speed(speed))


def thinned(rays: Rays, most: int) -> Rays:
    """Keep at most so many rays, evenly."""
    step = -(-len(rays.slope) // most)
    return rays if step <= 1 else Rays(*(column[::step].copy() for column in rays))


def thinned_problem(problem: Problem, most: int = 200) -> Problem:
    """Keep at most so many of a problem's rays, evenly."""
    return replace(problem, rays=thinned(problem.rays, most))


def pose_of(answers: Sequence[Likely], problem: Problem) -> VehiclePose:
    """Return the mean of the likeliest posterior, its score the log of the evidence.

    The covariance is that of all answers around it, each as likely as it is: a vehicle seen from
    the side may face either way, and its middle is not the same. Headings count up to half a turn.
    """
    best = max(answers, key=lambda answer: answer.log)
    unknowns = problem.whole(best.found.mean[None])[:, POSE:]
    length, width = problem.model.sizes(unknowns)
    x, y, yaw = best.found.mean[:3]
    drawn = problem.model.drawn_m
    covariance = _spread(answers, best) + np.diag([drawn, drawn, 0.0]) ** 2
    return VehiclePose(
        float(x), float(y), float(yaw), float(length[0]), float(width[0]),
        covariance, best.found.evidence,
    )  # fmt: skip


def _spread(answers: Sequence[Likely], best: Likely) -> np.ndarray:
    """Return the mean square (3, 3) of what x, y and yaw are off the best answer's."""
    total, spread = 0.0, np.zeros((3, 3))
    for log, found in answers:
        if found is not best.found and not found.reached:
            continue
        off = found.mean[:3] - best.found.mean[:3]
        off[2] = axis_difference(off[2], 0.0)
        share = np.exp(log - best.log)
        total += share
        spread += share * (found.covariance[:3, :3] + np.outer(off, off))
    return spread / total
