"""Samples of few rounds say of a posterior what very many samples of one round say."""

import numpy as np
import pytest

from roadscope.benchmarks.papers import ford_fusion, sense_drive
from roadscope.detectors.pose import (
    EXACTLY_DRAWN,
    BodyProblem,
    body_scan,
    likely_modes,
    split_rays,
    with_glass,
)

WIDE_SD = np.array([0.05, 0.3, 0.06, 1.5])
"""Of the many samples: x, y (metres), yaw (radians) and the unknown of the radius."""


def slow_posterior(problem, centre):
    """Return mean, covariance and log evidence from samples that are drawn once, far around."""
    rng = np.random.default_rng(0)
    normals = rng.standard_normal((200_000, len(centre)))
    samples = centre + normals * WIDE_SD
    logs = problem.log_density(samples) + 0.5 * (normals**2).sum(axis=1)
    weights = np.exp(logs - logs.max())
    evidence = np.log(weights.mean()) + logs.max() + np.log(WIDE_SD).sum()
    return (
        np.average(samples, axis=0, weights=weights),
        np.cov(samples.T, aweights=weights),
        evidence,
    )


def far_problem(seed, k):
    """Return the problem of one frame of a car that drives away, known to head away."""
    run = sense_drive("straight", seed, frames=k + 1)
    sweep, model = run.sweeps[k], ford_fusion()
    scan = body_scan(
        run.spec, sweep.scan, sweep.target, sweep.world_from_lidar, rolling=False, rough_m=0.0
    )
    free = np.append(np.arange(3), model.uncertain)
    return BodyProblem(with_glass(model, scan.rays), model, free, EXACTLY_DRAWN), sweep.truth


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "k"), [(11005, 30), (11004, 31), (11006, 25), (5, 14)])
def test_a_far_car_is_anywhere_between_two_rays(seed, k):
    """No return bounds it from aside: the end of the search says little of the posterior."""
    problem, truth = far_problem(seed, k)
    start = np.append(truth, 0.0)[None]
    (mode, *_) = likely_modes(problem, start, lambda states: np.zeros(len(states)))
    mean, covariance, evidence = slow_posterior(problem, np.append(truth, 0.0))
    sd = np.sqrt(np.diag(covariance))
    assert mode.posterior.reached
    assert (np.abs(mode.posterior.mean - mean) < 0.35 * sd).all()
    posterior_sd = np.sqrt(np.diag(mode.posterior.covariance))
    assert (posterior_sd < 1.35 * sd).all()
    assert (sd < 1.35 * posterior_sd).all()
    assert mode.posterior.evidence == pytest.approx(evidence, abs=0.5)


def test_a_form_stands_for_the_quadratic_rays_where_they_were_tried():
    run = sense_drive("straight-past", 7, frames=13)
    sweep, model = run.sweeps[12], ford_fusion()
    scan = body_scan(run.spec, sweep.scan, sweep.target, sweep.world_from_lidar, rolling=False)
    free = np.append(np.arange(3), model.uncertain)
    problem = BodyProblem(scan.rays, model, free, EXACTLY_DRAWN)
    start = np.append(sweep.truth, 0.0)[None]
    (mode, *_) = likely_modes(problem, start, lambda states: np.zeros(len(states)))
    mean, covariance = mode.posterior.mean, mode.posterior.covariance
    split = split_rays(problem, mean, covariance)
    assert len(split.problem.rays.slope) < 0.5 * len(problem.rays.slope)
    rng = np.random.default_rng(0)
    states = mean + 1.5 * rng.standard_normal((50, 4)) @ np.linalg.cholesky(covariance).T
    exact, merged = problem.log_density(states), split.problem.log_density(states)
    assert np.abs((merged - merged[0]) - (exact - exact[0])).max() < 1.0
