"""What every registered detector promises."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_lidar import CALIBRATION, frame, scan

from roadscope.core import Frame, LidarScan, RecordError
from roadscope.detectors import DETECTORS
from roadscope.detectors.api import Detector

SCENE = [
    (22, 0, 4.6, 1.85, 1.5, 0), (34, 4, 4.6, 1.85, 1.5, 0), (20, -7, 4.6, 1.85, 1.5, 1.57),
    (30, 12, 0.4, 0.4, 2, 0), (25, -14, 30, 0.3, 1, 0),
]  # fmt: skip
EMPTY = Frame(2.5, CALIBRATION, scan([], ground=False))


@pytest.fixture(params=DETECTORS.names())
def detector(request):
    return DETECTORS.make(request.param)


def shuffled(seen: LidarScan, seed: int) -> LidarScan:
    order = np.random.default_rng(seed).permutation(len(seen))
    arrays = {n: getattr(seen, n)[order] for n in ("points", "intensity", "ring", "column")}
    return LidarScan(
        **arrays, time_offset_s=seen.time_offset_s[order], stamp_s=seen.stamp_s, sensor=seen.sensor
    )


def film(scene=(), *, shuffled_by=None, count=6, **options) -> list[Frame]:
    """Return frames 0.1 s apart of a car that comes nearer by 1 m a frame, to (22, 0).

    A detector of what moves needs to have seen what stands.
    """
    frames = []
    for k in range(count):
        boxes = [(22 + count - 1 - k, 0, 4.6, 1.85, 1.5, 0), *scene]
        seen = replace(scan(boxes, seed=k, **options), stamp_s=1.0 + 0.1 * k)
        seen = seen if shuffled_by is None else shuffled(seen, shuffled_by)
        frames.append(Frame(seen.stamp_s, CALIBRATION, seen))
    return frames


@pytest.mark.parametrize("name", DETECTORS.names())
def test_constructor_is_keyword_only_with_defaults(name):
    for parameter in inspect.signature(DETECTORS.resolve(name).factory).parameters.values():
        assert parameter.kind is parameter.KEYWORD_ONLY
        assert parameter.default is not parameter.empty


def test_meets_the_protocol(detector):
    assert isinstance(detector, Detector)


def test_finds_one_vehicle_among_ground(detector):
    frames = film([SCENE[3]], noise_m=0.03)
    found = [detector.detect(f) for f in frames][-1]
    x = 22 + (frames[-1].stamp_s - found.stamp_s) / 0.1
    assert np.hypot(*(found.centres[:, :2] - [x, 0]).T).min() < 1.0


def test_frame_and_stamp(detector):
    found = detector.detect(frame(SCENE))
    assert (found.frame, found.stamp_s) == ("ego", 1.0)


@pytest.mark.parametrize("seen", [EMPTY, Frame(2.5, CALIBRATION)], ids=["no return", "no scan"])
def test_nothing_seen_is_nothing_found(detector, seen):
    found = detector.detect(seen)
    assert len(found) == 0
    assert found.stamp_s == seen.lidar.stamp_s if seen.lidar else 2.5


def test_order_of_points_is_irrelevant(detector):
    first = [detector.detect(f) for f in film(SCENE[1:], noise_m=0.03)]
    assert len(first[-1]) > 0
    for seed in range(3):
        detector.reset()
        frames = film(SCENE[1:], noise_m=0.03, shuffled_by=seed)
        assert [detector.detect(f) for f in frames] == first


def test_same_input_same_output_after_reset_and_anew(detector):
    frames = film(SCENE[1:], noise_m=0.03)
    first = [detector.detect(f) for f in frames]
    detector.reset()
    assert [detector.detect(f) for f in frames] == first


def test_input_is_left_alone(detector):
    seen = frame(SCENE, noise_m=0.03)
    detector.detect(seen)
    assert seen == frame(SCENE, noise_m=0.03)


def test_a_full_turn_of_a_scanner_on_the_roof(detector):
    azimuths = np.radians(np.arange(180, -180, -0.4))
    around = [*SCENE, (-12, 0.3, 4.6, 1.85, 1.5, 0)]
    detector.detect(frame(around, azimuths=azimuths, elevations=np.linspace(-15, 5, 16)))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_no_places_never_reach_a_detector(bad):
    points = np.zeros((2, 3))
    points[1, 2] = bad
    with pytest.raises(RecordError, match=r"LidarScan\.points: must be finite"):
        LidarScan(points, np.zeros(2), [0, 1], [0, 1], np.zeros(2), 1.0, "lux")


def test_wrong_shape_never_reaches_a_detector():
    with pytest.raises(RecordError, match=r"LidarScan\.points: expected shape \(N, 3\)"):
        LidarScan(np.zeros((2, 2)), np.zeros(2), [0, 1], [0, 1], np.zeros(2), 1.0, "lux")


@pytest.mark.parametrize("name", DETECTORS.names())
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 60), grid=st.booleans())
def test_any_cloud_gives_proper_boxes(name, seed, count, grid):
    """Duplicates, collinear points, arbitrary rings and columns: a record comes out."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-30, 30, (count, 3)) * [1, 1, 0.03]
    points = np.round(points) if grid else points
    seen = LidarScan(
        points, np.ones(count), rng.integers(0, 4, count), rng.integers(0, 9, count),
        np.zeros(count), 1.0, "lux",
    )  # fmt: skip
    found = DETECTORS.make(name).detect(Frame(1.0, CALIBRATION, seen))
    assert (np.abs(found.centres[:, :2]) < 60).all()
    assert DETECTORS.make(name).detect(Frame(1.0, CALIBRATION, shuffled(seen, 0))) == found
