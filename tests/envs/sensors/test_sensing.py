from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import GROUND, Pose
from roadscope.envs import find_rig
from roadscope.envs.sensors import Sensing, scaled_noise, sense
from roadscope.envs.traffic import Timeline, record


@pytest.fixture(scope="module")
def timeline() -> Timeline:
    return record("merge", 3, 4.0)


def shortened(timeline: Timeline, end_s: float) -> Timeline:
    k = int(np.searchsorted(timeline.stamps_s, end_s + 1e-9))
    names = ("stamps_s", "present", "axles", "yaws", "speeds", "crashed")
    return replace(timeline, **{name: getattr(timeline, name)[:k] for name in names})


@pytest.mark.parametrize("name", ["lux", "vlp16"])
def test_every_sweep_comes_once_with_its_stamp(timeline: Timeline, name: str) -> None:
    out = list(sense(timeline, find_rig(name), 0))
    spec = find_rig(name).lidar.spec
    stamps = np.array([frame.stamp_s for frame, _ in out])
    np.testing.assert_allclose(stamps, spec.sweep_s / 2 + spec.period_s * np.arange(len(out)))
    assert stamps[-1] + spec.sweep_s / 2 <= timeline.end_s + 1e-9
    assert stamps[-1] + spec.sweep_s / 2 + spec.period_s > timeline.end_s + 1e-9


def test_a_growing_timeline_gives_the_same_bytes(timeline: Timeline) -> None:
    live = Sensing(find_rig("lux"), 5)
    pieces = []
    for end_s in (0.05, 0.5, 0.52, 2.0, 4.0):
        pieces += live.advance(shortened(timeline, end_s), end_s)
    assert pieces == list(sense(timeline, find_rig("lux"), 5))


def test_seeds_change_the_noise_and_nothing_else_does(timeline: Timeline) -> None:
    first = [next(iter(sense(timeline, find_rig("lux"), seed)))[0] for seed in (0, 0, 1)]
    assert first[0] == first[1]
    assert first[0] != first[2]


def test_returns_are_counted_and_lie_on_what_they_came_from(timeline: Timeline) -> None:
    quiet = scaled_noise(find_rig("hdl32e"), 0.0)
    frame, truth = list(sense(timeline, quiet, 0))[20]
    assert frame.lidar is not None
    assert len(truth.sources) == len(frame.lidar)
    counted = [(truth.sources == i).sum() for i in truth.ids]
    np.testing.assert_array_equal(truth.lidar_returns, counted)
    ego = frame.calibration.pose("lidar").apply(frame.lidar.points)
    assert np.abs(ego[truth.sources == GROUND, 2]).max() < 0.02
    visible_rows = np.flatnonzero(truth.lidar_returns > 20)
    assert len(visible_rows) > 2
    for row in visible_rows:
        box = Pose.planar(*truth.centres[row, :2], truth.yaws[row]).inverse()
        local = box.apply(truth.world_from_ego.apply(ego[truth.sources == truth.ids[row]]))
        # Half a sweep of relative motion shears a body by a metre or two at most.
        assert (np.abs(local[:, :2]) <= truth.sizes[row, :2] / 2 + 2.5).all()
        assert local[:, 2].max() <= truth.sizes[row, 2] + 0.02


def test_truth_velocity_is_the_derivative_of_the_centre(timeline: Timeline) -> None:
    out = [truth for _, truth in sense(timeline, find_rig("vlp16"), 0)]
    for before, now, after in zip(out[4:14], out[5:15], out[6:16], strict=True):
        for row, one in enumerate(now.ids):
            a, b = before.ids == one, after.ids == one
            if a.any() and b.any():
                mean = (after.centres[b][0, :2] - before.centres[a][0, :2]) / 0.2
                assert np.linalg.norm(now.velocities[row] - mean) < 1.0


def test_the_ego_is_never_part_of_the_truth_nor_seen(timeline: Timeline) -> None:
    for frame, truth in list(sense(timeline, find_rig("hdl32e"), 0))[:5]:
        assert timeline.ids[0] not in truth.ids
        assert timeline.ids[0] not in truth.sources
        assert frame.lidar is not None
        assert frame.camera is None


def test_hidden_objects_are_occluded_and_without_returns(timeline: Timeline) -> None:
    truths = [truth for _, truth in sense(timeline, find_rig("vlp16"), 0)]
    fraction = np.concatenate([truth.occluded_fraction for truth in truths])
    returns = np.concatenate([truth.lidar_returns for truth in truths])
    assert ((fraction >= 0) & (fraction <= 1)).all()
    assert (returns[fraction == 1] == 0).all()
    assert (fraction[returns > 0] < 1).all()
