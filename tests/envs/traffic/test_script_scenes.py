"""Properties of the scripted scenes and of the waiting ego."""

import numpy as np
import pytest
from bodies import gaps_m

from roadscope.envs import find_rig
from roadscope.envs.sensors import sense
from roadscope.envs.traffic import accept, record

SEEDS = range(60)
SCENES = ("cut-ins", "long-occlusion")


def centres(line):
    """(K, A, 2) box centres."""
    ahead = np.stack([np.cos(line.yaws), np.sin(line.yaws)], axis=-1)
    return line.axles + line.centre_ahead_m[:, None] * ahead


@pytest.mark.parametrize("name", SCENES)
def test_no_two_bodies_touch(name) -> None:
    for seed in SEEDS:
        line = record(name, seed)
        rows = range(0, len(line.stamps_s), 5)
        assert min(gaps_m(line, row).min() for row in rows) > 0.3, seed


@pytest.mark.parametrize("name", SCENES)
def test_motion_is_that_of_vehicles(name) -> None:
    for seed in SEEDS:
        line = record(name, seed)
        steps = np.diff(line.stamps_s)[:, None]
        lateral = np.diff(np.unwrap(line.yaws, axis=0), axis=0) / steps * line.speeds[1:]
        assert np.abs(lateral).max() < 3.0, seed
        assert np.abs(np.diff(line.speeds, axis=0) / steps).max() < 5.0, seed
        assert accept(line).least_objects >= 4


def test_a_van_cuts_in_before_the_ego_and_paths_cross() -> None:
    for seed in SEEDS:
        line = record("cut-ins", seed)
        relative = centres(line) - centres(line)[:, :1]
        van = relative[:, 3]
        assert van[0, 1] > 3.0
        assert abs(van[-1, 1]) < 0.5
        entered = int(np.argmax(van[:, 1] < 2.0))
        assert 5.0 < van[entered, 0] < 20.0, seed
        one, other = relative[:, 1], relative[:, 2]
        assert (one[0, 1] > 3.0) & (other[0, 1] < -3.0)
        assert (one[-1, 1] < -3.0) & (other[-1, 1] > 3.0)
        meeting = int(np.argmin(np.abs(one[:, 1] - other[:, 1])))
        assert np.linalg.norm(one[meeting] - other[meeting]) < 13.0


def test_a_lorry_hides_others_for_seconds() -> None:
    line = record("long-occlusion", 10_000, 8.0)
    truths = [truth for _, truth in sense(line, find_rig("hdl32e"), 10_000)]
    returns = np.array([truth.lidar_returns for truth in truths])
    away = np.array(
        [np.linalg.norm(t.centres - t.world_from_ego.translation, axis=1) for t in truths]
    )
    hidden = (returns < 5) & (away < 60.0)
    assert sum(longest_run(hidden[:, i]) >= 15 for i in range(3, 7)) >= 2
    assert hidden[:, 3:7].sum(axis=1).max() >= 2
    assert not hidden[-1, 3:5].any()


def longest_run(mask) -> int:
    longest = run = 0
    for value in mask:
        run = run + 1 if value else 0
        longest = max(longest, run)
    return longest


@pytest.mark.slow
def test_the_ego_waits_while_others_cross_both_ways() -> None:
    line = record("waiting", 10_000, 8.0)
    assert line.speeds[:, 0].max() < 0.2
    relative, heading = line.axles - line.axles[:, :1], line.yaws[0, 0]
    across = relative[..., 1] * np.cos(heading) - relative[..., 0] * np.sin(heading)
    there = line.present.all(axis=0)
    moved = np.where(there, across[-1] - across[0], 0.0)
    passed = np.sign(across[0]) != np.sign(across[-1])
    assert (passed & (moved > 15.0)).sum() >= 2
    assert (passed & (moved < -15.0)).sum() >= 2


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["empty-motorway", "empty-street"])
@pytest.mark.parametrize("seed", [10_000, 10_001, 10_003])
def test_an_empty_road_has_no_other_road_user(name, seed) -> None:
    line = record(name, seed)
    assert line.present.shape[1] == 1
    assert (line.speeds[0, 0] < 0.01) == bool(seed % 2)
    assert line.speeds[-1, 0] > 7.5
    pushes = np.diff(line.speeds[:, 0]) / np.diff(line.stamps_s)
    assert np.abs(pushes).max() < 2.2
    assert np.abs(np.diff(pushes) / np.diff(line.stamps_s)[1:]).max() < 2.0
    assert line.end_s > 25.0
    frames = [frame for frame, _ in sense(record(name, seed, 1.0), find_rig("vlp16-imu"), seed)]
    assert len(frames) >= 9
    assert min(len(frame.lidar) for frame in frames) > 0
