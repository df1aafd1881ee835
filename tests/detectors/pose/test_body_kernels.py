import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_misfits import misfits

from roadscope.detectors.pose.body_kernels import (
    AFT,
    BOTTOM,
    EMPTY,
    FACET_REACH,
    FORE,
    FRONT,
    HALF,
    HIT,
    NOSE,
    PASSED,
    RADIUS,
    REAR,
    TAIL,
    TOP,
    Chances,
    Rays,
    pose_after,
)
from roadscope.detectors.pose.body_lane_chances import log_likelihoods, ray_chances
from roadscope.detectors.pose.body_model import BodyModel, drawn, saloon

SHARP = Chances(1e-9, 1e-9, 0.0, 0.003, 10.0, 0.004, 0.001)
SIGMA_M, STEP_M = 0.05, 0.0005
CAR = saloon((4.8, 0.02), (1.85, 0.02))


def inside(part, points):
    """Whether (N, 3) points in the body's frame lie in one part, from its definition."""
    x, y, z = points[:, 0], np.abs(points[:, 1]), points[:, 2]
    stations = [part[REAR], part[AFT], part[FORE], part[FRONT]]
    width = np.interp(x, stations, [part[TAIL], part[HALF], part[HALF], part[NOSE]])
    within = (x >= part[REAR]) & (x <= part[FRONT]) & (y <= width)
    within &= (z >= part[BOTTOM]) & (z <= part[TOP])
    r = part[RADIUS]
    ends = (part[REAR] + r, -1, part[TAIL] - r), (part[FRONT] - r, 1, part[NOSE] - r)
    for centre, way, side in ends:
        u, v = way * (x - centre), y - side
        for angle in np.radians([15, 45, 75]):
            over = np.cos(angle) * u + np.sin(angle) * v > r * FACET_REACH
            within &= ~((u > 0) & (v > 0) & over)
    return within


def marched(state, parts, origin, direction, slope):
    """Where a ray first is inside the body, by trying every half millimetre; inf for never."""
    middle = np.hypot(*(state[:2] - origin[:2]))
    s = np.arange(middle - 3.5, middle + 3.5, STEP_M)
    x, y = origin[0] + s * direction[0] - state[0], origin[1] + s * direction[1] - state[1]
    cos, sin = np.cos(state[2]), np.sin(state[2])
    points = np.column_stack([cos * x + sin * y, cos * y - sin * x, origin[2] + slope * s])
    met = np.any([inside(part, points) for part in parts], axis=0)
    return s[met.argmax()] if met.any() else np.inf


def slow_log_chance(entry, kind, reach):
    if kind == HIT:
        density = SHARP.outlier / SHARP.outlier_m
        if np.isfinite(entry):
            z = (reach - entry) / SIGMA_M
            density += (1 - SHARP.outlier) * np.exp(-z * z / 2) / np.sqrt(2 * np.pi) / SIGMA_M
        return np.log(density)
    if entry >= reach:
        return 0.0
    return np.log(SHARP.lost if kind == EMPTY else SHARP.through)


def fan(seed, count=40):
    """A car somewhere ahead and rays around it, returns near its surface or none."""
    rng = np.random.default_rng(seed)
    state = np.array([rng.uniform(8, 25), rng.uniform(-4, 4), rng.uniform(-4, 4), 0, 0, 0])
    unknowns = rng.standard_normal(5)
    parts = CAR.parts(unknowns[None])[0]
    azimuth = np.arctan2(state[1], state[0]) + rng.uniform(-0.3, 0.3, count)
    direction = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    origin = np.tile([0.0, 0.0, rng.uniform(0.5, 2.0)], (count, 1))
    slope = (rng.uniform(0.0, 1.6, count) - origin[:, 2]) / np.hypot(*state[:2])
    entries = np.array(
        [marched(state, parts, *ray) for ray in zip(origin, direction, slope, strict=True)]
    )
    kind = rng.choice([HIT, PASSED, EMPTY], count)
    near = np.where(np.isfinite(entries), entries, np.hypot(*state[:2]))
    reach = np.where(kind == HIT, near + rng.normal(0, 0.06, count), near + rng.normal(0, 3, count))
    reach = np.where(kind == EMPTY, np.inf, reach)
    rays = Rays(
        origin, direction, slope, reach, kind, np.full(count, SIGMA_M), np.zeros(count),
        np.zeros(count),
    )  # fmt: skip
    return np.concatenate([state, unknowns]), rays, entries


