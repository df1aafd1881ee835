"""Recordings of Rerun, read back: entities, counts, places, scores."""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from recordings import Logged, read_recording

from roadscope.benchmarks import Episode
from roadscope.benchmarks.viewing import EpisodeView, save_recording, view_of_scenario
from roadscope.core import Category, Frame, Pose, Truth
from roadscope.envs import Sensing, Timeline, find_rig, record_traffic

pytest.importorskip("rerun", reason="rerun-sdk is not installed")

SCENARIO, SEED, SECONDS, RIG = "roundabout", 3, 0.6, "wide"


@pytest.fixture(scope="module")
def view() -> EpisodeView:
    return view_of_scenario(
        Episode(SCENARIO, SEED, RIG, SECONDS),
        detector="noisy?miss=0.2",
        tracker="nearest",
        odometry="still",
        camera_detector="oracle",
    )


@pytest.fixture(scope="module")
def logged(
    view: EpisodeView, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, dict[str, Logged]]:
    path = tmp_path_factory.mktemp("recordings") / "scene.rrd"
    return read_recording(save_recording(view, path))


@pytest.fixture(scope="module")
def timeline() -> Timeline:
    return record_traffic(SCENARIO, SEED, SECONDS)


@pytest.fixture(scope="module")
def sensed(timeline: Timeline) -> list[tuple[Frame, Truth]]:
    return list(Sensing(find_rig(RIG), SEED).whole(timeline))


def scans(sensed: list[tuple[Frame, Truth]]) -> Iterator[tuple[Frame, Truth]]:
    return ((frame, truth) for frame, truth in sensed if frame.lidar is not None)


def pose(entity: dict[str, Logged], stamp_s: float | None) -> Pose:
    """Return a transform that was logged at a time, or static (None)."""
    columns, shift = (
        (each.static if stamp_s is None else each.at(stamp_s))[0]
        for each in (entity["Transform3D:mat3x3"], entity["Transform3D:translation"])
    )
    # Rerun keeps matrices column by column, in single precision.
    left, _, right = np.linalg.svd(np.array(columns).reshape(3, 3).T)
    return Pose.from_parts(left @ right, np.array(shift))


def test_truth_boxes_are_those_of_the_sensors_truth(logged, sensed) -> None:
    truth_boxes = logged["/world/truth"]
    for _, truth in scans(sensed):
        assert truth_boxes["Boxes3D:labels"].at(truth.stamp_s) == [
            f"{Category(category).name.lower()} {number}"
            for category, number in zip(truth.categories, truth.ids, strict=True)
        ]
        centres = np.array(truth_boxes["Boxes3D:centers"].at(truth.stamp_s))
        np.testing.assert_allclose(centres, truth.centres, atol=1e-3)
        halves = np.array(truth_boxes["Boxes3D:half_sizes"].at(truth.stamp_s))
        np.testing.assert_allclose(2 * halves, truth.sizes, atol=1e-3)
        *_, sin, cos = np.array(truth_boxes["Boxes3D:quaternions"].at(truth.stamp_s)).T
        turned = np.exp(2j * np.arctan2(sin, cos))
        np.testing.assert_allclose(turned, np.exp(1j * truth.yaws), atol=1e-5)
    assert len(truth_boxes["Boxes3D:labels"].times()) == len(list(scans(sensed)))


def test_returns_are_where_the_ego_truly_met_them(logged, sensed, timeline) -> None:
    mount = find_rig(RIG).lidar
    lidar = f"/world/ego/{mount.name}"
    for frame, truth in scans(sensed):
        scan = frame.lidar
        assert scan is not None
        points = np.array(logged[f"{lidar}/returns"]["Points3D:positions"].at(truth.stamp_s))
        world_from_lidar = pose(logged["/world/ego"], truth.stamp_s) @ pose(logged[lidar], None)
        own_times = scan.stamp_s + scan.time_offset_s.astype(float)
        rows = np.linspace(0, len(scan) - 1, 40).astype(int)
        expected = np.array(
            [
                timeline.world_from_ego(own_times[k]).apply(
                    mount.ego_from_lidar.apply(scan.points[k].astype(float))
                )
                for k in rows
            ]
        )
        np.testing.assert_allclose(world_from_lidar.apply(points[rows]), expected, atol=0.03)


def test_returns_have_the_class_of_their_object(logged, sensed) -> None:
    classes = logged[f"/world/ego/{find_rig(RIG).lidar.name}/returns"]["Points3D:class_ids"]
    named = {info[0]["info"]["label"]: info[0]["info"]["id"] for info in _infos(logged)}
    of_cars = 0
    for _, truth in scans(sensed):
        logged_classes = np.array(classes.at(truth.stamp_s))
        assert ((logged_classes == named["ground"]) == (truth.sources == -1)).all()
        for number, category in zip(truth.ids, truth.categories, strict=True):
            own = logged_classes[truth.sources == number]
            assert (own == category).all()
            of_cars += len(own)
    assert of_cars > 100


def _infos(logged: dict[str, dict[str, Logged]]) -> list[Any]:
    (context,) = logged["/world"]["AnnotationContext:context"].static
    return [[{"info": each["class_description"]["info"]}] for each in context]


