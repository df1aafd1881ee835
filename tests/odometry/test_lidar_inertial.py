"""The Kalman filter of LiDAR and IMU, its start, and its dynamic returns."""

from dataclasses import replace

import numpy as np
import pytest
from node_answers import poses_of
from toy_drive import ToyDrive, driven, offset

from roadscope.core import ImuSamples, Pose
from roadscope.envs.sensors import IMUS
from roadscope.odometry import (
    ODOMETRIES,
    ImuBuffer,
    LidarInertialOdometry,
    exp_se3,
    exp_so3,
    log_so3,
)
from roadscope.odometry.inertial import (
    FORCE,
    GRAVITY,
    GYRO,
    POSE,
    POSITION,
    SIZE,
    SPEED,
    TURN,
    WHEELS,
    Ends,
    InertialNoise,
    InertialTrack,
    RestHistory,
    diffusion,
    integrated,
    measured_rest,
    propagate,
    speed_of,
    started,
    transition,
    update_linear,
    update_pose,
)
from roadscope.odometry.voxels import CERTAIN, FreeSpace, ThinnedScan

NOISE = InertialNoise()


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def felt(rng, count=40):
    lengths = np.full(count, 1 / 400)
    return lengths, 0.3 * rng.standard_normal((count, 3)), rng.normal((0, 0, 9.8), 1.0, (count, 3))


def state_off_by(error):
    state = started(np.array([0.3, 0.1, 9.8]), np.array([5.0, 1.0, 0.2]), (1, 1, 1), NOISE)
    state.pose = exp_se3(np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]))
    state.pose[:3, 3] += error[POSITION]
    state.pose[:3, :3] = exp_so3(error[TURN]) @ state.pose[:3, :3]
    state.velocity = state.velocity + error[SPEED]
    state.rate_bias, state.force_bias = error[GYRO], error[FORCE]
    state.gravity = state.gravity + error[GRAVITY]
    state.wheel_scale = error[WHEELS]
    return state


def difference(one, other):
    return np.concatenate(
        [
            one.pose[:3, 3] - other.pose[:3, 3],
            log_so3(one.pose[:3, :3] @ other.pose[:3, :3].T),
            one.velocity - other.velocity,
            one.rate_bias - other.rate_bias,
            one.force_bias - other.force_bias,
            one.gravity - other.gravity,
            [one.wheel_scale - other.wheel_scale],
        ]
    )


def test_errors_propagate_like_differences(rng):
    samples, step = felt(rng), 1e-5
    still = np.zeros(SIZE)
    base = state_off_by(still)
    increment = integrated(*samples, base.pose[:3, :3].copy(), base.velocity, base.gravity)
    predicted = transition(increment[3], float(samples[0].sum()))
    propagate(base, *samples, NOISE)
    for k in range(SIZE):
        other = state_off_by(step * np.eye(SIZE)[k])
        propagate(other, *samples, NOISE)
        # Within a sample the turn is held to be constant.
        assert difference(other, base) / step == pytest.approx(predicted[:, k], abs=3e-3)


def test_integration_equals_that_of_the_slow_twin(rng):
    lengths, rates, forces = felt(rng)
    rotation, speed, gravity = (
        exp_so3(np.array([0.2, -0.1, 1.0])),
        np.ones(3),
        np.array([0, 0, -9.8]),
    )
    displacement, velocity, turned, _ = integrated(lengths, rates, forces, rotation, speed, gravity)
    at, fine = np.zeros(3), 50
    for dt, rate, force in zip(lengths, rates, forces, strict=True):
        for _ in range(fine):
            pushed = rotation @ exp_so3(rate * dt / fine / 2) @ force + gravity
            at = at + speed * dt / fine + pushed * (dt / fine) ** 2 / 2
            speed, rotation = speed + pushed * dt / fine, rotation @ exp_so3(rate * dt / fine)
    assert displacement == pytest.approx(at, abs=1e-6)
    assert velocity == pytest.approx(speed, abs=1e-5)
    assert np.abs(turned - rotation).max() < 1e-9


