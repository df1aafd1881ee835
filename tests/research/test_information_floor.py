from dataclasses import replace

import numpy as np
import pytest

from research.information_floor import (
    InformationFloor,
    Knowledge,
    TrueMotion,
    acceleration_of,
    bodies_of,
    floor,
    known_corners,
    motion_of,
    offsets_after,
    unknown_corners,
)
from research.ray_likelihood import (
    IMPOSSIBLE,
    CandidateStates,
    add_log_likelihoods,
    rays_of,
    receiver_of,
)
from roadscope.benchmarks.papers import ford_fusion, sense_drive
from roadscope.detectors.pose import RADIUS, VALUES, part_of
from roadscope.envs.raycast import Columns, Scene, cast
from roadscope.envs.world import Prisms, with_corners

SEED = 12345


def log_likelihood(run, k, offset):
    out, states = np.zeros(1), CandidateStates(np.array([offset]), np.zeros(1, int))
    receiver, bodies = receiver_of(run.spec), known_corners(run.body).bodies
    add_log_likelihoods(states, rays_of(run, k), bodies, receiver, out)
    return float(out[0])


def nees(floor: InformationFloor) -> np.ndarray:
    return floor.nees[np.isfinite(floor.nees)]


def test_few_samples_do_not_make_a_posterior_too_sure():
    """Mean and covariance of 26 normal samples, and a truth that they do not know."""
    rng = np.random.default_rng(3)
    drawn, truth = rng.normal(size=(4000, 26, 3)), rng.normal(size=(4000, 3))
    covariances = np.stack([np.cov(samples.T) for samples in drawn])
    count = np.full(4000, 26.0)
    information_floor = InformationFloor(drawn.mean(axis=1) - truth, covariances, count / 85, count)
    raw = np.einsum(
        "ki,kij,kj->k",
        information_floor.errors,
        np.linalg.inv(covariances),
        information_floor.errors,
    )
    assert raw.mean() > 3.4
    assert information_floor.nees.mean() == pytest.approx(3.0, abs=0.15)
    assert np.isnan(replace(information_floor, counts=0 * count).nees).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["straight", "straight-past", "curve", "following-10"])
@pytest.mark.parametrize("body", ["sharp", "rounded"])
def test_the_likelihood_is_the_one_that_made_the_scans(name, body):
    """At the truth every ray is possible, and squared range errors are noise variances."""
    run = sense_drive(name, SEED, body=body, frames=24)
    quick = run.sweeps[:3] if name == "following-10" else run.sweeps[::4]
    values = [log_likelihood(run, run.sweeps.index(shot), (0.0, 0.0, 0.0)) for shot in quick]
    returns = [int((rays_of(run, run.sweeps.index(s)).observed_m > 0).sum()) for s in quick]
    assert min(values) > IMPOSSIBLE - 0.75 * max(returns)
    assert -2.0 * sum(values) / sum(returns) == pytest.approx(1.0, abs=0.25)


@pytest.mark.slow
def test_other_poses_are_less_likely():
    run = sense_drive("curve", SEED, frames=1)
    best = log_likelihood(run, 0, (0.0, 0.0, 0.0))
    for offset in [(0.2, 0, 0), (-0.2, 0, 0), (0, 0.2, 0), (0, -0.2, 0), (0, 0, 0.1), (0, 0, -0.1)]:
        assert log_likelihood(run, 0, offset) < best - 20


def by_ray_caster(run, k, offset, body) -> float:
    """The same likelihood, ray by ray, with the caster that made the scans."""
    rays, spec = rays_of(run, k), run.spec
    flat = np.zeros(len(rays.origins))
    columns = Columns(
        np.column_stack([rays.origins, flat + rays.height_m]),
        np.column_stack([rays.directions, flat]),
        np.tile([0.0, 0.0, 1.0], (len(flat), 1)),
        flat,
    )
    scene = Scene.still(Prisms.empty(), body, np.array([offset]))
    cast_rays = cast(scene, columns, rays.slopes, max_range_m=1000.0)
    signal = cast_rays.cosines * cast_rays.reflectivity
    echoes = (cast_rays.ranges > 0) & (cast_rays.ranges < spec.range_max_m)
    echoes &= signal * spec.range_max_m**2 >= spec.detection_limit * cast_rays.ranges**2
    off = (rays.observed_m - cast_rays.ranges) / spec.range_noise_m
    returned = np.maximum(np.log1p(-spec.dropout) - 0.5 * off**2, IMPOSSIBLE)
    logs = np.where(echoes, returned, IMPOSSIBLE)
    nothing = np.where(echoes, np.log(spec.dropout) if spec.dropout else IMPOSSIBLE, 0.0)
    return float(np.where(rays.observed_m > 0, logs, nothing).sum())


@pytest.mark.parametrize("name", ["straight-past", "curve", "following-10"])
@pytest.mark.parametrize("radius_m", [0.0, 0.2, 0.4])
def test_the_likelihood_is_that_of_the_ray_caster(name, radius_m):
    run, rng = sense_drive(name, SEED, frames=19), np.random.default_rng(1)
    offsets = np.concatenate([np.zeros((1, 3)), rng.normal(size=(8, 3)) * (0.1, 0.1, 0.03)])
    bodies, out = bodies_of((0.1, radius_m)), np.zeros(len(offsets))
    states = CandidateStates(offsets, np.ones(len(offsets), int))
    add_log_likelihoods(states, rays_of(run, 18), bodies, receiver_of(run.spec), out)
    cast_ones = [by_ray_caster(run, 18, offset, with_corners(radius_m)) for offset in offsets]
    # Ranges of the caster are rounded to some micrometres, and a few rays graze an edge.
    assert out == pytest.approx(cast_ones, rel=2e-3)


