from dataclasses import replace
from functools import cache
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import roadscope  # noqa: F401  (registers its ids)
from roadscope.core import GROUND, ImuSamples, Pose, RecordError
from roadscope.envs import find_rig
from roadscope.envs.sensors import (
    IMUS,
    PAGE,
    STANDARD_GRAVITY_M_S2,
    BodySway,
    EgoMotion,
    ImuMount,
    ImuNoise,
    Rig,
    Sensing,
    WheelSpec,
    measure,
    samples_of,
    scaled_noise,
    sense,
)
from roadscope.envs.traffic import Timeline, record
from tests.envs.sensors.inertial_drives import at_rest, integrated, stop_and_go
from tests.envs.sensors.test_sensing import shortened

ASKEW = Pose.from_euler(1.3, 0.4, 0.6, yaw=0.3, pitch=-0.2, roll=0.1)
FRAMES_S = 1.2


def mount(name: str) -> ImuMount:
    return ImuMount("imu", IMUS[name], ASKEW)


def taken(timeline: Timeline, name: str, last: int, sway: BodySway | None = None) -> ImuSamples:
    unit = mount(name)
    return measure(EgoMotion(timeline, sway), unit, ImuNoise(unit.spec, 3), 0, last)


def drifted(timeline: Timeline, sway: BodySway | None, until_s: float = 20.0) -> tuple[float, ...]:
    """Return how far dead reckoning without noise errs, metres, m/s and radians."""
    motion = EgoMotion(timeline, sway)
    stamps = np.array([0.0, until_s])
    rotations, places = motion.mounted(ASKEW, stamps)
    speeds = motion.at(stamps, ASKEW.translation).velocities
    samples = taken(timeline, "ideal", round(until_s * 400), sway)
    end, speed = integrated(samples, Pose.from_parts(rotations[0], places[0]), speeds[0])
    turned = 0.5 * (np.trace(end.rotation.T @ rotations[1]) - 1)
    return (
        float(np.linalg.norm(end.translation - places[1])),
        float(np.linalg.norm(speed - speeds[1])),
        float(np.arccos(min(turned, 1.0))),
    )


@cache
def recorded(name: str) -> Timeline:
    return record(name, 10_003, 20.5)