def test_process_noise_equals_that_of_random_samples(rng):
    samples = felt(rng, 80)
    ends = []
    for _ in range(400):
        state = state_off_by(np.zeros(SIZE))
        noisy = (
            samples[1] + NOISE.rate * 20 * rng.standard_normal((80, 3)),
            samples[2] + NOISE.force * 20 * rng.standard_normal((80, 3)),
        )
        propagate(state, samples[0], *noisy, NOISE)
        ends.append(state)
    off = np.array([difference(each, ends[0])[:9] for each in ends]).std(axis=0)
    deviations = np.sqrt(np.diag(diffusion(0.2, NOISE))[:9])
    assert off == pytest.approx(deviations, rel=0.2)


def test_an_update_by_a_pose_equals_the_linear_update(rng):
    one, other = state_off_by(np.zeros(SIZE)), state_off_by(np.zeros(SIZE))
    for state in (one, other):
        propagate(state, *felt(np.random.default_rng(1)), NOISE)
    information = np.diag(rng.uniform(1e3, 1e5, 6))
    residual = 1e-3 * rng.standard_normal(6)
    prior = np.linalg.inv(one.covariance[POSE, POSE] + 1e-12 * np.eye(6))
    best = np.linalg.solve(prior + information, information @ residual)
    pose = one.pose.copy()
    pose[:3, 3] += best[:3]
    pose[:3, :3] = exp_so3(best[3:]) @ pose[:3, :3]
    update_pose(one, pose, information)
    update_linear(other, np.eye(6, SIZE), residual, 1 / np.diag(information))
    assert difference(one, other) == pytest.approx(np.zeros(SIZE), abs=1e-6)
    assert np.abs(one.covariance - other.covariance).max() < 1e-6


def test_gravity_is_found_though_the_start_accelerates():
    """Of a start with 1 m/s^2 the force felt is tilted by 6 degrees; poses level it."""
    state = started(np.array([1.0, 0.0, 9.81]), np.zeros(3), (0.1, 0.1, 0.1), NOISE)
    lengths, still = np.full(40, 1 / 400), np.zeros((40, 3))
    for k in range(1, 31):
        propagate(state, lengths, still, np.tile([1.0, 0.0, 9.81], (40, 1)), NOISE)
        truth = np.eye(4)
        truth[0, 3] = 0.5 * (0.1 * k) ** 2
        update_pose(state, truth, np.diag([1e4] * 3 + [1e6] * 3))
    level = state.gravity - state.pose[:3, :3] @ state.force_bias
    assert level == pytest.approx([0.0, 0.0, -9.81], abs=0.05)
    assert state.velocity == pytest.approx([3.0, 0.0, 0.0], abs=0.03)


@pytest.mark.parametrize(("speed_m_s", "rate_rad_s"), [(0.0, 0.0), (8.0, 0.1), (24.0, 0.0)])
def test_the_speed_of_a_start_is_found(speed_m_s, rate_rad_s):
    drive = ToyDrive(speed_m_s, rate_rad_s)
    scans = [drive.scan(k) for k in range(6)]
    estimate = speed_of([Ends.of(each) for each in scans], rate_rad_s)
    assert estimate.reliable
    assert not speed_of([Ends.of(low(each)) for each in scans], rate_rad_s).reliable
    assert estimate.ahead_m_s == pytest.approx(speed_m_s, abs=0.4)


def test_the_speed_of_nothing_is_not_clear():
    drive = ToyDrive(8.0)
    bare = [Ends(np.empty((0, 2)), np.empty(0), *np.empty((3, 0), bool))] * 3
    assert not speed_of(bare, 0.0).clear
    assert not speed_of([Ends.of(drive.scan(0))], 0.0).clear


def low(scan):
    """Nothing that is taller than a car."""
    return scan.select(scan.points[:, 2] < 0.0)


def test_a_speed_without_fixtures_is_degraded_until_there_are_some():
    """Low things may all be vehicles that drive along."""
    inputs = driven(26)[1]
    odometry = ODOMETRIES.make("lidar-inertial")
    estimates = [odometry.update(low(s) if k < 12 else s, i) for k, (s, i) in enumerate(inputs)]
    assert not any(each.ok for each in estimates[1:12])
    assert {"too few fixtures determine the speed"} == {each.reason for each in estimates[6:12]}
    assert all(each.ok for each in estimates[20:])
    guessed, known = (
        estimates[b].covariance[0, 0] - estimates[a].covariance[0, 0]
        for a, b in ((5, 11), (19, 25))
    )
    assert guessed > 100 * known


