import inspect

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_lidar import frame

from roadscope.core import Calibration, Category, Frame, LidarScan, Pose
from roadscope.detectors import DETECTORS, STAGES, ClusterDetector, exclusive_rows, options_of
from roadscope.detectors.shape import Vehicle

CARS = [(25, 0, 4.6, 1.85, 1.5, 0), (35, 4, 4.6, 1.85, 1.5, 0), (22, -6, 4.6, 1.85, 1.5, 1.57)]


def test_boxes_of_three_cars():
    detected = DETECTORS.make("distance").detect(frame(CARS, noise_m=0.02))
    assert len(detected) == 3
    for x, y, length, width, _, yaw in CARS:
        row = np.hypot(*(detected.centres[:, :2] - [x, y]).T).argmin()
        assert np.hypot(*(detected.centres[row, :2] - [x, y])) < 0.25
        assert detected.sizes[row, :2] == pytest.approx((length, width), abs=0.2)
        assert np.sin(detected.yaws[row] - yaw) == pytest.approx(0, abs=0.06)
    assert np.allclose(detected.centres[:, 2], detected.sizes[:, 2] / 2)


def test_residual_refuses_what_is_not_straight():
    cars = frame(CARS, noise_m=0.02)
    everything = ClusterDetector(clustering="distance").detect(cars)
    assert len(ClusterDetector(clustering="distance", residual_m=0.08).detect(cars)) == 3
    assert len(ClusterDetector(clustering="distance", residual_m=1e-6).detect(cars)) == 0
    assert len(everything) == 3


def test_split_counts():
    """A corner that is not split is no straight line."""
    cars = frame([(16, 4, 4.6, 1.85, 1.5, 0)])
    assert len(ClusterDetector(clustering="distance", residual_m=0.08).detect(cars)) == 1
    unsplit = ClusterDetector(clustering="distance", residual_m=0.08, split_m=9.0)
    assert len(unsplit.detect(cars)) == 0


def test_lone_car_in_an_empty_place():
    """No ground, nothing beside: the field of view is known all the same."""
    for name in ("distance", "breakpoint"):
        detected = DETECTORS.make(name).detect(frame(CARS[:1], ground=False))
        assert detected.centres[0, :2] == pytest.approx((25, 0), abs=0.1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"clustering": "dbscan3"}, "no clustering stage 'dbscan3' .*'dbscan'.*; known: pag, pag"),
        ({"ground": "plane"}, "no ground stage 'plane'.*; known: grid, keep"),
        ({"shape": "oval"}, "no shape stage 'oval'.*; known: iepf"),
        ({"split_m": -1.0}, "split_m must be a positive length in metres, got -1.0"),
        ({"distance_m": float("nan"), "clustering": "distance"}, "distance_m must be a positive"),
        ({"residual_m": 0.0}, "residual_m must be a positive length"),
        ({"faint": -0.1}, "faint must be at least 0 and below 1, got -0.1"),
        ({"min_score": 1.0}, "min_score must be at least 0 and below 1, got 1.0"),
        (
            {"eps_m": 1.0},
            "option 'eps_m' belongs to clustering 'dbscan'.*, not chosen; ground 'grid'",
        ),
        ({"eps": 1.0}, "no stage has an option 'eps'; ground 'grid' takes cell_m=0.5, span_m="),
        ({"clustering": "dbscan", "min_points": 2.5}, "min_points must be a positive whole number"),
        ({"shape": "l-shape", "criterion": "worst"}, "no criterion 'worst'; known: area, close"),
        ({"split_m": "wide"}, "split_m must be a positive length in metres, got 'wide'"),
        ({"view_deg": 400}, "view_deg must be above 0 and at most 360 degrees, got 400"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        ClusterDetector(**arguments)


def test_every_option_of_a_stage_can_be_named_and_unknown_ones_are_refused_with_them():
    options = {name for known in STAGES.values() for s in known.values() for name in options_of(s)}
    assert {"distance_m", "eps_m", "min_points", "split_m", "criterion", "cell_m"} <= options
    assert options.isdisjoint(inspect.signature(ClusterDetector).parameters)
    known = "'dbscan' takes eps_m=1.0, min_points=5; .*; the detector takes ground=grid, "
    with pytest.raises(ValueError, match=f"no stage has an option 'eps'; .*{known}"):
        DETECTORS.make("cluster?clustering=dbscan&eps=1")


OPTIONS = [
    (kind, stage, name, parameter.default)
    for kind, known in STAGES.items()
    for stage in known
    for name, parameter in options_of(known[stage]).items()
]


@pytest.mark.parametrize(("kind", "stage", "name", "default"), OPTIONS)
def test_every_option_can_be_given_its_default(kind, stage, name, default):
    assert DETECTORS.make(f"cluster?{kind}={stage}&{name}={default}")


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("cluster?min_score=abc", "min_score must be a number, got 'abc'"),
        ("cluster?residual_m=abc", "residual_m must be a number, got 'abc'"),
        ("cluster?faint=nan", "faint must be a number, got 'nan'"),
        ("cluster?exclusive=maybe", "exclusive must be True or False, got 'maybe'"),
        (
            "cluster?clustering=dbscan&min_points=2.5",
            "min_points must be a positive whole number, got 2.5",
        ),
        ("zhang2017?late=1", "late must be True or False, got 1"),
        ("long-range?range_max_m=far", "range_max_m must be a number, got 'far'"),
        ("long-range?range_max_m=0", "range_max_m must be a positive length in metres, got 0"),
        ("long-range?range_noise_m=-1", "range_noise_m must be None or from 0 up, got -1"),
        ("long-range?detection_limit=-1", "detection_limit must be from 0 up, got -1"),
    ],
)
def test_arguments_of_the_wrong_kind_are_named_before_anything_runs(spec, message):
    with pytest.raises(ValueError, match=message):
        DETECTORS.make(spec)


