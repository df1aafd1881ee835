"""Why the scenarios exist: where traffic goes along, matching alone takes it for the world."""

import numpy as np
import pytest
from node_answers import poses_of, poses_of_each

from roadscope.benchmarks import Episode, EpisodePoses
from roadscope.benchmarks.metrics import drift
from roadscope.odometry import ODOMETRIES

SEEDS = range(10_000, 10_003)
PEERS = ("kiss-icp", "small-gicp", "rko-lio")


def share_of_true_distance(poses: EpisodePoses) -> float:
    """Return the estimated distance from start to end, over the true one."""
    both = poses.trajectories
    estimated_m, true = (
        float(np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3]))
        for poses in (both.estimate, both.truth)
    )
    assert true > 80.0
    return estimated_m / true


@pytest.mark.slow
def test_in_a_convoy_matchers_stay_behind_and_without_it_they_come_along() -> None:
    """Outcomes are bistable: convoys take most along, and truth frees some of these."""
    left = [peer for peer in PEERS if not ODOMETRIES.missing(peer)]
    if not left:
        pytest.skip("no peer is installed")
    shares: dict[str, list[tuple[float, float]]] = {peer: [] for peer in left}
    for seed in SEEDS:
        specs = [spec for peer in left for spec in (peer, f"oracle?odometry={peer}")]
        poses = poses_of_each(specs, Episode("convoy-pull-away", seed, "vlp16-imu", 24.0))
        for peer in left:
            shares[peer].append(
                tuple(share_of_true_distance(poses[s]) for s in (peer, f"oracle?odometry={peer}"))
            )
        left = [p for p in left if not (shares[p][-1][0] < 0.5 and shares[p][-1][1] > 0.85)]
        if not left:
            return
    pytest.fail(f"shares of the way, and with truth, of {left}: {shares}")


@pytest.mark.slow
def test_ours_comes_along_with_little_drift() -> None:
    """The suite `odometry-convoy` asks the same of twenty other seeds."""
    odometry_poses = poses_of(
        "lidar-inertial", Episode("convoy-pull-away", 10_010, "vlp16-imu", 40.0)
    )
    assert drift(odometry_poses.trajectories, (50.0, 100.0, 200.0), every=1).t_rel < 1.0
