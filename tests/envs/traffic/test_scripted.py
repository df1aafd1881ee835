"""Event frames by plain geometry: boxes, the field of view, and lines of sight."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from roadscope.envs import find_rig
from roadscope.envs.sensors import sense
from roadscope.envs.traffic import (
    FRAME_S,
    LEFT_EDGE,
    SCENARIOS,
    SCRIPTS,
    SENSOR_AHEAD_M,
    Change,
    ScriptedMotion,
    play_script,
    record,
)

SEEDS = range(30)


def boxes(line, frames, shrink_m=0.0):
    """(F, A, 4, 2) corners of the boxes in the LiDAR's frame at frames."""
    states = line.at(frames * FRAME_S)
    length, width = line.sizes[:, 0] - 2 * shrink_m, line.sizes[:, 1] - 2 * shrink_m
    ahead = np.stack([np.cos(states.yaws), np.sin(states.yaws)], axis=-1)
    left = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)
    centres = states.axles + line.centre_ahead_m[:, None] * ahead
    fore = np.array([0.5, 0.5, -0.5, -0.5])[:, None] * length[:, None, None]
    side = np.array([-0.5, 0.5, 0.5, -0.5])[:, None] * width[:, None, None]
    corners = centres[:, :, None] + fore * ahead[:, :, None] + side * left[:, :, None]
    sensor = states.axles[:, :1] + SENSOR_AHEAD_M * ahead[:, :1]
    offset = corners - sensor[:, :, None]
    return np.stack(
        [(offset * ahead[:, :1, None]).sum(axis=-1), (offset * left[:, :1, None]).sum(axis=-1)],
        axis=-1,
    )


def in_view(corners):
    """Whether some of a box lies in the field of view, sampled along its outline."""
    ends = np.roll(corners, -1, axis=-2)
    fraction = np.linspace(0, 1, 50)[:, None, None]
    outline = corners[..., None, :, :] * (1 - fraction) + ends[..., None, :, :] * fraction
    azimuth = np.arctan2(outline[..., 1], outline[..., 0])
    return (np.abs(azimuth) < LEFT_EDGE).any(axis=(-1, -2))


def spans(corners):
    azimuth = np.arctan2(corners[..., 1], corners[..., 0])
    return azimuth.min(axis=-1), azimuth.max(axis=-1)


def run_of(frames, mask):
    run_frames = frames[mask]
    assert (np.diff(run_frames) == 1).all()
    return int(run_frames[0]), int(run_frames[-1])


@pytest.mark.parametrize("name", SCRIPTS)
def test_targets_are_in_view_in_exactly_the_frames_of_the_paper(name):
    script = SCRIPTS[name]
    frames = np.arange(1, script.frames + 1)
    for seed in SEEDS:
        visible = in_view(boxes(play_script(name, seed), frames))
        for target in range(1, visible.shape[1]):
            (event,) = script.of("in_view", target)
            assert run_of(frames, visible[:, target]) == (event.first, event.last), (seed, target)


def test_entering_and_leaving_keep_clear_of_frames():
    """A rolling shutter of a sixth of a frame, or a rounded corner, does not move the events."""
    script = SCRIPTS["lu2018-two-vehicles"]
    ((_, _, first, last),) = map(astuple, script.of("in_view", 2))
    for seed in SEEDS:
        line = play_script(script.name, seed)
        early = in_view(boxes(line, np.array([first - 0.84, last + 0.6])))[:, 2]
        assert early.tolist() == [False, True]
        late = in_view(boxes(line, np.array([first - 0.6, last + 0.84])))[:, 2]
        assert late.tolist() == [True, False]


def test_target_1_is_hidden_from_62_to_74_and_only_then():
    script = SCRIPTS["lu2018-occlusion"]
    (event,) = script.of("hidden", 1)
    assert (event.first, event.last) == (62, 74)
    frames = np.arange(1, script.frames + 1)
    for seed in SEEDS:
        line = play_script(script.name, seed)
        low, high = spans(boxes(line, frames))
        nearer = boxes(line, frames)[:, 2, :, 0].min(axis=1) < boxes(line, frames)[:, 1, :, 0].min(
            axis=1
        )
        hidden = (low[:, 2] <= low[:, 1]) & (high[:, 2] >= high[:, 1]) & nearer
        assert run_of(frames, hidden) == (62, 74)
        # Bodies have rounded corners: what hides must do so with 5 cm less on every side.
        thin_low, thin_high = spans(boxes(line, frames, shrink_m=0.05))
        still = (thin_low[:, 2] <= low[:, 1]) & (thin_high[:, 2] >= high[:, 1]) & nearer
        assert run_of(frames, still) == (62, 74)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", SCRIPTS)
