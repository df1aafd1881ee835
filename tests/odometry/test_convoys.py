"""Why the scenarios exist: where traffic goes along, matching alone takes it for the world."""

import numpy as np
import pytest

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.ride import ride


def share_of_the_way(spec: str, seed: int) -> float:
    """How far an odometry says that the ego came, over how far it came."""
    both = ride(spec, Episode("convoy-pull-away", seed, "vlp16", 24.0)).both
    told, true = (
        float(np.linalg.norm(poses[-1, :3, 3] - poses[0, :3, 3]))
        for poses in (both.estimate, both.truth)
    )
    assert true > 80.0
    return told / true


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "module", "seed"),
    [
        ("kiss-icp", "kiss_icp", 10_002),
        ("small-gicp", "small_gicp", 10_001),
        ("small-gicp", "small_gicp", 10_003),
    ],
)
def test_in_a_convoy_matchers_stay_behind_and_without_it_they_come_along(
    spec: str, module: str, seed: int
) -> None:
    pytest.importorskip(module)
    assert share_of_the_way(spec, seed) < 0.5
    assert share_of_the_way(f"oracle?odometry={spec}", seed) > 0.85