def travelled_m(*, shake=0.0, selected=low):
    """Return the estimated distance of seven scans of a start at 24 m/s straight ahead, metres."""
    drive, odometry = ToyDrive(24.0, 0.0), ODOMETRIES.make("lidar-inertial")
    for k in range(7):
        imu = drive.imu(k)
        force = imu.specific_force + shake * np.sin(30 * imu.stamps_s)[:, None]
        estimate = odometry.update(selected(drive.scan(k)), replace(imu, specific_force=force))
    return estimate.start_from_lidar.translation[0]


def test_constant_samples_mean_rest_unless_fixtures_contradict():
    """Low things may all be traffic that passes."""
    assert abs(travelled_m()) < 0.1
    assert travelled_m(shake=0.3) == pytest.approx(14.4, abs=0.5)
    assert travelled_m(selected=lambda scan: scan) == pytest.approx(14.4, abs=0.5)


def test_objects_that_moved_in_are_dynamic_and_static_ones_are_not():
    space, drive = FreeSpace(), ToyDrive(0.0, 0.0)
    scan = drive.scan(0)
    space.add(0.0, scan.points, scan.ring, np.eye(4))
    car = np.column_stack([np.full(40, 8.0), np.linspace(-1, 1, 40), np.full(40, -0.9)])
    still = drive.scan(3).points.astype(float)
    assert (space.entered(0.3, car, car) >= CERTAIN).all()
    assert (space.entered(0.3, still, still) >= CERTAIN).mean() < 0.005
    assert not space.entered(0.1, car, car).any()


def back(at_m):
    """The back of a lorry, (K, 3) metres from the sensor, in the beams of a VLP-16."""
    across, up = np.meshgrid(np.linspace(-0.15, 0.15, 60), np.tan(np.deg2rad(np.arange(-5, 6, 2))))
    return at_m * np.column_stack([np.ones(across.size), across.ravel(), up.ravel()])


def dynamic_behind_lorry(driven_m, image):
    """Return which points are dynamic after two images of a lorry 10 m ahead and a distance."""
    space, rings = FreeSpace(), np.repeat(np.arange(6), 60)
    for stamp_s in (0.0, 0.6):
        space.add(stamp_s, back(10.0), rings, np.eye(4))
    return space.entered(0.9, image + np.array([driven_m, 0.0, 0.0]), image) >= CERTAIN


def test_a_vehicle_ahead_is_dynamic_and_what_it_hid_is_not():
    """No beam passed the place of a lorry's rear: the lorry itself hid it."""
    inside = np.abs(back(10.0)[:, 1]) < 1.2
    assert dynamic_behind_lorry(3.0, back(10.0))[inside].mean() > 0.9
    assert not dynamic_behind_lorry(3.0, back(14.0)).any()
    assert not dynamic_behind_lorry(0.0, back(10.0)).any()


@pytest.mark.parametrize("drop_dynamic", [True, False])
def test_dynamic_returns_are_neither_matched_nor_mapped(drop_dynamic):
    drive = ToyDrive()
    sweep = ThinnedScan.of(drive.scan(0), 0.3, 0.8)
    state = started(np.array([0, 0, 9.81]), np.zeros(3), (0.1, 0.1, 0.1), NOISE)
    track = InertialTrack(state, np.zeros(3), NOISE, reach_m=80.0, drop_dynamic=drop_dynamic)
    points = track.points_at_stamp(sweep)
    none = np.zeros(len(points), bool)
    track.add_to_map(sweep, points, none)
    assert track.matched(sweep, points, none).matched_points > 200
    assert (track.matched(sweep, points, ~none).matched_points == 0) == drop_dynamic
    before = track.map.voxels.counts.sum()
    track.add_to_map(sweep, points, ~none)
    assert (track.map.voxels.counts.sum() == before) == drop_dynamic


def samples(rng, shake, noise=NOISE):
    stamps = np.arange(0, 1.2, 1 / 400)
    rates = 0.01 + 18.8 * noise.rate * rng.standard_normal((len(stamps), 3))
    forces = np.array([0, 0, 9.81]) + 18 * noise.force * rng.standard_normal((len(stamps), 3))
    forces[:, 0] += shake * np.sin(3 * stamps)
    buffer = ImuBuffer(None)
    buffer.add(ImuSamples(stamps, rates, forces))
    return buffer


