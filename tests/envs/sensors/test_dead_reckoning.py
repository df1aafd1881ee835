from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from roadscope.core import Pose, RecordError
from roadscope.envs import find_rig
from roadscope.envs.sensors import DeadReckoning, scaled_noise, sense
from roadscope.envs.traffic import Timeline, record

STEP = Pose.planar(2.5, 0.1, 0.05)


@pytest.fixture(scope="module")
def timeline() -> Timeline:
    return record("merge", 3, 3.0)


def errors(motion: DeadReckoning, seeds: range, indices: range) -> np.ndarray:
    made = [[motion.estimate(STEP, 0.1, seed=s, index=i) for i in indices] for s in seeds]
    return np.array([[[*p.translation[:2], p.yaw] for p in row] for row in made]) - (2.5, 0.1, 0.05)


def test_errors_are_as_large_as_they_say() -> None:
    own = DeadReckoning(0.02, np.radians(0.5), np.radians(0.2), 0.003)
    off = errors(own, range(400), range(1, 21))
    common, single = off.mean(axis=1), off - off.mean(axis=1, keepdims=True)
    spread = single.std(axis=(0, 1)) * np.sqrt(20 / 19)
    assert spread == pytest.approx([0.003, 0.003, np.radians(0.2) * np.sqrt(0.1)], rel=0.05)
    expected = np.hypot([0.02 * 2.5, 0.02 * 0.1, 0.1 * np.radians(0.5)], spread / np.sqrt(20))
    assert common.std(axis=0) == pytest.approx(expected, rel=0.1)
    assert np.abs(common.mean(axis=0) / (expected / 20)).max() < 3.5


def test_the_estimate_is_of_the_motion_between_the_stamps(timeline: Timeline) -> None:
    out = list(sense(timeline, scaled_noise(find_rig("vlp16"), 0.0), 0))
    assert out[0][0].previous_from_ego is None
    for (_, before), (frame, truth) in pairwise(out):
        true = before.world_from_ego.inverse() @ truth.world_from_ego
        assert frame.previous_from_ego is not None
        np.testing.assert_allclose(frame.previous_from_ego.matrix, true.matrix, atol=1e-12)


def test_the_estimate_errs_and_changes_nothing_else(timeline: Timeline) -> None:
    exact = replace(find_rig("lux"), dead_reckoning=DeadReckoning().scaled(0.0))
    for (noisy, one), (clean, other) in zip(
        sense(timeline, find_rig("lux"), 4), sense(timeline, exact, 4), strict=True
    ):
        assert one == other
        assert noisy.lidar == clean.lidar
        if noisy.previous_from_ego is not None and clean.previous_from_ego is not None:
            off = clean.previous_from_ego.inverse() @ noisy.previous_from_ego
            assert 0 < np.linalg.norm(off.translation) < 0.2
            assert 0 < abs(off.yaw) < np.radians(0.05)


def test_negative_errors_are_refused() -> None:
    with pytest.raises(RecordError, match=r"DeadReckoning\.step_noise_m"):
        DeadReckoning(step_noise_m=-1.0)
