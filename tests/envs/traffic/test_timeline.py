from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roadscope.core import RecordError
from roadscope.envs.traffic import Change, ScriptedMotion, Timeline
from tests.envs.worlds import timeline


def circle(times, radius, speed):
    turn = speed / radius * times
    axles = radius * np.stack([np.sin(turn), 1 - np.cos(turn)], axis=-1)
    return axles[:, None], turn[:, None], np.full((len(times), 1), speed)


finite = st.floats(-50, 50)


@st.composite
def timelines(draw):
    samples, actors = draw(st.integers(1, 6)), draw(st.integers(1, 4))
    steps = draw(arrays(float, samples, elements=st.floats(0.01, 1.0)))
    presence = np.zeros((samples, actors), bool)
    for actor in range(actors):
        first = draw(st.integers(0, samples - 1))
        presence[first : draw(st.integers(first, samples - 1)) + 1, actor] = True
    return timeline(
        np.cumsum(steps),
        draw(arrays(float, (samples, actors, 2), elements=finite)),
        draw(arrays(float, (samples, actors), elements=finite)),
        draw(arrays(float, (samples, actors), elements=finite)),
        present=presence,
    )


@given(timelines())
@settings(deadline=None, max_examples=60)
def test_interpolation_passes_through_the_samples(line):
    states = line.at(line.stamps_s)
    np.testing.assert_array_equal(states.present, line.present)
    here = line.present
    np.testing.assert_allclose(states.axles[here], line.axles[here], atol=1e-9)
    np.testing.assert_allclose(states.yaws[here], line.yaws[here], atol=1e-9)
    along = np.stack([np.cos(line.yaws), np.sin(line.yaws)], axis=-1) * line.speeds[..., None]
    np.testing.assert_allclose(states.velocities[here], along[here], atol=1e-6)


@given(timelines(), st.floats(0, 1))
@settings(deadline=None, max_examples=60)
def test_velocity_is_the_slope_of_position(line, fraction):
    step = 1e-6
    at = line.start_s + fraction * (line.end_s - line.start_s)
    around = line.at(np.array([at - step, at, at + step]))
    inside = ~np.isin(around.present.sum(axis=0), (1, 2)) & around.present[1]
    for stamp in line.stamps_s:
        if abs(stamp - at) < 2 * step:
            return
    slope = (around.axles[2] - around.axles[0]) / (2 * step)
    scale = 1 + np.abs(around.velocities[1]).max()
    np.testing.assert_allclose(slope[inside], around.velocities[1][inside], atol=1e-3 * scale)


@given(timelines(), st.floats(0.001, 3))
@settings(deadline=None, max_examples=60)
def test_outside_the_recording_motion_goes_on_at_constant_velocity(line, after):
    last, later = line.at(np.array([line.end_s])), line.at(np.array([line.end_s + after]))
    np.testing.assert_array_equal(last.present, later.present)
    here = last.present[0]
    expected = last.axles[0] + after * last.velocities[0]
    np.testing.assert_allclose(later.axles[0][here], expected[here], rtol=1e-9, atol=1e-6)
    np.testing.assert_array_equal(later.yaws[0][here], last.yaws[0][here])


def test_an_actor_is_absent_before_its_first_and_after_its_last_sample():
    times = np.arange(5.0)
    present = np.array([[1, 0], [1, 1], [1, 1], [1, 0], [1, 0]], bool)
    line = timeline(times, np.zeros((5, 2, 2)), np.zeros((5, 2)), np.zeros((5, 2)), present=present)
    present_at = line.at(np.array([-1.0, 0.999, 1.0, 1.5, 2.0, 2.001, 9.0])).present
    assert present_at[:, 1].tolist() == [False, False, True, True, True, False, False]
    assert present_at[:, 0].all()


def test_a_single_sample_moves_on_in_a_straight_line():
    line = timeline(np.array([1.0]), np.array([[[2.0, 3.0]]]), np.array([[0.5]]), np.array([[4.0]]))
    states = line.at(np.array([0.0, 1.0, 2.0]))
    along = 4.0 * np.array([np.cos(0.5), np.sin(0.5)])
    np.testing.assert_allclose(states.axles[:, 0], [2, 3] + along * [[-1], [0], [1]])
    np.testing.assert_allclose(states.velocities[:, 0], [along] * 3)