def test_rest_is_distinguished_from_driving(rng):
    rate, force = measured_rest(samples(rng, 0.0), 1.15, NOISE)
    assert rate == pytest.approx([0.01] * 3, abs=1e-3)
    assert force == pytest.approx([0, 0, 9.81], abs=0.01)
    assert measured_rest(samples(rng, 0.3), 1.15, NOISE) is None
    assert measured_rest(samples(rng, 0.0), 1.5, NOISE) is None


def test_rest_is_found_with_a_noisier_unit_of_known_noise(rng):
    worse = InertialNoise.of(IMUS["zed2"])
    assert measured_rest(samples(rng, 0.0, worse), 1.15, worse) is not None
    assert measured_rest(samples(rng, 0.0, worse), 1.15, NOISE) is None
    assert measured_rest(samples(rng, 1.0, worse), 1.15, worse) is None


def test_a_sensor_that_was_just_faster_is_not_at_rest():
    """Even braking is felt as evenly as standing is."""
    drive, odometry = ToyDrive(0.0, 0.0), LidarInertialOdometry()
    for k in range(14):
        odometry.update(drive.scan(k), drive.imu(k))
    assert not odometry._rest.is_empty
    odometry._rest, odometry._last_fast_s = RestHistory(NOISE), drive.scan(13).stamp_s
    at_rest = []
    for k in range(14, 26):
        odometry.update(drive.scan(k), drive.imu(k))
        at_rest.append(not odometry._rest.is_empty)
    assert at_rest == [False] * 9 + [True] * 3


def test_units_are_known_by_name():
    usual = InertialNoise.of(IMUS["adis16448"])
    for name in ("rate", "force", "rate_walk", "force_walk", "rate_bias", "force_bias"):
        assert getattr(usual, name) == pytest.approx(getattr(NOISE, name), rel=0.15)
    assert InertialNoise.of(IMUS["ideal"]).rate > 0
    assert LidarInertialOdometry(imu="zed2").noise.force > 2 * NOISE.force
    with pytest.raises(ValueError, match="no inertial unit 'zed'"):
        LidarInertialOdometry(imu="zed")


def test_a_lever_between_the_sensors_changes_nothing():
    """An IMU away from the LiDAR feels the pull of turning as well; the poses are the same."""
    drive, inputs = driven(12)
    at = np.array([-1.2, 0.3, -1.0])
    odometry = ODOMETRIES.make("lidar-inertial")
    odometry.reset(Pose.from_euler(*at, yaw=0.0, pitch=0.0, roll=0.0))
    pull = np.cross([0, 0, 0.1], np.cross([0, 0, 0.1], at))
    for scan, imu in inputs:
        estimate = odometry.update(scan, replace(imu, specific_force=imu.specific_force + pull))
    assert offset(estimate, drive.pose(inputs[-1][0].stamp_s))[0] < 0.02


def test_sizes_are_positive():
    with pytest.raises(ValueError, match="insert_m must be positive"):
        ODOMETRIES.make("lidar-inertial?insert_m=0")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "least_m", "t_rel"),
    [
        ("cold-start", 350.0, 1.0),
        ("convoy-pull-away", 250.0, 0.8),
        ("platoon", 500.0, 1.0),
        ("stop-and-go", 250.0, 0.6),
    ],
)
def test_traffic_does_not_pull(scenario, least_m, t_rel):
    """On a validation seed; a map that takes the traffic for the world drifts by 100 %."""
    from roadscope.benchmarks import Episode
    from roadscope.benchmarks.metrics import drift

    odometry_poses = poses_of("lidar-inertial", Episode(scenario, 10_000, "vlp16-imu"))
    assert odometry_poses.trajectories.distances[-1] > least_m
    assert drift(odometry_poses.trajectories).t_rel < t_rel
    assert odometry_poses.degraded.mean() < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["standing-in-traffic", "standing-barriers"])
def test_standing_is_standing(scenario):
    from roadscope.benchmarks import Episode
    from roadscope.benchmarks.metrics import score_standing

    odometry_poses = poses_of("lidar-inertial", Episode(scenario, 10_000, "vlp16-imu", 10.0))
    assert (
        score_standing(odometry_poses.trajectories, odometry_poses.stamps_s).false_motion.value
        < 0.05
    )