def allan_deviation(series: np.ndarray, size: int) -> np.ndarray:
    """(3,) of (N, 3) from means over as many samples, without overlap."""
    means = series[: len(series) // size * size].reshape(-1, size, series.shape[1]).mean(axis=1)
    return np.sqrt(0.5 * (np.diff(means, axis=0) ** 2).mean(axis=0))


@pytest.mark.parametrize("sway", [None, BodySway()], ids=["level", "swaying"])
def test_ideal_samples_lead_to_where_the_ego_is(sway: BodySway | None) -> None:
    away, faster, turned = drifted(stop_and_go(), sway)
    assert away < 0.005
    assert faster < 0.002
    assert turned < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("sway", [None, BodySway()], ids=["level", "swaying"])
@pytest.mark.parametrize(
    "name", ["motorway", "roundabout", "racetrack", "intersection", "hills", "bumps"]
)
def test_ideal_samples_lead_there_in_traffic(name: str, sway: BodySway | None) -> None:
    away, faster, turned = drifted(recorded(name), sway)
    assert away < 0.01
    assert faster < 0.002
    assert turned < 1e-4


@pytest.mark.parametrize("sway", [None, BodySway()], ids=["level", "swaying"])
def test_at_rest_there_is_gravity_alone(sway: BodySway | None) -> None:
    samples = taken(at_rest(), "ideal", 1000, sway)
    np.testing.assert_allclose(samples.angular_velocity, 0.0, atol=1e-10)
    upward = ASKEW.rotation.T @ [0.0, 0.0, STANDARD_GRAVITY_M_S2]
    np.testing.assert_allclose(samples.specific_force, np.tile(upward, (1001, 1)), atol=1e-9)


@pytest.mark.parametrize("name", ["adis16448", "zed2"])
def test_allan_deviation_recovers_noise_and_walk(name: str) -> None:
    """White noise shows at a tenth of a second, the walk of the bias at half a minute."""
    spec, last = IMUS[name], 400 * 1800
    noise = ImuNoise(spec, 5)
    white, biases = noise.white(0, last), noise.biases(0, last)
    for axes, density, walk in (
        (slice(0, 3), spec.gyro_noise, spec.gyro_walk),
        (slice(3, 6), spec.accelerometer_noise, spec.accelerometer_walk),
    ):
        deviation = allan_deviation((white + biases)[:, axes], 40)
        expected = np.hypot(density / np.sqrt(0.1), walk * np.sqrt(0.1 / 3))
        np.testing.assert_allclose(deviation, expected, rtol=0.03)
        wandered = allan_deviation(biases[:, axes], 12_000)
        assert np.sqrt((wandered**2).mean()) == pytest.approx(walk * np.sqrt(30 / 3), rel=0.2)


def test_the_samples_carry_that_noise() -> None:
    samples = taken(at_rest(61.0), "adis16448", 400 * 60)
    spec = IMUS["adis16448"]
    deviation = allan_deviation(samples.angular_velocity, 40)
    np.testing.assert_allclose(deviation, spec.gyro_noise / np.sqrt(0.1), rtol=0.15)
    deviation = allan_deviation(samples.specific_force, 40)
    np.testing.assert_allclose(deviation, spec.accelerometer_noise / np.sqrt(0.1), rtol=0.15)


def test_biases_at_turning_on_have_their_spread() -> None:
    spec = IMUS["adis16448"]
    first = np.array([ImuNoise(spec, seed).biases(0, 0)[0] for seed in range(400)])
    assert first[:, :3].std() == pytest.approx(spec.gyro_turn_on, rel=0.08)
    assert first[:, 3:].std() == pytest.approx(spec.accelerometer_turn_on, rel=0.08)


def test_noise_is_the_same_in_whatever_pieces() -> None:
    spec = IMUS["adis16448"]
    whole, late = ImuNoise(spec, 1), ImuNoise(spec, 1)
    span = (0, 9 * PAGE)
    expected = np.column_stack([whole.white(*span), whole.biases(*span)])
    for first, last in ((8 * PAGE - 3, 8 * PAGE + 5), (0, 2), (PAGE - 1, PAGE), (5, 7 * PAGE)):
        piece = np.column_stack([late.white(first, last), late.biases(first, last)])
        assert piece.tobytes() == expected[first : last + 1].tobytes()
    assert not np.array_equal(expected[:, 0], ImuNoise(spec, 2).white(*span)[:, 0])


def test_bandwidth_keeps_the_mean_and_quietens_the_noise() -> None:
    narrow = replace(IMUS["adis16448"], bandwidth_hz=20.0)
    assert narrow.response().sum() == pytest.approx(1.0)
    assert np.array_equal(IMUS["ideal"].response(), [1.0])
    unit = replace(mount("ideal"), spec=narrow)
    motion, noise = EgoMotion(at_rest(6.0)), ImuNoise(narrow, 3)
    spread = measure(motion, unit, noise, 0, 2000).angular_velocity.std(axis=0)
    assert spread.max() < 0.5 * narrow.gyro_noise * np.sqrt(400)


def test_what_is_out_of_range_reads_as_the_limit() -> None:
    unit = mount("ideal")
    short = replace(unit, spec=replace(unit.spec, accelerometer_range=9.0))
    motion = EgoMotion(at_rest())
    samples = measure(motion, short, ImuNoise(short.spec, 0), 0, 10)
    assert np.abs(samples.specific_force).max() == 9.0


@pytest.mark.parametrize("name", ["lux", "vlp16"])
@pytest.mark.parametrize("rate_hz", [30.0, 100.0, 400.0])
def test_numbers_of_samples_follow_each_other(name: str, rate_hz: float) -> None:
    carrier = find_rig(name).lidar
    spans = [samples_of(carrier, k, rate_hz) for k in range(200)]
    assert spans[0][0] == 0
    assert all(b[0] == a[1] + 1 for a, b in pairwise(spans))
    ends = [carrier.stamp_s(k) + carrier.spec.sweep_s / 2 for k in range(200)]
    late = np.array(ends) - [last / rate_hz for _, last in spans]
    assert ((late > -1e-6) & (late < 1 / rate_hz)).all()


@pytest.fixture(scope="module")
def timeline() -> Timeline:
    return record("roundabout", 10_003, FRAMES_S)


def small(imu: str | None, *, sway: bool = False) -> Rig:
    unit = None if imu is None else mount(imu)
    wheels = None if imu is None else WheelSpec()
    return replace(find_rig("lux"), imu=unit, wheels=wheels, sway=BodySway() if sway else None)


def test_scans_are_the_same_bytes_with_and_without_an_inertial_unit(timeline: Timeline) -> None:
    without = list(sense(timeline, small(None), 7))
    beside = list(sense(timeline, small("adis16448"), 7))
    assert 5 < len(beside) <= len(without)
    for (frame, truth), (plain, plain_truth) in zip(beside, without, strict=False):
        assert frame.imu is not None
        assert frame.wheels is not None
        sensor_names = [name for name, _ in plain.calibration.ego_from_sensor]
        assert [frame.calibration.pose(n) for n in sensor_names] == [
            plain.calibration.pose(n) for n in sensor_names
        ]
        assert replace(frame, imu=None, wheels=None, calibration=plain.calibration) == plain
        assert truth == plain_truth


@pytest.mark.parametrize("sway", [False, True])
def test_live_samples_are_the_recorded_ones_and_come_once(timeline: Timeline, sway: bool) -> None:
    carrier = small("adis16448", sway=sway)
    recorded = list(sense(timeline, carrier, 7))
    live, pieces = Sensing(carrier, 7), []
    for end_s in (0.05, 0.3, 0.31, 0.8, FRAMES_S):
        pieces += live.advance(shortened(timeline, end_s), end_s)
    assert pieces == recorded
    blocks = [frame.imu for frame, _ in pieces if frame.imu is not None]
    stamps = np.concatenate([block.stamps_s for block in blocks])
    np.testing.assert_allclose(stamps, np.arange(len(stamps)) / 400, atol=1e-12)
    other = next(iter(sense(timeline, carrier, 8)))[0].imu
    assert other is not None
    assert not np.array_equal(other.angular_velocity, blocks[0].angular_velocity)


def test_lost_scans_keep_their_inertial_samples(timeline: Timeline) -> None:
    carrier, fault = small("adis16448"), "dropped-scans:5"
    senses = (Sensing(carrier, seed, faults=fault) for seed in range(20))
    lossy = list(next(s for s in senses if s.scan_lost(3)).whole(timeline))
    assert any(frame.lidar is None for frame, _ in lossy)
    assert all(frame.imu is not None and len(frame.imu.stamps_s) > 0 for frame, _ in lossy)


def test_scans_of_a_swaying_body_lie_on_the_ground(timeline: Timeline) -> None:
    strong = BodySway(pitch_deg_per_g=10.0, roll_deg_per_g=10.0)
    carrier = replace(scaled_noise(find_rig("vlp16-imu"), 0.0), sway=strong)
    frame, truth = list(sense(timeline, carrier, 0))[5]
    assert frame.lidar is not None
    assert truth.world_from_ego.matrix[2, 2] < 1 - 1e-7
    ground = frame.calibration.pose("lidar").apply(frame.lidar.points[truth.sources == GROUND])
    assert len(ground) > 100
    level = timeline.world_from_ego(truth.stamp_s)
    heights = [np.abs(pose.apply(ground)[:, 2]).mean() for pose in (truth.world_from_ego, level)]
    assert heights[0] < min(0.02, 0.5 * heights[1])


def test_wheels_measure_the_speed() -> None:
    timeline = stop_and_go()
    motion = EgoMotion(timeline)
    exact = WheelSpec().scaled(0.0).measure(motion, 0, 0, 1900)
    here = motion.at(exact.stamps_s)
    np.testing.assert_allclose(
        np.abs(exact.speeds), np.linalg.norm(here.velocities, axis=1), atol=0.02
    )
    read = WheelSpec().measure(motion, 4, 0, 1900)
    assert (read.speeds[exact.speeds == 0.0] == 0.0).all()
    factor = (read.speeds @ exact.speeds) / (exact.speeds @ exact.speeds)
    assert 0 < abs(factor - 1) < 0.04
    noise = read.speeds - factor * exact.speeds
    assert noise[exact.speeds > 1].std() == pytest.approx(0.02, rel=0.15)
    part = WheelSpec().measure(motion, 4, 300, 310)
    assert np.array_equal(part.speeds, read.speeds[300:311])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('imu = "adis"', "no inertial unit 'adis'; known: adis16448, zed2, ideal"),
        ('imu = "zed2"\nsway = 1', "sway: expected true or false, got 1"),
    ],
)
def test_bad_inertial_keys_are_refused(tmp_path, text: str, message: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'lidar = "lux"\n{text}\n')
    with pytest.raises(RecordError, match=message):
        find_rig(path)


