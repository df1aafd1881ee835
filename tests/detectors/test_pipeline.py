import numpy as np
import pytest
from toy_lidar import frame

from roadscope.core import Calibration, Frame, Pose
from roadscope.detectors import DETECTORS
from roadscope.detectors.clustering import CLUSTERINGS
from roadscope.detectors.ground import GROUNDS
from roadscope.detectors.pipeline import ClusterDetector
from roadscope.detectors.shape import SHAPES

CARS = [
    (25, 0, 4.6, 1.85, 1.5, 0), (35, 4, 4.6, 1.85, 1.5, 0), (22, -6, 4.6, 1.85, 1.5, 1.57)
]  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("clustering", CLUSTERINGS)
@pytest.mark.parametrize("ground", GROUNDS)
def test_every_combination_has_a_name_and_finds_the_car_ahead(ground, clustering, shape):
    place = "roadscope.detectors.pipeline:ClusterDetector"
    spec = f"{place}?ground={ground}&clustering={clustering}&shape={shape}"
    # One cluster for all shows one vehicle at most.
    cars = CARS[:1] if clustering == "one" else CARS[:1] + CARS[2:]
    found = DETECTORS.make(spec).detect(frame(cars, noise_m=0.02, ground=False))
    assert np.hypot(*(found.centres[:, :2] - [25, 0]).T).min() < 0.3


def test_boxes_of_three_cars():
    found = DETECTORS.make("distance").detect(frame(CARS, noise_m=0.02))
    assert len(found) == 3
    for x, y, length, width, _, yaw in CARS:
        row = np.hypot(*(found.centres[:, :2] - [x, y]).T).argmin()
        assert np.hypot(*(found.centres[row, :2] - [x, y])) < 0.25
        assert found.sizes[row, :2] == pytest.approx((length, width), abs=0.2)
        assert np.sin(found.yaws[row] - yaw) == pytest.approx(0, abs=0.06)
    assert np.allclose(found.centres[:, 2], found.sizes[:, 2] / 2)


def test_residual_refuses_what_is_not_straight():
    cars = frame(CARS, noise_m=0.02)
    everything = ClusterDetector(clustering="distance").detect(cars)
    assert len(ClusterDetector(clustering="distance", residual_m=0.08).detect(cars)) == 3
    assert len(ClusterDetector(clustering="distance", residual_m=1e-6).detect(cars)) == 0
    assert len(everything) == 3


def test_distance_counts():
    cars = frame([(25, 0, 4.6, 1.85, 1.5, 0), (25, 2.6, 4.6, 1.85, 1.5, 0)])
    assert len(ClusterDetector(clustering="distance", distance_m=0.5).detect(cars)) == 2


def test_split_counts():
    """A corner that is not split is no straight line."""
    cars = frame([(16, 4, 4.6, 1.85, 1.5, 0)])
    assert len(ClusterDetector(clustering="distance", residual_m=0.08).detect(cars)) == 1
    unsplit = ClusterDetector(clustering="distance", residual_m=0.08, split_m=9.0)
    assert len(unsplit.detect(cars)) == 0


def test_lone_car_in_an_empty_place():
    """No ground, nothing beside: the field of view is known all the same."""
    for name in ("distance", "breakpoint"):
        found = DETECTORS.make(name).detect(frame(CARS[:1], ground=False))
        assert found.centres[0, :2] == pytest.approx((25, 0), abs=0.1)


def test_boxes_come_in_the_ego_frame_of_a_turned_sensor():
    seen = frame(CARS[:1], ground=False)
    turned = Pose.planar(5.0, 0.0, np.pi / 2, 0.55)
    other = Frame(1.0, Calibration((("lux", turned),)), seen.lidar)
    (x, y) = DETECTORS.make("distance").detect(other).centres[0, :2]
    assert (x, y) == pytest.approx((5.0, 20.0), abs=0.2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"clustering": "dbscan3"}, "no clustering stage 'dbscan3'; known: pag, pag-range"),
        ({"ground": "plane"}, "no ground stage 'plane'; known: grid, keep"),
        ({"shape": "oval"}, "no shape stage 'oval'; known: iepf"),
        ({"split_m": -1.0}, "split_m must be a positive length in metres, got -1.0"),
        ({"distance_m": float("nan"), "clustering": "distance"}, "distance_m must be a positive"),
        ({"residual_m": 0.0}, "residual_m must be a positive length"),
        ({"view_deg": 400}, "view_deg must be above 0 and at most 360 degrees, got 400"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        ClusterDetector(**arguments)


def test_unknown_sensor_is_named():
    seen = frame(CARS)
    with pytest.raises(KeyError, match="no sensor 'lux' in the calibration; known: roof"):
        ClusterDetector().detect(Frame(1.0, Calibration((("roof", Pose.identity()),)), seen.lidar))
