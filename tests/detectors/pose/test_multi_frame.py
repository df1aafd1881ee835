import numpy as np
import pytest

from roadscope.detectors.pose import axis_difference, fit_multi, fit_single

SIZE = {"length_m": 4.87, "width_m": 1.85}
STAMPS = np.array([0.0, 0.1, 0.2])


def rear_and_flank(pose, rng, count=9):
    """Returns of the two faces of a brick that are seen from behind and from its right."""
    x, y, yaw = pose
    length, width = SIZE.values()
    rear = np.column_stack([np.full(count, -length / 2), np.linspace(-0.9, 0.9, count)])
    flank = np.column_stack([np.linspace(-2.3, 2.3, 4), np.full(4, -width / 2)])
    points = np.concatenate([rear, flank]) + 0.02 * rng.standard_normal((count + 4, 2))
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return points @ turn.T + (x, y)


def drive(start, speed_m_s, seed=0, stamps=STAMPS):
    rng = np.random.default_rng(seed)
    x, y, yaw = start
    poses = [
        (x + speed_m_s * t * np.cos(yaw), y + speed_m_s * t * np.sin(yaw), yaw) for t in stamps
    ]
    return [rear_and_flank(pose, rng) for pose in poses], np.array(poses)


def behind(pose, distance_m=30.0):
    x, y, yaw = pose
    bearing = yaw + 0.2
    return np.array([x, y]) - distance_m * np.array([np.cos(bearing), np.sin(bearing)])


@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize("speed_m_s", [20.0, 0.0, 3.0])
@pytest.mark.parametrize("at", [None, 0, -1])
def test_finds_each_frame_of_a_straight_drive(tied, speed_m_s, at):
    frames, poses = drive((30.0, 2.0, 0.3), speed_m_s)
    origins = [behind(poses[0])] * 3
    fitted = fit_multi(frames, origins, STAMPS, at=at, tied=tied, **SIZE)
    x, y, yaw = poses[1 if at is None else at]
    assert np.hypot(fitted.x - x, fitted.y - y) < 0.06
    assert np.degrees(abs(axis_difference(fitted.yaw, yaw))) < 1.0


def test_the_front_is_where_the_body_moved_to():
    frames, poses = drive((30.0, 2.0, 0.3), 10.0)
    origins = [behind(poses[0])] * 3
    ahead = fit_multi(frames, origins, STAMPS, **SIZE)
    back = fit_multi(frames[::-1], origins, STAMPS, **SIZE)
    assert np.cos(ahead.yaw - 0.3) > 0.99
    assert np.cos(back.yaw - 0.3) < -0.99


def test_three_frames_are_better_than_one():
    errors = []
    for seed in range(40):
        frames, poses = drive((30.0, 2.0, 0.3), 20.0, seed)
        origins = [behind(poses[0])] * 3
        three = fit_multi(frames, origins, STAMPS, **SIZE)
        one = fit_single(frames[1], origins[1], **SIZE)
        errors.append([axis_difference(fit.yaw, 0.3) for fit in (three, one)])
    three_deg, one_deg = np.sqrt(np.mean(np.square(errors), axis=0))
    assert three_deg < 0.8 * one_deg


def test_one_frame_is_the_single_fit():
    frames, poses = drive((30.0, 2.0, 0.3), 20.0)
    one = fit_multi(frames[:1], [behind(poses[0])], STAMPS[:1], **SIZE)
    single = fit_single(frames[0], behind(poses[0]), **SIZE)
    assert one == single


def test_a_sensor_that_moves_along_gives_the_same_pose():
    frames, poses = drive((30.0, 2.0, 0.3), 20.0)
    origins = [behind(pose) for pose in poses]
    fitted = fit_multi(frames, origins, STAMPS, **SIZE)
    assert np.hypot(*(fitted.centre - poses[1, :2])) < 0.06


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frames": []}, "at least 1 frame"),
        ({"origins": np.zeros((2, 2))}, "origins and stamps"),
        ({"stamps_s": [0.0, 0.1, 0.1]}, "rising"),
        ({"stamps_s": [0.0, np.nan, 0.1]}, "rising"),
        ({"at": 3}, "at must name"),
        ({"frames": [np.ones((2, 2)), np.empty((0, 2)), np.ones((2, 2))]}, "at least 1 point"),
        ({"frames": [np.ones((2, 2)), np.full((1, 2), np.inf), np.ones((2, 2))]}, "finite"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(change, message):
    arguments = {"frames": [np.ones((2, 2))] * 3, "origins": np.zeros((3, 2)), "stamps_s": STAMPS}
    with pytest.raises(ValueError, match=message):
        fit_multi(**{**arguments, **change}, **SIZE)