@pytest.mark.parametrize("seed", range(8))
def test_equals_the_slow_likelihood(seed):
    vector, rays, entries = fan(seed)
    asked = vector[None], drawn(CAR), (np.arange(11), np.zeros(11)), (rays, SHARP)
    logs = np.log(ray_chances(*asked)[0])
    slow = np.array(
        [slow_log_chance(*ray) for ray in zip(entries, rays.kind, rays.reach, strict=True)]
    )
    # The march is half a millimetre coarse and may miss a corner that a ray only grazes.
    same = np.isclose(logs, slow, atol=0.05)
    assert same.mean() >= 0.95
    assert log_likelihoods(*asked)[0] == pytest.approx(logs.sum())


def test_misfits_vanish_on_the_surface_and_grow_beside_it():
    parts = BodyModel((4.0, 0.0), (2.0, 0.0), (0.0, 0.0)).parts(np.zeros((1, 5)))
    states = np.zeros((3, 6))
    states[:, 0] = 12.0, 12.1, 12.0
    states[2, 1] = 1.5
    one = np.ones(1)
    ray = Rays(
        np.array([[0.0, 0.0, 0.8]]), np.array([[1.0, 0.0]]), 0 * one, 10.0 * one,
        np.array([HIT]), 0.02 * one, 0 * one, 0 * one,
    )  # fmt: skip
    out = np.empty((3, 1))
    misfits(states, np.repeat(parts, 3, axis=0), ray, (0.0, 0.01), out)
    # On the rear; 0.1 m before it with 0.02 m of noise; 0.5 m beside the flank at an edge of 0.01.
    assert out[:, 0] == pytest.approx([0.0, -5.0, 50.0]) or out[:, 0] == pytest.approx([0, 5, 50])


def test_a_ray_just_over_the_roof_begins_to_disagree_without_a_jump():
    parts = BodyModel((4.0, 0.0), (2.0, 0.0), (0.0, 0.0)).parts(np.zeros((1, 5)))
    states = np.zeros((201, 6))
    states[:, 0] = np.linspace(11.5, 12.5, 201)
    one = np.ones(1)
    # From 2 m above the road to the roof's height, 1.5 m, at the rear of a body at 12 m.
    ray = Rays(
        np.array([[0.0, 0.0, 2.0]]), np.array([[1.0, 0.0]]), -0.05 * one, np.inf * one,
        np.array([EMPTY]), 0.02 * one, 0 * one, 0 * one,
    )  # fmt: skip
    out = np.empty((201, 1))
    misfits(states, np.repeat(parts, 201, axis=0), ray, (0.0, 0.01), out)
    assert out.min() == 0.0
    assert out.max() > 2.0
    # 5 mm farther at this slope is 0.25 mm lower.
    assert np.abs(np.diff(out[:, 0])).max() == pytest.approx(0.00025 / 0.01)


@settings(max_examples=50)
@given(st.floats(-10, 30), st.floats(-1.5, 1.5), st.floats(-3, 3), st.floats(-0.5, 0.5))
def test_motion_follows_its_differential_equation(speed, turn, acceleration, time):
    state = np.array([1.0, 2.0, 0.3, speed, turn, 0.0])
    x, y, yaw = state[:3]
    for _ in range(2000):
        dt = time / 2000
        x += speed * dt * np.cos(yaw + turn * dt / 2)
        y += speed * dt * np.sin(yaw + turn * dt / 2)
        yaw += turn * dt
    assert pose_after(state, time) == pytest.approx((x, y, yaw), abs=1e-5)
    straight = np.array([0.0, 0.0, 0.0, speed, 0.0, acceleration])
    way = speed * time + acceleration * time**2 / 2
    assert pose_after(straight, time) == pytest.approx((way, 0.0, 0.0))
