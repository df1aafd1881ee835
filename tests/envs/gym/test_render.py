from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import (
    WEATHER,
    Calibration,
    Detections,
    Frame,
    LidarScan,
    Pose,
    Tracks,
    TrackState,
    Truth,
)
from roadscope.envs.gym import (
    ASPHALT,
    DETECTION,
    EGO,
    FAMILIES,
    GROUND_RETURN,
    WEATHER_RETURN,
    BirdsEyeView,
    birds_eye,
    box_corners,
)
from roadscope.envs.world import Scenery
from tests.envs.worlds import platoon

SIZE, SCALE = 400, 0.2
HOME = (int(0.6 * SIZE), SIZE // 2)
VEHICLE = FAMILIES[next(iter(FAMILIES))]


def _truth(timeline, offsets=((15.0, 0.0),), returns=0) -> Truth:
    pose = timeline.world_from_ego(5.0)
    count = len(offsets)
    centres = pose.apply(np.array([(x, y, 0.75) for x, y in offsets]).reshape(-1, 3))
    return Truth(
        ids=np.arange(count),
        categories=np.zeros(count, np.int8),
        centres=centres,
        sizes=np.tile([4.5, 1.8, 1.5], (count, 1)),
        yaws=np.zeros(count),
        velocities=np.zeros((count, 2)),
        lidar_returns=np.zeros(count, int),
        visible_pixels=np.zeros(count, int),
        occluded_fraction=np.zeros(count),
        world_from_ego=pose,
        stamp_s=5.0,
        sources=np.full(returns, -1),
    )


def _frame(points=None) -> Frame:
    calibration = Calibration((("lidar", Pose.planar(2.5, 0.0, 0.0, z_m=1.9)),))
    if points is None:
        return Frame(5.0, calibration)
    n = len(points)
    none = np.zeros(n)
    scan = LidarScan(points, none, none.astype(int), none.astype(int), none, 5.0, "lidar")
    return Frame(5.0, calibration, lidar=scan)


def _draw(frame=None, truth=None, **options) -> np.ndarray:
    """The legend has the same colours as the objects, so most pictures have none."""
    timeline = platoon()
    return birds_eye(
        frame or _frame(),
        truth or _truth(timeline),
        timeline,
        **{"size_px": SIZE, "metres_per_px": SCALE, "legend": False, **options},
    )


def _close(image, colour, tolerance=40) -> np.ndarray:
    """Rows and columns of pixels of about the colour."""
    return np.argwhere((np.abs(image.astype(int) - colour) < tolerance).all(axis=2))


def test_the_picture_is_an_rgb_array_and_repeats():
    image = _draw()
    assert image.shape == (SIZE, SIZE, 3)
    assert image.dtype == np.uint8
    assert np.array_equal(image, _draw())
    assert image is not _draw()


def test_the_ego_drives_up_the_page_from_its_rear_axle():
    rows, columns = _close(_draw(truth=_truth(platoon(), ())), EGO).T
    assert rows.max() == pytest.approx(HOME[0], abs=2)
    assert rows.min() == pytest.approx(HOME[0] - 4.5 / SCALE, abs=2)
    assert columns.mean() == pytest.approx(HOME[1], abs=2)


@pytest.mark.parametrize(("offset", "place"), [((15.0, 0.0), (-75, 0)), ((10.0, 6.0), (-50, -30))])
def test_boxes_lie_where_they_are(offset, place):
    rows, columns = _close(_draw(truth=_truth(platoon(), (offset,))), VEHICLE).T
    assert (rows.min() + rows.max()) / 2 == pytest.approx(HOME[0] + place[0], abs=2)
    assert (columns.min() + columns.max()) / 2 == pytest.approx(HOME[1] + place[1], abs=2)
    assert np.ptp(rows) == pytest.approx(4.5 / SCALE, abs=4)


def test_asphalt_lies_under_the_lanes_and_nowhere_else():
    image = _draw()
    assert np.array_equal(image[10, HOME[1]], ASPHALT)
    assert (image[10, 20] < np.array(ASPHALT)).all()


def test_returns_are_drawn_at_their_place_and_in_the_colour_of_their_height():
    points = np.array([[7.5, 10.0, 1.0], [7.5, -10.0, -1.9]])
    image = _draw(_frame(points), _truth(platoon(), (), returns=2)).astype(int)
    empty = _draw(_frame(), _truth(platoon(), ())).astype(int)
    changed = np.argwhere(np.abs(image - empty).sum(axis=2) > 0)
    assert len(changed) == 8
    assert np.allclose(changed[:, 0], HOME[0] - 10.0 / SCALE, atol=1.5)
    assert set(np.abs(changed[:, 1] - HOME[1]).tolist()) <= {49, 50, 51}
    high, low = image[tuple(changed[0])], image[tuple(changed[-1])]
    assert high.sum() > 1.5 * low.sum()


def test_weather_has_its_own_colour_below_everything():
    frame = _frame(np.array([[17.5, 10.0, 1.0], [17.5, 10.0, 1.0], [22.5, 10.0, -1.9]]))
    truth = _truth(platoon(), ((-15.0, 0.0),), returns=3)
    for sources, seen in (((0, WEATHER, -1), False), ((WEATHER, WEATHER, -1), True)):
        image = _draw(frame, replace(truth, sources=np.array(sources)))
        assert bool(len(_close(image, WEATHER_RETURN, 3))) == seen
        assert len(_close(image, GROUND_RETURN, 3))


def test_own_motion_is_taken_out_of_returns():
    """A post 20 m ahead at the stamp is 0.5 m nearer 50 ms later, at 10 m/s."""
    frame = _frame(np.array([[17.5, 10.0, 1.0], [17.0, 10.0, 1.0]]))
    scan = replace(frame.lidar, time_offset_s=np.array([0.0, 0.05]))
    image = _draw(replace(frame, lidar=scan), _truth(platoon(), (), returns=2)).astype(int)
    changed = np.argwhere(np.abs(image - _draw(truth=_truth(platoon(), ()))).sum(axis=2) > 0)
    assert len(changed) <= 6


def test_the_motion_of_objects_is_taken_out_of_their_returns():
    truth = _truth(platoon(), ((20.0, 10.0),), returns=2)
    truth = replace(truth, sources=np.zeros(2, int), velocities=np.array([[10.0, 0.0]]))
    frame = _frame(np.array([[17.5, 10.0, 1.0], [17.5, 10.0, 1.0]]))
    scan = replace(frame.lidar, time_offset_s=np.array([0.0, 0.05]))
    image = _draw(replace(frame, lidar=scan), truth).astype(int)
    bare = _draw(truth=replace(truth, sources=np.empty(0, int)))
    assert len(np.argwhere(np.abs(image - bare).sum(axis=2) > 0)) <= 6


def test_detections_are_drawn_in_either_frame():
    pose = platoon().world_from_ego(5.0)
    ego = Detections(
        np.array([[12.0, -5.0, 0.8]]),
        np.array([[4.0, 2.0, 1.5]]),
        np.zeros(1),
        np.zeros(1, np.int8),
        np.ones(1),
        "ego",
        5.0,
    )
    image = _draw(detections=ego)
    rows, columns = _close(image, DETECTION).T
    assert rows.mean() == pytest.approx(HOME[0] - 12 / SCALE, abs=2)
    assert columns.mean() == pytest.approx(HOME[1] + 5 / SCALE, abs=2)
    assert np.array_equal(image, _draw(detections=ego.moved(pose, "world")))


def test_tracks_change_the_picture_with_their_ids():
    tracks = Tracks(
        np.array([17]),
        np.array([[12.0, 8.0, 0.8]]),
        np.array([[4.0, 2.0, 1.5]]),
        np.zeros(1),
        np.array([[8.0, 0.0]]),
        np.eye(4)[None],
        np.zeros(1, np.int8),
        np.ones(1),
        np.ones(1, np.int8),
        "ego",
        5.0,
    )
    plain, first = _draw(), _draw(tracks=tracks)
    assert (first != plain).any()
    assert (_draw(tracks=replace(tracks, ids=np.array([25]))) != first).any()
    coasting = replace(tracks, states=np.array([TrackState.COASTING], np.int8))
    assert _draw(tracks=coasting).astype(int).sum() < first.astype(int).sum()


def test_the_legend_lies_at_the_lower_left_and_names_what_was_drawn():
    none = Detections(
        np.empty((0, 3)),
        np.empty((0, 3)),
        np.empty(0),
        np.empty(0, np.int8),
        np.empty(0),
        "ego",
        5.0,
    )
    bare, truth, both = _draw(), _draw(legend=True), _draw(legend=True, detections=none)
    rows, columns = np.argwhere((truth != bare).any(axis=2)).T
    assert rows.min() > SIZE / 2
    assert columns.max() < SIZE / 2
    assert len(_close(truth, DETECTION, 1)) == 0
    assert len(_close(both, DETECTION, 1)) > 10
    assert all(len(_close(truth, colour, 1)) > 10 for colour in FAMILIES.values())


def test_a_small_picture_has_no_legend():
    small = {"size_px": 200, "metres_per_px": 0.4}
    assert np.array_equal(_draw(legend=True, **small), _draw(**small))


def test_scenery_can_be_drawn_below():
    timeline = platoon()
    scenery = Scenery(timeline.road, "campus", 0).around(np.array([100.0, 0.0]))
    assert (_draw(scenery=scenery) != _draw()).any()


def test_drawing_loads_no_plotting_library():
    import subprocess
    import sys

    heavy = "{'matplotlib', 'pygame'}"
    code = f"import sys, roadscope.envs.gym.render; assert not {heavy} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_view_turns_with_the_ego():
    view = BirdsEyeView(Pose.planar(10.0, 5.0, np.pi / 2), SIZE, SCALE)
    assert np.allclose(view.pixels(np.array([10.0, 15.0])), (HOME[1], HOME[0] - 50))
    assert np.allclose(view.pixels(np.array([0.0, 5.0])), (HOME[1] - 50, HOME[0]))


def test_box_corners_go_round_from_the_rear_right():
    corners = box_corners(np.array([1.0, 2.0, 0.5]), np.array([4.0, 2.0, 1.5]), np.pi / 2)
    assert np.allclose(corners, [[2, 0], [2, 4], [0, 4], [0, 0]])
