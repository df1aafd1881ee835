from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.core import Pose, wrap_angle
from roadscope.detectors.pose import (
    GLASS,
    HIT,
    VALUES,
    BodyFit,
    BodyModel,
    BodySection,
    body_scan,
    saloon,
    with_glass,
)
from roadscope.envs.raycast import Scene
from roadscope.envs.sensors import SPECS, sweep
from roadscope.envs.world import Prisms, rectangle

SPEC = SPECS["hdl32e"]
LENGTH_M, WIDTH_M, HEIGHT_M = 4.6, 1.8, 1.0
BRICK = BodyModel((LENGTH_M, 0.02), (WIDTH_M, 0.02), sections=(BodySection(0.15, 1.15),))
FIT = BodyFit(SPEC, BRICK)
HERE = Pose.planar(0.0, 0.0, 0.0, 0.8)


def sensed(x, y, yaw, *, seed=0, world_from_lidar=HERE):
    """A sweep over a brick, and which returns are the brick's."""
    brick = Prisms.of(rectangle(LENGTH_M, WIDTH_M), 0.15, 1.15, reflectivity=0.5)
    poses = np.array([[[x, y, yaw]]])
    scene = Scene(Prisms.empty(), brick, np.zeros(1), poses, np.ones(1, bool))
    scan, truth = sweep(scene, SPEC, [world_from_lidar], 0.0, rng=np.random.default_rng(seed))
    return scan, truth.owners == 0


def axis_error(yaw, reference):
    return abs((yaw - reference + np.pi / 2) % np.pi - np.pi / 2)


@pytest.mark.parametrize("seed", range(6))
def test_finds_the_body_whichever_side_it_shows(seed):
    rng = np.random.default_rng(seed)
    azimuth, distance, yaw = rng.uniform(-3, 3), rng.uniform(8, 30), rng.uniform(-3, 3)
    x, y = distance * np.cos(azimuth), distance * np.sin(azimuth)
    pose = FIT.fit(*sensed(x, y, yaw, seed=seed), HERE, rolling=False)
    assert np.hypot(pose.x - x, pose.y - y) < 0.1
    assert axis_error(pose.yaw, yaw) < np.radians(2.0)
    spread = np.sqrt(np.diag(pose.covariance))
    assert (spread > 0).all()
    assert abs(pose.x - x) < 5 * spread[0] + 0.005


def test_heading_known_up_to_a_quarter_turn_is_kept():
    scan, target = sensed(20.0, 3.0, 0.4)
    ahead, back = (FIT.fit(scan, target, HERE, rolling=False, towards=t).yaw for t in (0.0, np.pi))
    assert ahead == pytest.approx(0.4, abs=0.05)
    assert abs(wrap_angle(back - ahead)) == pytest.approx(np.pi, abs=0.05)


@pytest.mark.slow
@settings(max_examples=5, deadline=None)
@given(st.integers(0, 1000))
def test_order_and_duplicates_change_nothing(seed):
    scan, target = sensed(15.0, 4.0, 0.7)
    rng = np.random.default_rng(seed)
    index = rng.permutation(np.concatenate([np.arange(len(scan)), rng.choice(len(scan), 9)]))
    one = FIT.fit(scan, target, HERE)
    assert FIT.fit(scan.select(index), target[index], HERE) == one
    assert FIT.fit(scan, target, HERE) == one


def test_without_a_return_there_is_no_pose():
    scan, target = sensed(15.0, 4.0, 0.7)
    assert FIT.fit(scan, np.zeros_like(target), HERE) is None
    assert FIT.fit(scan.select(np.arange(0)), target[:0], HERE) is None


