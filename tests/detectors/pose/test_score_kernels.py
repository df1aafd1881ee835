import numpy as np
import pytest

from roadscope.detectors.pose.filter_kernels import gaussian_taps, respond
from roadscope.detectors.pose.pair_kernels import Filter, sweep
from roadscope.detectors.pose.rotating_pair import Frames, settled_views
from roadscope.detectors.pose.score_kernels import LANES, free_scores

CAR = Filter(0.04, 0.05, 0.5, 4.5, 1.8, 2, 1e-3)


def scattered(rng, frames):
    """Frames of returns anywhere in a car, from sensors anywhere around it."""
    counts = rng.integers(1, 40, frames)
    points = [
        rng.uniform((17.6 + 2 * k, 2), (22.4 + 2 * k, 4), (n, 2)) for k, n in enumerate(counts)
    ]
    origins = [rng.uniform((2 * k - 3, -3), (2 * k + 3, 3)) for k in range(frames)]
    return viewed(points, origins)


def viewed(points, origins):
    starts, count = np.cumsum([0, *map(len, points)]), len(points)
    stamps = 0.1 * np.arange(count)
    given = Frames(np.concatenate(points), starts, np.array(origins), stamps, count // 2)
    return settled_views(given)[0]


@pytest.mark.parametrize("frames", [1, 2, 3])
@pytest.mark.parametrize("settings", [CAR, CAR._replace(power=0), CAR._replace(sigma_m=0.07)])
def test_many_angles_at_a_time_score_what_each_scores_alone(frames, settings):
    rng = np.random.default_rng(frames)
    for count in (1, LANES, LANES + 3):
        views, angles = scattered(rng, frames), rng.uniform(-4, 4, count)
        alone = sweep(views, angles, settings, False)[:, 0]
        # A tap four standard deviations away is cut off at either end of the bins.
        np.testing.assert_allclose(free_scores(views, angles, settings), alone, atol=1e-4)


def test_sensors_at_opposite_ends_are_scored_too():
    points = [np.array([[10.0, 0.0], [12.0, 0.3]]), np.array([[10.2, 0.1], [11.0, 0.0]])]
    origins = [np.array([0.0, 0.0]), np.array([20.0, 0.0])]
    views, angles = viewed(points, origins), np.linspace(0, np.pi, 12)
    alone = sweep(views, angles, CAR, False)[:, 0]
    np.testing.assert_allclose(free_scores(views, angles, CAR), alone, atol=1e-4)


def test_a_body_holds_a_return_from_one_of_its_ends_to_the_other():
    work, taps = np.empty((3, 401)), gaussian_taps(1.0)
    weighed = np.array([0.0, 4.0]), np.array([0.5, 0.5])
    respond(weighed, (1.0, 1.8, 0.0), (0.04, 0.04, 0.5), taps, work)
    middles_m, response = 0.04 * (np.arange(401) - 200), work[2]
    held = response[np.abs(middles_m) < 0.7]
    np.testing.assert_allclose(held, held[0], atol=1e-6)
    assert held[0] > response[0] + 0.2
    np.testing.assert_allclose(response[np.abs(middles_m) > 1.2].min(), -0.5)
