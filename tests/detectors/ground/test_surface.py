"""The height of the ground: found on slopes, and left alone where the ground is flat."""

import numpy as np
import pytest
from toy_slope import CAR, cloud_of, frame_of, hdl64_scan

from roadscope import DETECTORS
from roadscope.core import Frame
from roadscope.detectors.ground import GroundSurface

DEFAULT = "distance-l-shape"
PLACES = np.array([(8.0, 3.0), (15.0, -4.0), (25.0, 1.0), (-20.0, 2.0)])


def ramp(degrees, start_m=8.0, length_m=20.0):
    """Return a road that rises ahead and behind, up to so many degrees, with 2 % of camber."""
    slope = np.tan(np.radians(degrees))

    def height(x, y):
        beyond = np.maximum(np.abs(x) - start_m, 0.0)
        bent = np.minimum(beyond, length_m)
        rise = slope * (bent**2 / (2 * length_m) + np.maximum(beyond - length_m, 0.0))
        return rise - 0.02 * np.minimum(np.abs(y), 4.0)

    return height


def plane(along_deg, across_deg=0.0):
    a, b = np.tan(np.radians([along_deg, across_deg]))
    return lambda x, y: a * x + b * y


@pytest.mark.parametrize("degrees", [-8, -3, 3, 8])
def test_a_tilted_plane_is_found_and_gives_no_boxes(degrees):
    """The sensor stands level over a plane: the worst case of a mounting that is not known."""
    ground = plane(degrees, degrees / 2)
    frame = frame_of(hdl64_scan(ground, []))
    surface = GroundSurface.of(cloud_of(frame))
    assert np.abs(surface.below(PLACES) - ground(*PLACES.T)).max() < 0.15
    assert not len(DETECTORS.make(DEFAULT).detect(frame))


def bumpy(height, seed):
    """Return a road with waves of 4 cm and pavements behind kerbs of 12 cm."""
    rng = np.random.default_rng(seed)
    waves, phases = rng.uniform(-1.2, 1.2, (8, 2)), rng.uniform(0, 2 * np.pi, 8)

    def uneven(x, y):
        bumps = sum(np.sin(a * x + b * y + c) for (a, b), c in zip(waves, phases, strict=True))
        return height(x, y) + 0.04 * bumps / np.sqrt(8) + np.where(np.abs(y) > 5.0, 0.12, 0.0)

    return uneven


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_rings_of_a_bumpy_rising_road_are_no_vehicles(seed):
    road = bumpy(ramp(3), seed)
    cars = [(16.0, -2.0, *CAR), (26.0, 2.2, *CAR), (-12.0, 0.0, *CAR)]
    alone, among = (frame_of(hdl64_scan(road, boxes, seed=seed)) for boxes in ([], cars))
    assert not len(DETECTORS.make(DEFAULT).detect(alone))
    boxes = DETECTORS.make(DEFAULT).detect(among)
    away = np.linalg.norm(boxes.centres[:, None, :2] - np.array(cars)[:, :2], axis=-1)
    assert len(boxes) == 3
    assert away.min(axis=0).max() < 1.0
    # The plane on which the wheels stand is not enough there.
    assert len(DETECTORS.make(f"{DEFAULT}?level=False").detect(among)) > 5


@pytest.mark.parametrize("degrees", [0, 3, 6])
@pytest.mark.parametrize("x", [14.0, 22.0, 30.0])
@pytest.mark.parametrize("offset_m", [-0.1, 0.1])
def test_the_car_ahead_is_found_on_the_ground(degrees, x, offset_m):
    ground = ramp(degrees)
    boxes = DETECTORS.make(DEFAULT).detect(
        frame_of(hdl64_scan(ground, [(x, 0.3, *CAR)]), offset_m=offset_m)
    )
    away = np.hypot(*(boxes.centres[:, :2] - (x, 0.3)).T)
    assert (away < 1.0).sum() == 1
    assert len(boxes) == 1
    z = float(ground(np.array(x), np.array(0.3))) + offset_m
    assert boxes.centres[0, 2] - boxes.sizes[0, 2] / 2 == pytest.approx(z, abs=0.25)


def test_flat_ground_is_left_alone():
    surface = GroundSurface.of(cloud_of(frame_of(hdl64_scan(plane(0.0), [(15.0, 0.0, *CAR)]))))
    assert surface.heights is None
    assert not surface.below(PLACES).any()


def test_a_wrong_height_of_the_sensor_is_found():
    for offset_m in (-0.5, 0.5):
        frame = frame_of(hdl64_scan(plane(0.0), [(15.0, 0.0, *CAR)]), offset_m=offset_m)
        assert GroundSurface.of(cloud_of(frame)).below(PLACES) == pytest.approx(offset_m, abs=0.1)


def test_a_few_returns_give_no_surface():
    frame = frame_of(hdl64_scan(plane(5.0), []))
    returns = cloud_of(frame)
    assert GroundSurface.of(returns.select(returns.ring < 7)).heights is None
    few = returns.select(np.arange(10))
    assert GroundSurface.of(few).heights is None
    assert GroundSurface.of(few.select(np.arange(0))).heights is None
    assert not len(DETECTORS.make(DEFAULT).detect(Frame(1.0, frame.calibration)))
