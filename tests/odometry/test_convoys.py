"""Why the scenarios exist: where traffic goes along, matching alone takes it for the world."""

import numpy as np
import pytest
from node_answers import poses_of

from roadscope.benchmarks import Episode
from roadscope.benchmarks.metrics import drift

SEEDS = range(10_000, 10_003)


def share_of_the_way(spec: str, seed: int) -> float:
    """How far an odometry says that the ego came, over how far it came."""
    both = poses_of(spec, Episode("convoy-pull-away", seed, "vlp16-imu", 24.0)).trajectories
    told, true = (
        float(np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3]))
        for poses in (both.estimate, both.truth)
    )
    assert true > 80.0
    return told / true


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "module"),
    [("kiss-icp", "kiss_icp"), ("small-gicp", "small_gicp"), ("rko-lio", "rko_lio")],
)
def test_in_a_convoy_matchers_stay_behind_and_without_it_they_come_along(
    spec: str, module: str
) -> None:
    """Outcomes are bistable: convoys take most along, and truth frees some of these."""
    pytest.importorskip(module)
    shares = []
    for seed in SEEDS:
        shares.append([share_of_the_way(spec, seed)])
        if shares[-1][0] < 0.5:
            shares[-1].append(share_of_the_way(f"oracle?odometry={spec}", seed))
            if shares[-1][1] > 0.85:
                return
    pytest.fail(f"shares of the way, and with truth: {shares}")


@pytest.mark.slow
def test_ours_comes_along_with_little_drift() -> None:
    """The suite `odometry-convoy` asks the same of twenty other seeds."""
    rides = [
        poses_of("lidar-inertial", Episode("convoy-pull-away", seed, "vlp16-imu", 40.0))
        for seed in range(10_010, 10_013)
    ]
    drifts = np.array([drift(r.trajectories, (50.0, 100.0, 200.0), every=1).t_rel for r in rides])
    assert drifts.max() < 1.0, drifts
