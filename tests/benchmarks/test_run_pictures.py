from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from roadscope import Episode, run_episode
from roadscope.benchmarks import FolderError, RunPictures, save_picture, save_video
from roadscope.core import ODOMETRY_COLOUR, RETURN_COLOURS, NotInstalledError, track_colour

EPISODE = Episode("lu2018-occlusion", 0, "lux", 1.0)


@pytest.fixture(scope="module")
def summary():
    return run_episode(EPISODE, detector="pag", tracker="gnn", odometry="still")


def has(image, colour, tolerance=4):
    return bool((np.abs(image.astype(int) - colour) < tolerance).all(axis=2).any())


def test_frames_have_one_size_and_show_all_answers(summary):
    pictures = RunPictures(summary)
    frames = [pictures.frame(k) for k in range(len(pictures))]
    assert {(frame.shape, frame.dtype) for frame in frames} == {
        ((720, 1280, 3), np.dtype(np.uint8))
    }
    assert len(summary.tracks[-1]) > 0
    for number in summary.tracks[-1].ids.tolist():
        assert has(frames[-1][:, :720], track_colour(number))
    # An odometry that stands still is left behind.
    assert has(frames[-1][400:, :720], ODOMETRY_COLOUR, 30)


def test_running_scores_end_at_the_scores_of_the_episode(summary):
    pictures = RunPictures(summary)
    scores = {score.name: score.values for score in pictures.snapshot(len(pictures) - 1).scores}
    assert all(len(values) == len(pictures) for values in scores.values())
    ends = [values[-1] for values in scores.values()]
    detection, tracking = summary.detection, summary.tracking
    assert ends == pytest.approx(
        [
            detection["detection_rate"].value,
            detection["false_alarms_per_frame"].value,
            tracking["recall"].value,
            tracking["id_switches"].value,
            summary.odometry["end"].value,
        ]
    )


def test_a_frame_does_not_depend_on_what_was_drawn_before(summary):
    first, second = RunPictures(summary), RunPictures(summary)
    first.frame(0)
    assert np.array_equal(first.frame(3), second.frame(3))


def test_returns_are_coloured_as_asked(summary):
    by_object, by_intensity = (
        RunPictures(summary, colour_by=each).frame(5)[:, :720] for each in ("object", "intensity")
    )
    assert has(by_object, RETURN_COLOURS["road user"])
    assert not has(by_intensity, RETURN_COLOURS["road user"])


def test_a_gif_is_read_back(summary, tmp_path):
    path = tmp_path / "drive.gif"
    save_video(summary, path, width=640)
    with Image.open(path) as video:
        assert (video.size, video.n_frames) == ((640, 360), len(summary.tracks))
        assert video.info["duration"] == 80
        assert video.info["loop"] == 0
        video.seek(video.n_frames - 1)
        shown = np.asarray(video.convert("RGB"), float)
    exact = Image.fromarray(RunPictures(summary).frame(len(summary.tracks) - 1))
    assert np.abs(shown - np.asarray(exact.resize((640, 360)), float)).mean() < 6


def test_a_video_can_show_every_third_scan_in_the_same_time(summary, tmp_path):
    path = tmp_path / "drive.gif"
    save_video(summary, path, width=320, every=3)
    with Image.open(path) as video:
        assert video.n_frames == -(-len(summary.tracks) // 3)
        assert video.info["duration"] == 240


def test_a_gif_of_too_many_frames_is_refused(summary, tmp_path):
    path = tmp_path / "drive.gif"
    longer = replace(summary, episode=replace(EPISODE, duration_s=200.0))
    with pytest.raises(FolderError, match="2500 frames"):
        save_video(longer, path)
    save_video(longer, path, width=320, every=2)
    with Image.open(path) as video:
        assert video.n_frames == -(-len(summary.tracks) // 2)


def test_an_mp4_is_read_back(summary, tmp_path):
    from moviepy import VideoFileClip

    path = tmp_path / "drive.mp4"
    save_video(summary, path)
    with VideoFileClip(str(path)) as clip:
        assert clip.size == [1280, 720]
        assert clip.fps == pytest.approx(12.5)
        assert clip.duration == pytest.approx(len(summary.tracks) / 12.5, abs=0.1)
        shown = clip.get_frame(0).astype(float)
    assert np.abs(shown - RunPictures(summary).frame(0)).mean() < 6
    assert [each.name for each in tmp_path.iterdir()] == ["drive.mp4"]


def test_an_mp4_without_moviepy_names_the_extra(summary, tmp_path, uninstall):
    uninstall("moviepy")
    with pytest.raises(NotInstalledError, match=r"roadscope\[video\]"):
        save_video(summary, tmp_path / "drive.mp4")
    save_video(summary, tmp_path / "drive.gif", width=320)


def test_a_picture_is_the_middle_frame(summary, tmp_path):
    save_picture(summary, tmp_path / "scene.png")
    pictures = RunPictures(summary)
    middle = pictures.frame(len(pictures) // 2)
    with Image.open(tmp_path / "scene.png") as picture:
        assert np.array_equal(np.asarray(picture), middle)


@pytest.mark.slow
def test_a_camera_rig_shows_its_image_with_the_boxes_of_a_camera_detector():
    episode = replace(EPISODE, scenario="street", rig="wide")
    summary = run_episode(episode, detector="pag", tracker="gnn")
    plain, boxes = (
        RunPictures(summary, camera_detector=each).frame(5) for each in (None, "oracle")
    )
    lidar = RunPictures(run_episode(replace(episode, rig="hdl32e"), detector="pag")).frame(5)
    assert plain.shape == lidar.shape
    image = plain[60:390, 740:1160]
    assert image.std() > 30
    assert not np.array_equal(boxes[60:390, 740:1160], image)


@pytest.mark.parametrize("severity", [2, 5])
def test_every_image_has_its_boxes_if_the_clock_of_the_camera_is_off(severity):
    faults = (f"clock-offset:{severity}",)
    episode = replace(EPISODE, rig="wide", duration_s=0.3, faults=faults)
    summary = run_episode(episode, detector="oracle", tracker="gnn")
    pictures = RunPictures(summary, camera_detector="oracle")
    snapshots = [pictures.snapshot(k) for k in range(len(pictures))]
    assert all(shown.image_detections is not None for shown in snapshots)


def test_a_picture_shows_the_boxes_of_a_camera_detector(tmp_path):
    episode = replace(EPISODE, scenario="street", rig="wide", duration_s=0.3)
    summary = run_episode(episode, detector="oracle", tracker="gnn")
    paths = [tmp_path / f"{detector}.png" for detector in (None, "oracle")]
    for path, detector in zip(paths, (None, "oracle"), strict=True):
        save_picture(summary, path, camera_detector=detector)
    plain, boxes = (np.asarray(Image.open(path)) for path in paths)
    assert not np.array_equal(plain[:400, 720:], boxes[:400, 720:])
    assert np.array_equal(plain[:, :720], boxes[:, :720])