def test_options_reach_their_stage():
    cars = frame([(25, 0, 4.6, 1.85, 1.5, 0), (25, 2.6, 4.6, 1.85, 1.5, 0)])
    specs = {0.5: 2, 0.05: 0}
    for eps_m, count in specs.items():
        spec = f"cluster?clustering=dbscan&shape=l-shape&eps_m={eps_m}&min_points=2"
        assert len(DETECTORS.make(spec).detect(cars)) == count


def test_min_score_leaves_out_what_is_less_probable():
    clear_frame = frame([*CARS, (25, -14, 30, 0.3, 1, 0)], noise_m=0.02)
    plain = DETECTORS.make("cluster?clustering=distance&shape=l-shape").detect(clear_frame)
    cut = np.sort(plain.scores)[1]
    some = DETECTORS.make(f"cluster?clustering=distance&shape=l-shape&min_score={cut}").detect(
        clear_frame
    )
    assert len(some) == len(plain) - 1
    assert some.scores.min() == cut


@given(seed=st.integers(0, 10**6), count=st.integers(0, 12))
def test_of_bodies_in_one_place_the_most_probable_remains(seed, count):
    rng = np.random.default_rng(seed)
    boxes = [
        Vehicle(tuple(rng.uniform(-6, 6, 2)), (4.4, 1.8, 1.5), yaw, Category.CAR, 0.0, 9)
        for yaw in rng.uniform(-3, 3, count)
    ]
    probabilities = rng.random(count)
    kept_rows = exclusive_rows(boxes, probabilities)
    for row, box in enumerate(boxes):
        rivals = [k for k in kept_rows if k != row and overlap(box, boxes[k])]
        assert (row in kept_rows) == all(probabilities[k] < probabilities[row] for k in rivals)


def overlap(one, other):
    """Whether either covers the other's centre."""
    to = np.subtract(other.centre, one.centre)
    return any(
        abs(to @ [np.cos(b.yaw), np.sin(b.yaw)]) < b.size[0] / 2
        and abs(to @ [-np.sin(b.yaw), np.cos(b.yaw)]) < b.size[1] / 2
        for b in (one, other)
    )


def test_faint_returns_close_by_are_drops():
    """A shell of echoes hides the car from a detector that takes them for walls."""
    sweep = frame(CARS[:1], noise_m=0.02).lidar
    shell = sweep.points * (3.0 / np.linalg.norm(sweep.points, axis=1))[:, None]
    both = LidarScan(
        np.concatenate([sweep.points, shell]),
        np.concatenate([sweep.intensity, np.full(len(shell), 0.005)]),
        *(np.tile(getattr(sweep, name), 2) for name in ("ring", "column", "time_offset_s")),
        stamp_s=1.0,
        sensor="lux",
    )
    spec = "cluster?clustering=distance&shape=l-shape"
    clear = DETECTORS.make(spec).detect(frame(CARS[:1], noise_m=0.02))
    foggy = Frame(1.0, frame(CARS).calibration, both)
    assert DETECTORS.make(f"{spec}&faint=0.01").detect(foggy) == clear
    assert DETECTORS.make(spec).detect(foggy) != clear


def test_unknown_sensor_is_named():
    clear_frame = frame(CARS)
    with pytest.raises(KeyError, match="no sensor 'lux' in the calibration; known: roof"):
        ClusterDetector().detect(
            Frame(1.0, Calibration((("roof", Pose.identity()),)), clear_frame.lidar)
        )