def test_rays_meet_the_targets_in_exactly_those_frames(name):
    script, mount = SCRIPTS[name], find_rig("lux").lidar
    lux = replace(find_rig("lux"), lidar=replace(mount, first_stamp_s=FRAME_S))
    for seed in (2, 21):
        truths = [truth for _, truth in sense(play_script(name, seed), lux, seed)][: script.frames]
        returns = np.array([truth.lidar_returns for truth in truths])
        for target in range(1, returns.shape[1] + 1):
            (view,) = script.of("in_view", target)
            expected = {*range(view.first, view.last + 1)}
            for hidden in script.of("hidden", target):
                expected -= {*range(hidden.first, hidden.last + 1)}
            assert {*(np.flatnonzero(returns[:, target - 1]) + 1).tolist()} == expected


def test_target_1_can_be_seen_before_and_after_it_is_hidden():
    frames = np.array([61, 75, 76])
    for seed in SEEDS:
        low, high = spans(boxes(play_script("lu2018-occlusion", seed), frames))
        width = np.rad2deg(high[:, 1] - low[:, 1])
        right = np.rad2deg(low[0, 2] - low[0, 1])
        left = np.rad2deg(high[1:, 1] - high[1:, 2])
        assert right > 0.75
        assert left[0] > 0.5
        assert left[1] > 1.4
        assert width.min() > 2.0


def test_vehicles_keep_their_distance():
    for name, script in SCRIPTS.items():
        frames = np.arange(-2, 2 * script.frames) / 2
        for seed in SEEDS:
            line = play_script(name, seed)
            corners = boxes(line, frames)
            for target in range(1, corners.shape[1]):
                beside = np.abs(corners[:, target, :, 1]).min(axis=1) < 0.95
                assert corners[beside, target, :, 0].min(initial=9.0) > 0.1, (name, seed)


@pytest.mark.parametrize("name", SCRIPTS)
def test_motion_is_smooth_and_gentle(name):
    for seed in range(5):
        line = play_script(name, seed)
        fine = line.at(np.arange(line.start_s, line.end_s, 0.01))
        acceleration = np.diff(fine.velocities, axis=0) / 0.01
        assert np.abs(acceleration).max() < 4.5
        assert np.abs(np.diff(acceleration, axis=0)).max() / 0.01 < 40.0
        assert (line.speeds > 1.0).all()


@pytest.mark.parametrize("name", SCRIPTS)
def test_samples_are_frames_and_half_frames(name):
    line = play_script(name, 0)
    assert line.start_s <= -FRAME_S
    assert line.end_s >= (SCRIPTS[name].frames + 1) * FRAME_S
    np.testing.assert_allclose(np.diff(line.stamps_s), 0.04, atol=1e-12)
    frames = np.arange(1, SCRIPTS[name].frames + 1) * FRAME_S
    assert np.abs(frames[:, None] - line.stamps_s).min(axis=1).max() < 1e-12
    assert line.style == "campus"
    assert not line.crashed.any()
    assert SCENARIOS[name].duration_s == pytest.approx(line.end_s)


def test_scripted_misses_are_those_of_the_paper():
    events = SCRIPTS["lu2018-two-vehicles"].of("missed", 1)
    assert [(e.first, e.last) for e in events] == [(f, f) for f in (102, 148, 172, 177)]


def test_seeds_change_speeds_offsets_and_sizes():
    for name in SCRIPTS:
        lines = [record(name, seed) for seed in range(6)]
        assert len({tuple(line.sizes[1:].ravel()) for line in lines}) > 1
        assert len({float(line.speeds[0, 0]) for line in lines}) == 6
        assert record(name, 3) == lines[3]


def test_a_script_can_be_cut_short():
    assert record("lu2018-occlusion", 0, 2.0).end_s == pytest.approx(2.0)


def test_the_view_is_that_of_the_rig():
    mount = find_rig("lux").lidar
    np.testing.assert_allclose(mount.ego_from_lidar.translation, [SENSOR_AHEAD_M, 0, 0.55])
    azimuths = mount.spec.azimuths()
    step = np.abs(mount.spec.azimuth_span) / mount.spec.columns
    assert azimuths.max() == pytest.approx(LEFT_EDGE, abs=1.01 * step)
    assert mount.spec.period_s == FRAME_S


def test_motion_is_the_integral_of_its_velocity():
    motion = ScriptedMotion(3.0, -1.0, 9.0, (Change(1.0, 2.0, -4.0),), (Change(0.5, 3.0, 3.5),))
    times = np.linspace(0, 6, 60001)
    velocities = motion.velocities(times)
    middle = (velocities[1:] + velocities[:-1]) / 2 * np.diff(times)[:, None]
    walked = motion.positions(times[:1]) + np.cumsum(middle, axis=0)
    np.testing.assert_allclose(motion.positions(times[1:]), walked, atol=1e-6)