def test_radii_are_spread_as_our_fit_supposes():
    rng = np.random.default_rng(1)
    states = np.zeros((20_000, VALUES))
    states[:, RADIUS] = rng.normal(size=20_000)
    fitted = np.array([part_of(ford_fusion().shape, 0, state).radius for state in states])
    rows = unknown_corners().rows_of(rng.normal(size=(20_000, 1)))
    shares = np.linspace(0.05, 0.95, 10)
    least, most = ford_fusion().radius_m
    floors = least + (most - least) * np.quantile(rows, shares) / 80
    assert floors == pytest.approx(np.quantile(fitted, shares), abs=0.01)
    assert (np.diff(unknown_corners().rows_of(np.linspace(-4, 4, 50)[:, None])) >= 0).all()


@pytest.mark.slow
def test_corners_that_are_not_known_raise_the_floor():
    run = sense_drive("curve", SEED, body="rounded", frames=12)
    known, unknown = (
        floor(run, draws=512, knowledge=Knowledge(corners=known)) for known in (True, False)
    )
    assert (unknown.shares > 0).all()
    assert np.mean(unknown.heading_rad**2) > 1.02 * np.mean(known.heading_rad**2)
    assert np.mean(unknown.position_m**2) > 1.02 * np.mean(known.position_m**2)


@pytest.mark.slow
def test_posterior_is_calibrated():
    """The mean squared error in units of the covariance is the number of dimensions."""
    runs = [
        sense_drive("curve", seed, body=body) for seed in range(2) for body in ("sharp", "rounded")
    ]
    for frames in (1, 3):
        values = np.concatenate([nees(floor(run, frames, draws=512)) for run in runs])
        # Neighbouring windows share frames: count a third of them.
        spread = values.std() / np.sqrt(len(values) / frames)
        assert values.mean() == pytest.approx(3.0, abs=3 * spread)


def test_more_frames_and_less_noise_lower_the_floor():
    run = sense_drive("straight", SEED, frames=9)
    levels = [np.nanmean(floor(run, n, draws=512).position_m ** 2) for n in (1, 3, 7)]
    assert levels[0] > 1.5 * levels[1] > 2.0 * levels[2]
    quiet = floor(sense_drive("straight", SEED, noise=0.5, frames=9), draws=512)
    assert np.nanmean(quiet.longitudinal_m) == pytest.approx(
        np.nanmean(floor(run, draws=512).longitudinal_m) / 2, rel=0.3
    )


def test_lag_says_which_frames_are_used():
    """Without later frames the last of a window is known worse than its middle."""
    run = sense_drive("curve", SEED, frames=6)
    causal, middle = floor(run, 5, lag=0, draws=512), floor(run, 5, draws=512)
    assert np.array_equal(causal.covariances[0], floor(run, draws=512).covariances[0])
    assert causal.heading_rad[3] > middle.heading_rad[3]


def test_frames_with_too_few_returns_have_no_floor():
    run = sense_drive("straight", SEED)
    information_floor = floor(run, draws=256)
    few = np.array([shot.target.sum() < 3 for shot in run.sweeps])
    assert few[-1]
    assert np.array_equal(np.isnan(information_floor.position_m), few)
    empty = replace(run, sweeps=run.sweeps[-2:])
    assert np.isnan(floor(empty, 3).position_m).all()


def test_a_speed_that_may_change_raises_the_floor_along_the_path():
    run = sense_drive("straight", SEED, frames=9)
    steady, gaining = (
        floor(run, 7, draws=512, knowledge=Knowledge(acceleration=known)) for known in (True, False)
    )
    assert np.nanmean(gaining.longitudinal_m**2) > 1.3 * np.nanmean(steady.longitudinal_m**2)
    alone = floor(run, 1, draws=512, knowledge=Knowledge(acceleration=False))
    assert np.array_equal(alone.covariances, floor(run, 1, draws=512).covariances, equal_nan=True)


def test_the_acceleration_is_that_of_the_path():
    run = sense_drive("following-10", SEED, frames=4)
    speeds = [motion_of(run, k).speed_m_s for k in (1, 3)]
    assert acceleration_of(run, 2) == pytest.approx((speeds[1] - speeds[0]) / 0.2, abs=1e-3)
    assert abs(acceleration_of(run, 2)) > 0.005
    assert acceleration_of(sense_drive("curve", SEED, frames=2), 1) == pytest.approx(0, abs=1e-6)


def test_offsets_later_are_those_of_the_closed_form():
    """A car that is displaced and turned now is displaced by the turned way later."""
    states = np.array([[0.1, 0.2, 0.05, 0.3, -0.1]])
    later = offsets_after(states, TrueMotion(20.0, 0.0), 0.1)
    heading = 0.05 - 0.1 * 0.1 / 2
    chord = 2.03 * np.sinc(0.1 * 0.1 / 2 / np.pi)
    assert later[0] == pytest.approx(
        [0.1 + chord * np.cos(heading) - 2.0, 0.2 + chord * np.sin(heading), 0.05 - 0.01]
    )
    assert offsets_after(np.zeros((1, 5)), TrueMotion(20.0, 0.5), 0.3) == pytest.approx(
        np.zeros((1, 3))
    )
    gained = offsets_after(np.array([[0, 0, 0, 0, 0, 2.0]]), TrueMotion(20.0, 0.0), -0.3)
    assert gained == pytest.approx(np.array([[0.09, 0.0, 0.0]]))
