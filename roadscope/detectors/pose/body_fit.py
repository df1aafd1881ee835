"""A vehicle's pose from one scan: every ray counts, those that passed it by too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.detectors.pose.body_descent import SLACKS_M, descend
from roadscope.detectors.pose.body_kernels import POSE, Chances, Rays
from roadscope.detectors.pose.body_model import BodyModel
from roadscope.detectors.pose.body_rays import Sighting, sight
from roadscope.detectors.pose.body_sampling import WHOLE, Posterior, Problem, free_of, refine
from roadscope.detectors.pose.body_start import starts
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.envs.sensors.lidar_spec import LidarSpec

CHANCES = Chances(0.012, 0.012, 0.003, 10.0, 0.004, 0.001)
COARSE_RAYS = 60
FINE, FINE_ROUNDS = 256, 2


@dataclass(frozen=True, slots=True)
class BodyFit:
    """Fits a body of roughly known size to the rays of one scan.

    spec: the LiDAR, for its beam directions, noise and detection limit. model: the body.
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
    ) -> VehiclePose | None:
        """Return the pose in the world frame, None without a return of the body."""
        sighting = sight(
            self.spec, scan, target, world_from_lidar,
            sensor_velocity=sensor_velocity, rolling=rolling,
        )  # fmt: skip
        if sighting.returns == 0:
            return None
        return _pose(fit_sighting(sighting, self.model, self.chances), self.model)


def fit_sighting(sighting: Sighting, model: BodyModel, chances: Chances = CHANCES) -> Posterior:
    """Return the posterior of x, y, yaw and what is uncertain of the body."""
    problem = still_problem(sighting.rays, model, chances)
    coarse = still_problem(thinned(sighting.rays, COARSE_RAYS), model, chances, np.arange(3))
    guesses = np.stack(starts(sighting.points, sighting.origin, model))
    rough = descend(coarse, guesses)
    order = np.argsort(rough.costs)[:2]
    vectors = np.zeros((2, len(problem.free)))
    vectors[:, :3] = rough.vectors[order]
    best = descend(problem, vectors, SLACKS_M[3:])
    tries = [
        refine(problem, mean, covariance, rounds=FINE_ROUNDS, count=FINE)
        for mean, covariance in zip(best.vectors, best.covariances, strict=True)
    ]
    return max(tries, key=lambda found: found.evidence)


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


def thinned(rays: Rays, most: int) -> Rays:
    """Keep at most so many rays, evenly."""
    step = -(-len(rays.slope) // most)
    return rays if step <= 1 else Rays(*(column[::step] for column in rays))


def _pose(found: Posterior, model: BodyModel) -> VehiclePose:
    unknowns = np.zeros((1, WHOLE - POSE))
    unknowns[0, model.uncertain] = found.mean[3:]
    length, width = model.sizes(unknowns)
    x, y, yaw = found.mean[:3]
    return VehiclePose(
        float(x), float(y), float(yaw), float(length[0]), float(width[0]),
        found.covariance[:3, :3].copy(), found.evidence,
    )  # fmt: skip
