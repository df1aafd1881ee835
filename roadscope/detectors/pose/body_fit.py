"""A vehicle's pose from all rays of one scan, also from those that pass beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.detectors.pose.body_likelihood import ROUGHLY_DRAWN, Tolerance
from roadscope.detectors.pose.body_model import GLASS, SPEED, TURN_RATE, VALUES, YAW, BodyModel
from roadscope.detectors.pose.body_rays import HIT, BodyRays, BodyScan, body_scan, checked_velocity
from roadscope.detectors.pose.body_search import (
    SLACKS_M,
    STEPS,
    BodyProblem,
    Descent,
    Posterior,
    descend,
    first_poses,
    posterior,
    prior_sd,
)
from roadscope.detectors.pose.estimate import VehiclePose, axis_difference
from roadscope.envs.sensors.lidar_spec import LidarSpec

POSE = np.arange(YAW + 1)
"""Indices of x, y and yaw in a state and in a vector."""
NEAR_SLACKS_M = (0.04, 0.01, 0.005, 0.0)
"""Added to the noise in successive rounds of the second search, see `descend`."""
COARSE_RAYS, FINE_RAYS = 60, 400
"""Rays of the first and of the second search."""
MOST_EXTRA_COST = 15.0
"""The result of a search is used if its cost exceeds the least one by at most this; chosen by
hand."""
SAME_STEPS = 3.0
"""Two results of a search are the same if all values differ by at most so many `STEPS`; chosen by
hand."""
WRONG_HEADING = 1e3
"""Added to the cost of a heading that is known to be wrong; chosen by hand."""
VELOCITY_SD, TURN_SD = 1.0, 0.7
"""Prior standard deviations of the speed that a tracker reports, m/s, and of the turn rate, rad/s,
which no tracker reports. They matter because a vehicle is measured up to half a sweep from the
stamp."""
COS_QUARTER_TURN, COS_ALONG = 0.0, math.cos(math.radians(50.0))
"""Least cosine of the angle between heading and course: if the course is known up to a quarter
turn, and if it comes from a velocity well above its standard deviation."""


class BodyCourse(NamedTuple):
    """What is known of a vehicle's heading and speed before the scan.

    heading: radians, world frame. least_cosine: least cosine of the angle between this heading and
    that of the fit. speed: m/s along the heading, None if unknown.
    """

    heading: float
    least_cosine: float
    speed: float | None = None


class PoseMode(NamedTuple):
    """One mode of the posterior, and the logarithm of its weight."""

    log_weight: float
    posterior: Posterior


@dataclass(frozen=True, slots=True)
class BodyFit:
    """Fits a body of roughly known size to the rays of one scan.

    spec: the LiDAR: its beam directions, noise and detection limit. model: the body. tolerance: how
    exactly the body has the shape of its model, `ROUGHLY_DRAWN` or `EXACTLY_DRAWN`.
    """

    spec: LidarSpec
    model: BodyModel
    tolerance: Tolerance = ROUGHLY_DRAWN

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
        """Return the pose in the world frame, None without a return from the body.

        towards: a heading that is right up to a quarter turn, radians, world frame, for example a
        tracker's. If it is None, the better one of both directions is returned.
        velocity: (2,) of the body, metres per second, world frame, for example a tracker's. The
        body heads that way, and moves during the sweep. If it is None, the body stands.
        Other arguments as in `body_scan`.
        """
        if towards is not None and not math.isfinite(towards):
            raise ValueError(f"towards must be a finite heading in radians, got {towards!r}")
        course = None if towards is None else BodyCourse(towards, COS_QUARTER_TURN)
        if velocity is not None:
            x, y = checked_velocity("velocity", velocity)
            speed = math.hypot(x, y)
            if course is None:
                is_sure = speed > 3.0 * VELOCITY_SD
                course = BodyCourse(math.atan2(y, x), COS_ALONG if is_sure else COS_QUARTER_TURN)
            course = course._replace(speed=speed if rolling else None)
        body = body_scan(
            self.spec,
            scan,
            target,
            world_from_lidar,
            sensor_velocity=sensor_velocity,
            rolling=rolling,
            rough_m=self.tolerance.rough_m,
        )
        if body.returns == 0:
            return None
        body = replace(body, rays=with_glass(self.model, body.rays))
        problem, modes = self._modes(body, course)
        return pose_of(modes, problem)

    def _modes(
        self, body: BodyScan, course: BodyCourse | None
    ) -> tuple[BodyProblem, list[PoseMode]]:
        """Return the problem of one scan and the likely modes of its posterior."""
        speed, velocity, centre = None, np.zeros(2), np.zeros(VALUES)
        if course is not None and course.speed is not None:
            speed = centre[SPEED] = course.speed
            velocity = speed * np.array([math.cos(course.heading), math.sin(course.heading)])
        motion = POSE if speed is None else np.arange(TURN_RATE + 1)
        free = np.concatenate([motion, self.model.uncertain])
        sd = prior_sd(speed=VELOCITY_SD, turn_rate=TURN_SD)
        problem = BodyProblem(body.rays, self.model, free, self.tolerance, centre=centre, sd=sd)
        poses = first_poses(body.rays.points(velocity), body.origin, self.model, cut=body.cut)
        starts = np.tile(centre[free], (len(poses), 1))
        starts[:, POSE] = poses
        if body.cut and speed is not None:
            # A body that is measured when the sweep begins and again when it ends has moved
            # meanwhile: straight on, or with a turn to the right or to the left.
            starts = np.repeat(starts, 3, axis=0)
            starts[:, TURN_RATE] += np.tile([-TURN_SD, 0.0, TURN_SD], len(poses))

        def heading_cost(states: np.ndarray) -> np.ndarray:
            if course is None:
                return np.zeros(len(states))
            off = states[:, YAW] - course.heading
            cost = WRONG_HEADING * (np.cos(off) < course.least_cosine)
            return cost if speed is None else cost + (speed * np.sin(off) / VELOCITY_SD) ** 2

        return problem, likely_modes(problem, starts, heading_cost)


def with_glass(model: BodyModel, rays: BodyRays) -> BodyRays:
    """Return the rays of one scan; those at the height of the windows get the `need` of glass.

    At a slant a window sends nothing back where paint still would. Without this, a ray without a
    return would mean that the body does not extend to there. The height of rays without a return
    from the body is taken at its mean distance.
    """
    hits = rays.kind == HIT
    if model.glass_m is None or not hits.any():
        return rays
    height = rays.origin[:, 2] + rays.slope * np.where(hits, rays.reach, rays.reach[hits].mean())
    is_glass = (model.glass_m[0] < height) & (height < model.glass_m[1])
    return rays._replace(need=np.where(is_glass, GLASS * rays.need, rays.need))


def likely_modes(
    problem: BodyProblem,
    starts: np.ndarray,
    state_cost: Callable[[np.ndarray], np.ndarray],
    *,
    slacks_m: tuple[float, ...] = SLACKS_M,
    coarse_rays: int = COARSE_RAYS,
) -> list[PoseMode]:
    """Return up to three likely modes of the posterior of a problem.

    starts: (S, D) vectors from which the search begins, first with few rays. state_cost: the prior
    cost of states (K, 11), which is added to that of the rays. slacks_m: as in `descend`, for the
    first search.
    """

    def searched(problem: BodyProblem, vectors: np.ndarray, slacks: tuple[float, ...]) -> Descent:
        ends = descend(problem, vectors, slacks)
        return replace(ends, costs=ends.costs + state_cost(problem.states(ends.vectors)))

    rough = searched(problem.thinned(coarse_rays), starts, slacks_m)
    likely = rough.vectors[_likely_ends(rough, problem)]
    fine = searched(problem.thinned(FINE_RAYS), likely, NEAR_SLACKS_M)
    modes = []
    for k in _likely_ends(fine, problem):
        sampled = posterior(problem, fine.vectors[k], fine.covariances[k])
        cost = float(state_cost(problem.states(sampled.mean[None]))[0])
        modes.append(PoseMode(sampled.evidence - 0.5 * cost, sampled))
    return modes


def _likely_ends(ends: Descent, problem: BodyProblem) -> list[int]:
    """Return the rows of the best different ends of a search, at most three."""
    chosen: list[int] = []
    for k in np.argsort(ends.costs):
        steps = np.abs(ends.vectors[chosen] - ends.vectors[k]) / STEPS[problem.free]
        differs = (steps > SAME_STEPS).any(axis=1).all()
        if ends.costs[k] <= ends.costs.min() + MOST_EXTRA_COST and differs:
            chosen.append(int(k))
    return chosen[:3]


def pose_of(modes: Sequence[PoseMode], problem: BodyProblem) -> VehiclePose:
    """Return the mean of the likeliest mode; its score is the logarithm of the evidence.

    The covariance is that of all modes around this mean, weighted by their probability: a vehicle
    of which a flank is visible may face either way, with another centre. Headings that differ by
    half a turn count as equal.
    """
    best = max(modes, key=lambda mode: mode.log_weight)
    mean = best.posterior.mean
    total, spread = 0.0, np.zeros((3, 3))
    for log_weight, other in modes:
        if other is best.posterior or other.reached:
            off = other.mean[:3] - mean[:3]
            off[2] = axis_difference(off[2], 0.0)
            weight = np.exp(log_weight - best.log_weight)
            total += weight
            spread += weight * (other.covariance[:3, :3] + np.outer(off, off))
    length, width = problem.model.sizes(problem.states(mean[None])[0])
    drawn_m = problem.model.drawn_m
    return VehiclePose(
        float(mean[0]),
        float(mean[1]),
        float(mean[2]),
        length,
        width,
        spread / total + np.diag([drawn_m, drawn_m, 0.0]) ** 2,
        best.posterior.evidence,
    )