def test_detections_and_tracks_are_those_of_the_plug_ins(view, logged) -> None:
    assert sum(map(len, view.tracks)) > 10
    for detections, tracks in zip(view.detections, view.tracks, strict=True):
        boxes = logged["/world/detections"]["Boxes3D:centers"].at(detections.stamp_s)
        np.testing.assert_allclose(np.array(boxes).reshape(-1, 3), detections.centres, atol=1e-3)
        ids = [str(number) for number in tracks.ids]
        assert logged["/world/tracks"]["Boxes3D:labels"].at(tracks.stamp_s) == ids
        tails = logged["/world/tracks/tails"]["LineStrips3D:strips"].at(tracks.stamp_s)
        for tail, centre in zip(tails, tracks.centres, strict=True):
            np.testing.assert_allclose(tail[-1], centre, atol=1e-3)
    lengths = [len(tail) for tail in tails]
    assert max(lengths) == len(view.tracks)


def test_images_have_boxes_of_what_is_visible(logged, sensed) -> None:
    place = f"/world/ego/{find_rig(RIG).camera.name}"
    images = [(frame, truth) for frame, truth in sensed if frame.camera is not None]
    assert images
    for frame, truth in images:
        (blob,) = logged[f"{place}/image"]["EncodedImage:blob"].at(truth.stamp_s)
        shown = np.asarray(Image.open(BytesIO(bytes(blob))), float)
        assert abs(shown - frame.camera.pixels).mean() < 4
        visible = truth.visible_pixels > 0
        halves = np.array(logged[f"{place}/image/truth"]["Boxes2D:half_sizes"].at(truth.stamp_s))
        sides = truth.image_boxes[visible, 2:] - truth.image_boxes[visible, :2]
        np.testing.assert_allclose(2 * halves.reshape(-1, 2), sides, atol=0.1)
    assert f"{place}/image/detections" in logged
    matrix = np.array(logged[place]["Pinhole:image_from_camera"].static[0]).reshape(3, 3).T
    np.testing.assert_allclose(matrix, images[0][0].camera.intrinsics, rtol=1e-6)


def test_scores_end_with_those_of_the_episode(view, logged) -> None:
    shown = [(c.board, c.metric) for c in view.curves if c.board != "odometry"]
    assert ("tracking", "hota") in shown
    for board, metric in shown:
        values = logged[f"/scores/{board}/{metric}"]["Scalars:scalars"]
        (last,) = values.at(view.truths[-1].stamp_s)
        assert last == pytest.approx(view.scores[board][metric].value)
        assert len(values.times()) > 1


def test_an_odometry_that_stands_still_stays_at_the_start(view, logged) -> None:
    first, last = view.truths[0], view.truths[-1]
    drawn = pose(logged["/world/odometry"], last.stamp_s)
    # Before its first pose it is nowhere, not at the origin of the world.
    assert logged["/world/odometry"]["Boxes3D:half_sizes"].times() == pytest.approx([first.stamp_s])
    np.testing.assert_allclose(drawn.translation, first.world_from_ego.translation, atol=1e-3)
    (error_m,) = logged["/scores/odometry/position_error"]["Scalars:scalars"].at(last.stamp_s)
    mount = find_rig(RIG).lidar.ego_from_lidar
    ends = [(truth.world_from_ego @ mount).translation for truth in (first, last)]
    assert error_m == pytest.approx(np.linalg.norm(ends[1] - ends[0]))
    (path,) = logged["/world/paths/ego"]["LineStrips3D:strips"].static
    np.testing.assert_allclose(path[-1], last.world_from_ego.translation, atol=1e-3)


def test_the_poses_that_a_tracker_gets_are_shown() -> None:
    episode = Episode("lu2018-occlusion", SEED, "lux", 0.3)
    view = view_of_scenario(episode, detector="oracle", tracker="nearest?ego=still")
    assert view.poses is not None
    poses = np.asarray(view.poses.trajectories.estimate)
    np.testing.assert_array_equal(poses, np.broadcast_to(poses[0], poses.shape))
    assert "odometry" not in view.scores


def test_without_an_episode_the_true_path_is_of_the_lidar(view, tmp_path: Path) -> None:
    poses_alone = EpisodeView("poses", poses=view.poses)
    logged = read_recording(save_recording(poses_alone, tmp_path / "poses.rrd"))
    (path,) = logged["/world/paths/lidar"]["LineStrips3D:strips"].static
    truth = np.asarray(view.poses.trajectories.truth)[:, :3, 3]
    np.testing.assert_allclose(path, truth, atol=1e-3)
    assert "/world/paths/ego" not in logged


def test_returns_by_intensity(view, tmp_path: Path) -> None:
    path = save_recording(view, tmp_path / "grey.rrd", returns="intensity")
    returns = read_recording(path)[f"/world/ego/{find_rig(RIG).lidar.name}/returns"]
    assert "Points3D:class_ids" not in returns
    assert len(set(returns["Points3D:colors"].at(view.truths[0].stamp_s))) > 10


def test_the_road_lies_on_uneven_ground(tmp_path: Path) -> None:
    episode = Episode("hills", SEED, "lux", 0.3)
    view = view_of_scenario(episode, detector="oracle", tracker="nearest")
    logged = read_recording(save_recording(view, tmp_path / "hills.rrd"))
    lines = [np.array(line) for line in logged["/world/road/borders"]["LineStrips3D:strips"].static]
    heights = np.concatenate(lines)[:, 2]
    ego = view.truths[0].world_from_ego.translation
    points = np.concatenate(lines)
    nearest = points[np.argmin(np.linalg.norm(points[:, :2] - ego[:2], axis=1))]
    assert np.ptp(heights) > 0.5
    assert abs(nearest[2] - ego[2]) < 0.3