def test_a_file_asks_for_an_inertial_unit(tmp_path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('lidar = "vlp16"\nimu = "adis16448"\nwheels = true\nsway = true\n')
    made = find_rig(path)
    assert replace(made, name="vlp16-imu") == find_rig("vlp16-imu")
    assert scaled_noise(made, 0.5).imu.spec.gyro_noise == 0.5 * made.imu.spec.gyro_noise


def test_agents_observe_inertial_samples() -> None:
    env = gym.make("roadscope/Racetrack-v0", rig=small("zed2", sway=True))
    env.action_space.seed(0)
    first, _ = env.reset(seed=4)
    assert first["imu"].shape == (32, 6)
    assert not first["imu"].any()
    blocks = []
    for _ in range(6):
        observation, _, terminated, truncated, info = env.step(env.action_space.sample())
        blocks += [frame.imu for frame in info["frames"] if frame.imu is not None]
        if terminated or truncated:
            break
    felt = np.concatenate([np.column_stack([b.angular_velocity, b.specific_force]) for b in blocks])
    assert np.array_equal(observation["imu"], felt[-32:].astype(np.float32))
    recorded = sense(env.unwrapped._inner.recording(), small("zed2", sway=True), 4)
    expected = [f.imu for f, _ in recorded][: len(blocks)]
    assert blocks == expected


def test_check_env_has_nothing_to_say_of_inertial_samples() -> None:
    env = gym.make(
        "roadscope/Lu2018Occlusion-v0", rig=small("adis16448", sway=True), duration_s=1.0
    )
    check_env(env.unwrapped, skip_render_check=True)
