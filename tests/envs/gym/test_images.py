"""Images through Gymnasium: in the observation, in the frames, and as recorded."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from PIL import Image

import roadscope  # noqa: F401
from roadscope.envs import find_rig
from roadscope.envs.sensors import Sensing
from roadscope.envs.traffic import record


def test_the_latest_image_is_observed_and_every_one_is_in_the_frames() -> None:
    env = gym.make("roadscope/TwoWay-v0", rig="wide")
    first, _ = env.reset(seed=3)
    assert first["image"].std() > 5
    observation, _, _, _, info = env.step(env.action_space.sample())
    images = [frame for frame in info["frames"] if frame.camera is not None]
    scans = [frame for frame in info["frames"] if frame.lidar is not None]
    assert len(images) > len(scans) > 0
    assert np.array_equal(observation["image"], images[-1].camera.pixels)
    stamps = [frame.stamp_s for frame in info["frames"]]
    assert len(set(stamps)) == len(stamps)
    image_truths = [
        truth
        for frame, truth in zip(info["frames"], info["truths"], strict=True)
        if frame.camera is not None
    ]
    assert all(truth.image_boxes is not None for truth in image_truths)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*precision lowered:UserWarning")
@pytest.mark.parametrize("name", ["TwoWay-v0", "Street-v0"])
def test_pixel_truth_belongs_to_the_observed_image(name: str) -> None:
    brief = {"rig": "wide", "duration_s": 3.0}
    env = gym.make(f"roadscope/{name}", pixel_truth=True, **brief)
    assert env.observation_space["image"].shape == (480, 640, 3)
    check_env(env.unwrapped, skip_render_check=True)
    first, info = env.reset(seed=3)
    assert info["pixel_truth"].depth.shape == first["image"].shape[:2]
    _, _, _, _, info = env.step(env.action_space.sample())
    image_truths = [truth for truth in info["truths"] if truth.image_boxes is not None]
    assert image_truths[-1].pixels == info["pixel_truth"]
    assert all(truth.pixels is not None for truth in image_truths)
    plain = gym.make(f"roadscope/{name}", **brief)
    again, plain_info = plain.reset(seed=3)
    assert "pixel_truth" not in plain_info
    assert np.array_equal(first["image"], again["image"])
    light = gym.make(f"roadscope/{name}", pixel_truth=True, records=False, **brief)
    _, info = light.reset(seed=3)
    assert "truths" not in info
    assert info["pixel_truth"].instances.max() >= 0


@pytest.mark.slow
def test_images_leave_scans_as_they_are_and_are_the_same_again() -> None:
    from dataclasses import replace

    timeline = record("street", 2, 2.0)
    with_camera, without = find_rig("wide"), replace(find_rig("wide"), camera=None)
    frames = Sensing(with_camera, 2).advance(timeline, 1.0)
    scans = [pair for pair in frames if pair[0].lidar is not None]
    alone = Sensing(without, 2).advance(timeline, 1.0)
    assert [f.lidar for f, _ in scans] == [f.lidar for f, _ in alone]
    again = Sensing(with_camera, 2).advance(timeline, 1.0)
    assert [f.camera for f, _ in frames] == [f.camera for f, _ in again]
    in_steps = Sensing(with_camera, 2)
    pieces = [p for until in (0.3, 0.55, 1.0) for p in in_steps.advance(timeline, until)]
    assert [f for f, _ in pieces] == [f for f, _ in frames]


@pytest.mark.slow
def test_light_is_chosen_by_name() -> None:
    timeline = record("street", 2, 2.0)
    brightness = {}
    for light in ("day", "night"):
        sensing = Sensing(find_rig("wide"), 2, light=light)
        frame, _ = sensing.sense_image_at(timeline, 1.0)
        brightness[light] = frame.camera.pixels[:200].mean()
    assert brightness["night"] < 0.5 * brightness["day"]
    with pytest.raises(ValueError, match="no light 'noon'"):
        Sensing(find_rig("wide"), 2, light="noon")


@pytest.mark.parametrize("name", ["TwoWay-v0", "Lu2018Occlusion-v0"])
def test_light_is_chosen_in_gymnasium_too(name: str) -> None:
    shown = {}
    for light in (None, "night"):
        env = gym.make(f"roadscope/{name}", rig="wide", light=light)
        shown[light], _ = env.reset(seed=3)
    assert shown["night"]["image"].mean() < 0.5 * shown[None]["image"].mean()
    assert np.array_equal(shown["night"]["lidar_range"], shown[None]["lidar_range"])


@pytest.mark.slow
def test_live_frames_with_faults_equal_the_recorded_ones() -> None:
    faults = "rain:2 + glare:3 + dropped-scans:5 + blackout:5 + clock-offset:4 + extrinsic-error:3"
    env = gym.make("roadscope/TwoWay-v0", rig="wide", faults=faults, render_mode="rgb_array")
    live = []
    for action in (None, 1, 1):
        if action is None:
            observation, info = env.reset(seed=3)
        else:
            observation, *_, info = env.step(action)
        assert env.observation_space.contains(observation)
        assert env.render().shape == (720, 1280, 3)
        live += zip(info["frames"], info["truths"], strict=True)
    recording = env.unwrapped._inner.recording()
    sensing = Sensing(find_rig("wide"), 3, "urban", faults=faults)
    assert live == sensing.advance(recording, recording.end_s)
    assert any(frame.camera is None and frame.lidar is None for frame, _ in live)
    with pytest.raises(ValueError, match="no fault 'hail'"):
        gym.make("roadscope/TwoWay-v0", faults=["hail:1"])


def test_the_sun_of_a_glare_does_not_move_with_the_ego() -> None:
    timeline = record("racetrack", 2, 6.0)
    sensing = Sensing(find_rig("wide"), 2, faults="glare:3")
    suns = [sensing._light_of(timeline, stamp_s).sun_azimuth for stamp_s in (5.0, 0.02, 3.0)]
    turned = [timeline.world_from_ego(stamp_s).yaw for stamp_s in (0.02, 5.0)]
    assert len(set(suns)) == 1
    assert abs(suns[0] - turned[0]) <= 0.1
    assert abs(turned[1] - turned[0]) > 0.2


def test_the_image_of_the_camera_is_in_the_frame() -> None:
    env = gym.make("roadscope/Street-v0", rig="wide", render_mode="rgb_array")
    observation, _ = env.reset(seed=0)
    frame = env.render()
    image = Image.fromarray(observation["image"])
    # Its place and size: below the title, as high as range image, scores and legend leave space.
    correlation = max(
        np.corrcoef(
            np.asarray(image.resize((width, width * 3 // 4))).ravel(),
            frame[top : top + width * 3 // 4, 732 : 732 + width].ravel(),
        )[0, 1]
        for width in range(400, 530, 3)
        for top in range(57, 62)
    )
    assert correlation > 0.9
