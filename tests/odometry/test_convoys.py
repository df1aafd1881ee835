"""Why the scenarios exist: where traffic goes along, matching alone takes it for the world."""

import numpy as np
import pytest

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.ride import ride
from roadscope.benchmarks.metrics.odometry import drift

SEEDS = range(10_000, 10_003)


def share_of_the_way(spec: str, seed: int) -> float:
    """How far an odometry says that the ego came, over how far it came."""
    both = ride(spec, Episode("convoy-pull-away", seed, "vlp16-imu", 24.0)).both
    told, true = (
        float(np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3]))
        for poses in (both.estimate, both.truth)
    )
    assert true > 80.0
    return told / true


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "module"),
    [
        ("kiss-icp", "kiss_icp"), ("small-gicp", "small_gicp"), ("genz-icp", "genz_icp"),
        ("rko-lio", "rko_lio"),
    ],
)  # fmt: skip
def test_in_a_convoy_matchers_stay_behind_and_without_it_they_come_along(
    spec: str, module: str
) -> None:
    """Outcomes are bistable: some of the convoys take a matcher with them."""
    pytest.importorskip(module)
    shares = [share_of_the_way(spec, seed) for seed in SEEDS]
    assert min(shares) < 0.5, shares
    worst = int(np.argmin(shares))
    assert share_of_the_way(f"oracle?odometry={spec}", SEEDS[worst]) > 0.85


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10_010, 10_016))
def test_ours_comes_along_with_less_than_a_per_cent_of_drift(seed: int) -> None:
    both = ride("lidar-inertial", Episode("convoy-pull-away", seed, "vlp16-imu", 40.0)).both
    assert drift(both, (50.0, 100.0, 200.0), every=1).t_rel < 1.0
