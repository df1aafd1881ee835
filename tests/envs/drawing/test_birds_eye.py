from dataclasses import replace

import numpy as np
import pytest
from toy_boxes import detections, tracks, truth
from toy_lidar import scan_of

from roadscope.core import (
    ASPHALT_COLOUR,
    DETECTION_COLOURS,
    HIDDEN_COLOUR,
    ODOMETRY_COLOUR,
    RETURN_COLOURS,
    TRACK_COLOURS,
    TRUTH_COLOUR,
    WEATHER,
    Calibration,
    Category,
    Frame,
    Pose,
    Tracks,
    TrackState,
    Truth,
    track_colour,
)
from roadscope.envs import find_rig
from roadscope.envs.drawing import (
    BirdsEyeView,
    Snapshot,
    box_corners,
    composed_frame,
    view_from_above,
)
from roadscope.envs.traffic import Terrain
from tests.envs.worlds import platoon

SIZE, SCALE = 400, 0.2
HOME = (int(0.64 * SIZE), SIZE // 2)
DETECTION = DETECTION_COLOURS["vehicle"]


def _truth(timeline, offsets=((15.0, 0.0),), returns=0) -> Truth:
    pose = timeline.world_from_ego(5.0)
    centres = pose.apply(np.array([(x, y, 0.75) for x, y in offsets]).reshape(-1, 3))
    return truth(centres, returns=1, world_from_ego=pose, stamp_s=5.0, sources=np.full(returns, -1))


def _frame(points=None) -> Frame:
    calibration = Calibration((("lidar", Pose.planar(2.5, 0.0, 0.0, z_m=1.9)),))
    if points is None:
        return Frame(5.0, calibration)
    return Frame(
        5.0, calibration, lidar=scan_of(points, stamp_s=5.0, sensor="lidar", intensity=0.0)
    )


def _snapshot(frame=None, truth=None, **shown) -> Snapshot:
    timeline = platoon()
    truth = _truth(timeline) if truth is None else truth
    return Snapshot(frame or _frame(), truth, timeline, find_rig("vlp16"), **shown)


def _draw(frame=None, truth=None, **shown) -> np.ndarray:
    return view_from_above(_snapshot(frame, truth, **shown), size_px=SIZE, metres_per_px=SCALE)


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
    rows, columns = _close(_draw(truth=_truth(platoon(), ())), TRUTH_COLOUR).T
    assert rows.max() == pytest.approx(HOME[0], abs=2)
    assert rows.min() == pytest.approx(HOME[0] - 4.5 / SCALE, abs=2)
    assert columns.mean() == pytest.approx(HOME[1], abs=2)


@pytest.mark.parametrize(("offset", "place"), [((15.0, 0.0), (-75, 0)), ((10.0, 6.0), (-50, -30))])
def test_boxes_lie_where_they_are(offset, place):
    alone = _draw(truth=_truth(platoon(), ()))
    image = _draw(truth=_truth(platoon(), (offset,)))
    rows, columns = np.nonzero((image != alone).any(axis=2))
    assert (rows.min() + rows.max()) / 2 == pytest.approx(HOME[0] + place[0], abs=2)
    assert (columns.min() + columns.max()) / 2 == pytest.approx(HOME[1] + place[1], abs=2)
    assert np.ptp(rows) == pytest.approx(4.5 / SCALE, abs=4)


def test_asphalt_lies_under_the_lanes_and_nowhere_else():
    image = _draw()
    assert np.array_equal(image[12, HOME[1] + 5], ASPHALT_COLOUR)
    assert (image[12, 20] < np.array(ASPHALT_COLOUR)).all()


def test_returns_are_drawn_at_their_place():
    points = np.array([[7.5, 10.0, 1.0], [7.5, -10.0, -1.9]])
    image = _draw(_frame(points), _truth(platoon(), (), returns=2)).astype(int)
    empty = _draw(_frame(), _truth(platoon(), ())).astype(int)
    changed = np.argwhere(np.abs(image - empty).sum(axis=2) > 0)
    assert 2 <= len(changed) <= 18
    assert np.allclose(changed[:, 0], HOME[0] - 10.0 / SCALE, atol=1.5)
    assert set(np.abs(changed[:, 1] - HOME[1]).tolist()) <= {49, 50, 51}


def test_returns_are_coloured_by_what_they_came_from():
    """Several in one place cover whole pixels."""
    points = np.array(
        [[17.5 + 0.02 * k, 10.0 + 0.02 * j, 1.0] for k in range(60) for j in range(60)]
    )
    truth = _truth(platoon(), ((-15.0, 0.0),), returns=len(points))
    for source, kind in ((0, "road user"), (-1, "ground"), (WEATHER, "rain, fog"), (-2, "scenery")):
        image = _draw(_frame(points), replace(truth, sources=np.full(len(points), source)))
        assert len(_close(image, RETURN_COLOURS[kind], 2)) > 10
        others = [colour for name, colour in RETURN_COLOURS.items() if name != kind]
        assert all(len(_close(image, colour, 2)) == 0 for colour in others)


def test_returns_can_be_coloured_by_intensity():
    points = np.array([[17.5, 10.0, 1.0], [22.5, 10.0, 1.0]])
    frame = _frame(points)
    frame = replace(frame, lidar=replace(frame.lidar, intensity=np.array([0.1, 0.9])))
    truth = _truth(platoon(), (), returns=2)
    shown = _snapshot(frame, truth)
    image = view_from_above(shown, colour_by="intensity", size_px=SIZE, metres_per_px=SCALE).astype(
        int
    )
    dim, bright = (
        image[HOME[0] - row - 2 : HOME[0] - row + 3, HOME[1] - 52 : HOME[1] - 47].sum(axis=2).max()
        for row in (100, 125)
    )
    assert bright > 2 * dim


def test_own_motion_is_taken_out_of_returns():
    """A post 20 m ahead at the stamp is 0.5 m nearer 50 ms later, at 10 m/s."""
    truth = _truth(platoon(), (), returns=2)
    still = _frame(np.array([[17.53, 10.03, 1.0], [17.53, 10.03, 1.0]]))
    later = _frame(np.array([[17.53, 10.03, 1.0], [17.03, 10.03, 1.0]]))
    scan = replace(later.lidar, time_offset_s=np.array([0.0, 0.05]))
    image = _draw(replace(later, lidar=scan), truth)
    assert np.array_equal(image, _draw(still, truth))
    assert not np.array_equal(image, _draw(truth=truth))


def test_the_motion_of_objects_is_taken_out_of_their_returns():
    """A return of a vehicle as fast as the ego comes from the same place, 50 ms later."""
    truth = _truth(platoon(), ((20.0, 10.0),), returns=2)
    truth = replace(truth, sources=np.zeros(2, int), velocities=np.array([[10.0, 0.0]]))
    still = _frame(np.array([[17.53, 10.03, 1.0], [17.53, 10.03, 1.0]]))
    scan = replace(still.lidar, time_offset_s=np.array([0.0, 0.05]))
    image = _draw(replace(still, lidar=scan), truth)
    assert np.array_equal(image, _draw(still, truth))
    assert not np.array_equal(image, _draw(truth=truth))


def test_returns_of_a_tilted_vehicle_are_drawn_above_their_place():
    """On a road that rises and leans by 6 degrees in all, at two times."""
    area = np.array([0.0, -100.0, 300.0, 100.0])
    ramp = np.array([[2, 100.0, 0.0, 0.8, 0.1, -500.0, 500.0]])
    timeline = replace(platoon(), terrain=Terrain(ramp, area))
    mount, place = _frame().calibration.pose("lidar"), np.array([118.03, 7.03, 20.0])
    truth = _truth(timeline, (), returns=2)
    world_from_lidar = (timeline.world_from_ego(stamp_s) @ mount for stamp_s in (5.0, 5.05))
    frame = _frame(np.array([pose.inverse().apply(place) for pose in world_from_lidar]))
    scan = replace(frame.lidar, time_offset_s=np.array([0.0, 0.05]))
    shown = replace(_snapshot(truth=truth), timeline=timeline)
    bare, image = (
        view_from_above(each, size_px=SIZE, metres_per_px=SCALE).astype(int)
        for each in (shown, replace(shown, frame=replace(frame, lidar=scan)))
    )
    changed = np.argwhere((image != bare).any(axis=2))
    assert 0 < len(changed) <= 9
    expected = HOME[0] - (place[0] - 100.0) / SCALE, HOME[1] - place[1] / SCALE
    assert np.allclose(changed.mean(axis=0) + 0.5, expected, atol=1.0)


def test_a_long_title_leaves_the_clock_alone():
    short, long = (composed_frame(_snapshot(title=text)) for text in ("", "street, rain-2 " * 9))
    changed = np.argwhere((short != long).any(axis=2))
    # The clock, "5.0 s", is at the right border.
    assert 1000 < changed[:, 1].max() < short.shape[1] - 60


def test_detections_are_drawn_at_their_place():
    pose = platoon().world_from_ego(5.0)
    ego = detections([[12.0, -5.0, 0.8]], sizes=[4.0, 2.0, 1.5], frame="ego", stamp_s=5.0)
    image = _draw(detections=ego.moved(pose, "world"))
    rows, columns = np.nonzero((image != _draw()).any(axis=2))
    assert rows.mean() == pytest.approx(HOME[0] - 12 / SCALE, abs=2)
    assert columns.mean() == pytest.approx(HOME[1] + 5 / SCALE, abs=2)
    assert len(_close(image, DETECTION, 3)) > 10


def _tracks(numbers, offsets, state=TrackState.CONFIRMED) -> Tracks:
    centres = platoon().world_from_ego(5.0).apply(np.array([(x, y, 0.8) for x, y in offsets]))
    return tracks(centres, numbers, state=state, sizes=[4.0, 2.0, 1.5], stamp_s=5.0)


@pytest.mark.parametrize("number", range(len(TRACK_COLOURS)))
def test_the_colour_of_a_track_appears_where_the_track_is(number):
    offset = ((12.0, 8.0), (-10.0, -6.0), (25.0, 0.0))[number % 3]
    image = _draw(truth=_truth(platoon(), ()), tracks=_tracks([number], [offset]))
    rows, columns = _close(image, track_colour(number), 3).T
    middle = np.array([HOME[0] - offset[0] / SCALE, HOME[1] - offset[1] / SCALE])
    # The box is 20 by 10 pixels; its number stands beside it.
    near = np.hypot(rows - middle[0], columns - middle[1]) < 45
    assert near.all()
    assert (np.abs(rows - middle[0]) < 12).sum() > 50


def test_a_tail_shows_where_a_track_was():
    now, before = _tracks([3], [(12.0, 8.0)]), _tracks([3], [(2.0, 8.0)])
    other = _tracks([4], [(2.0, 8.0)])
    plain, tail = _draw(tracks=now), _draw(tracks=now, past=(before,))
    rows, _ = np.nonzero((plain != tail).any(axis=2))
    assert rows.max() == pytest.approx(HOME[0] - 2 / SCALE, abs=2)
    assert np.array_equal(_draw(tracks=now, past=(other,)), plain)


def test_a_coasting_track_has_a_thinner_outline():
    confirmed, coasting = (
        _draw(tracks=_tracks([17], [(12.0, 8.0)], state))
        for state in (TrackState.CONFIRMED, TrackState.COASTING)
    )
    count = [len(_close(image, track_colour(17), 3)) for image in (confirmed, coasting)]
    assert count[1] < 0.7 * count[0]


def test_road_users_without_returns_are_grey():
    truth = _truth(platoon(), ((15.0, 8.0),))
    alone = len(_close(_draw(truth=_truth(platoon(), ())), TRUTH_COLOUR, 3))
    hidden = _draw(truth=replace(truth, lidar_returns=np.zeros(1, int)))
    assert len(_close(hidden, HIDDEN_COLOUR, 3)) > 20
    assert len(_close(hidden, TRUTH_COLOUR, 3)) == alone
    assert len(_close(_draw(truth=truth), TRUTH_COLOUR, 3)) > alone + 20


def test_paths_of_the_ego_and_of_an_odometry_are_distinguished():
    pose = platoon().world_from_ego(5.0)
    back = np.array([[-30.0, 0.0, 0.0], [-2.0, 0.0, 0.0]])
    drifted = pose.apply(back + np.array([0, 4.0, 0]))[:, :2]
    image = _draw(truth=_truth(platoon(), ()), path=pose.apply(back)[:, :2], odometry=drifted)
    white, pink = _close(image, TRUTH_COLOUR, 3), _close(image, ODOMETRY_COLOUR, 3)
    assert white[:, 0].max() > HOME[0] + 25 / SCALE
    assert np.abs(pink[:, 1] - (HOME[1] - 4 / SCALE)).max() <= 6
    assert np.ptp(pink[:, 0]) > 20 / SCALE


def test_people_are_circles_and_vehicles_boxes():
    truth = _truth(platoon(), ((15.0, 8.0),))
    pedestrian = replace(
        truth, categories=np.array([Category.PEDESTRIAN], np.int8), sizes=np.full((1, 3), 3.0)
    )
    square = replace(truth, sizes=np.full((1, 3), 3.0))
    round_, corners = (
        (_draw(truth=each) != _draw(truth=_truth(platoon(), ()))).any(axis=2)
        for each in (pedestrian, square)
    )
    assert corners.sum() > round_.sum() > 0


def test_drawing_loads_no_plotting_library():
    import subprocess
    import sys

    heavy = "{'matplotlib', 'pygame'}"
    code = f"import sys, roadscope.envs.drawing.composed; assert not {heavy} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_view_turns_with_the_ego():
    view = BirdsEyeView(Pose.planar(10.0, 5.0, np.pi / 2), SIZE, SIZE, SCALE)
    assert np.allclose(view.pixels(np.array([10.0, 15.0])), (HOME[1], HOME[0] - 50))
    assert np.allclose(view.pixels(np.array([0.0, 5.0])), (HOME[1] - 50, HOME[0]))


def test_box_corners_go_round_from_the_rear_right():
    corners = box_corners(np.array([1.0, 2.0, 0.5]), np.array([4.0, 2.0, 1.5]), np.pi / 2)
    assert np.allclose(corners, [[2, 0], [2, 4], [0, 4], [0, 0]])