def test_refuses_what_is_no_scan():
    scan, target = sensed(20.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="target must be one bool for each of the"):
        FIT.fit(scan, target[:-1], HERE)


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ({"velocity": [np.nan, 0.0]}, "^velocity must be finite x and y"),
        ({"velocity": np.zeros(3)}, "^velocity must be finite x and y"),
        ({"sensor_velocity": [0.0, np.inf]}, "^sensor_velocity must be finite x and y"),
        ({"towards": np.nan}, "towards must be a finite heading"),
    ],
)
def test_refuses_motions_by_name(motion, message):
    with pytest.raises(ValueError, match=message):
        FIT.fit(*sensed(20.0, 0.0, 0.0), HERE, **motion)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length_m": (0.0, 0.1)}, "length_m"),
        ({"length_m": 4.6}, "length_m: expected \\(mean"),
        ({"width_m": (1.8, 0.1, 0.1)}, "width_m: expected \\(mean"),
        ({"width_m": (1.8, 1.0)}, "width_m"),
        ({"radius_m": (0.3, 0.1)}, "radius_m"),
        ({"sections": ()}, "sections"),
        ({"drawn_m": -0.1}, "drawn_m"),
        ({"glass_m": (1.4, 1.0)}, "glass_m"),
    ],
)
def test_refuses_bodies_by_name(change, message):
    with pytest.raises(ValueError, match=message):
        replace(BRICK, **change)


def test_a_saloon_keeps_to_its_sizes():
    parts = saloon((4.8, 0.1), (1.85, 0.05)).parts(np.zeros(VALUES))
    assert max(part.front for part in parts) - min(part.rear for part in parts) == pytest.approx(
        4.8
    )
    assert 2 * max(part.half for part in parts) == pytest.approx(1.85)


def test_a_body_drawn_by_eye_is_never_placed_better_than_drawn():
    scan, target = sensed(12.0, 3.0, 0.7)
    exact, rough = (
        BodyFit(SPEC, replace(BRICK, drawn_m=d)).fit(scan, target, HERE, towards=0.7)
        for d in (0.0, 0.03)
    )
    assert rough.covariance - exact.covariance == pytest.approx(np.diag([9e-4, 9e-4, 0.0]))


def test_only_rays_at_the_windows_height_need_what_glass_needs():
    scan, target = sensed(20.0, 0.0, 0.0)
    rays = body_scan(SPEC, scan, target, HERE).rays
    half = with_glass(replace(BRICK, glass_m=(0.8, 2.0)), rays)
    more = half.need > rays.need
    assert half.need[more] == pytest.approx(GLASS * rays.need[more])
    hits = rays.kind == HIT
    heights = rays.origin[hits, 2] + rays.slope[hits] * rays.reach[hits]
    assert np.array_equal(more[hits], heights > 0.8)
    # Beside the body, too, beam by beam.
    slopes = np.unique(rays.slope[more].round(6))
    assert np.array_equal(more, np.isin(rays.slope.round(6), slopes))
    assert with_glass(BRICK, rays) is rays


def test_a_window_that_sends_nothing_back_is_no_empty_space():
    """Of the dark upper half the rear alone is seen, from 30 m: paint would show the flank, too."""
    halves = [
        Prisms.of(rectangle(LENGTH_M, WIDTH_M), low, high, reflectivity=bright)
        for low, high, bright in ((0.15, 0.9, 0.5), (0.9, 2.5, 0.05))
    ]
    scene = Scene(
        Prisms.empty(),
        Prisms.join(halves),
        np.zeros(1),
        np.array([[[30.0, 0.0, 0.5]]]),
        np.ones(1, bool),
    )
    scan, truth = sweep(scene, SPEC, [HERE], 0.0, rng=np.random.default_rng(0))
    tall = replace(BRICK, sections=(BodySection(0.15, 2.5),))
    paint, glass = (
        BodyFit(SPEC, replace(tall, glass_m=where)).fit(
            scan, truth.owners == 0, HERE, rolling=False, towards=0.5
        )
        for where in (None, (0.9, 2.5))
    )
    assert glass.score > paint.score + 10.0
    off = np.array([glass.x - 30.0, glass.y, wrap_angle(glass.yaw - 0.5)])
    assert off @ np.linalg.solve(glass.covariance, off) < 14.0