@pytest.mark.parametrize(("radius", "speed"), [(20.0, 7.5), (60.0, 13.0), (300.0, 30.0)])
def test_a_circle_at_20_hz_is_interpolated_within_a_millimetre(radius, speed):
    times, fine = np.arange(0, 4.001, 0.05), np.linspace(0, 4, 3001)
    line = timeline(times, *circle(times, radius, speed))
    expected, turn, _ = circle(fine, radius, speed)
    assert np.abs(line.at(fine).axles - expected).max() < 1e-3
    assert np.abs(line.at(fine).yaws - turn).max() < 1e-9


def test_a_lane_change_at_20_hz_is_interpolated_within_a_millimetre():
    motion = ScriptedMotion(0.0, 0.0, 25.0, (Change(1.0, 3.0, -4.0),), (Change(0.5, 4.0, 4.0),))
    times, fine = np.arange(0, 6.001, 0.05), np.linspace(0, 6, 4001)
    velocities = motion.velocities(times)
    yaws = np.arctan2(velocities[:, 1], velocities[:, 0])
    line = timeline(
        times, motion.positions(times)[:, None], yaws[:, None], np.hypot(*velocities.T)[:, None]
    )
    states = line.at(fine)
    assert np.abs(states.axles[:, 0] - motion.positions(fine)).max() < 1e-3
    # Linear interpolation of positions is what this must beat.
    linear = np.interp(fine, times, motion.positions(times)[:, 1])
    error = np.abs(states.axles[:, 0, 1] - motion.positions(fine)[:, 1]).max()
    assert error < 0.2 * np.abs(linear - motion.positions(fine)[:, 1]).max()


def test_the_pose_of_the_ego_is_that_of_actor_0():
    times = np.arange(0, 2.0, 0.1)
    line = timeline(times, *circle(times, 30.0, 8.0))
    pose = line.world_from_ego(0.73)
    np.testing.assert_allclose(pose.translation[:2], line.at(np.array([0.73])).axles[0, 0])
    assert pose.yaw == pytest.approx(8.0 / 30.0 * 0.73)


@given(timelines())
@settings(deadline=None, max_examples=20)
def test_saving_and_loading_changes_nothing(tmp_path_factory, line):
    line = replace(line, style="urban", raw=True, obstacles=np.ones((2, 6)))
    path = tmp_path_factory.mktemp("timelines") / "a.npz"
    line.save(path)
    assert Timeline.load(path) == line


def test_foreign_and_corrupt_files_are_refused_by_name(tmp_path):
    times = np.arange(3.0)
    line = timeline(times, *circle(times, 30.0, 8.0))
    line.save(tmp_path / "good.npz")
    whole = (tmp_path / "good.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    broken = bytearray(whole)
    broken[len(whole) // 3 : len(whole) // 3 + 40] = bytes(40)
    (tmp_path / "broken.npz").write_bytes(bytes(broken))
    (tmp_path / "text.npz").write_text("not a timeline")
    (tmp_path / "empty.npz").write_bytes(b"")
    np.savez(tmp_path / "foreign.npz", a=np.zeros(3))
    np.savez(tmp_path / "other.npz", header=np.array('{"format": "something else"}'))
    np.savez(tmp_path / "list.npz", header=np.array("[1]"))
    np.save(tmp_path / "array.npy", np.zeros(3))
    for name in ("cut", "broken", "text", "empty", "foreign", "other", "list"):
        with pytest.raises(RecordError, match=name):
            Timeline.load(tmp_path / f"{name}.npz")
    with pytest.raises(RecordError, match="array"):
        Timeline.load(tmp_path / "array.npy")
    with pytest.raises(FileNotFoundError):
        Timeline.load(tmp_path / "missing.npz")


def test_impossible_timelines_are_refused():
    times = np.arange(3.0)
    axles, yaws, speeds = circle(times, 30.0, 8.0)
    with pytest.raises(RecordError, match="stamps_s"):
        timeline(times[::-1], axles, yaws, speeds)
    with pytest.raises(RecordError, match="axles"):
        timeline(times, axles * np.nan, yaws, speeds)
    with pytest.raises(RecordError, match="speeds"):
        timeline(times, axles, yaws, speeds[:2])
    with pytest.raises(RecordError, match="obstacles"):
        timeline(times, axles, yaws, speeds, obstacles=np.zeros((1, 5)))
