"""A map of surfaces, and scans moved onto it."""

import numpy as np
import pytest

from roadscope.odometry import exp_se3, log_se3
from roadscope.odometry.voxels import (
    FLOOR_M,
    GRAZING,
    MOST,
    TILT,
    TRACED_RAD,
    PosePrior,
    VoxelMap,
    contradicts,
    match,
    normal_equations,
    surface_at,
)

NOTHING_HELD, UP = np.zeros((6, 6)), np.array([0.0, 0.0, 1.0])


def room_points(rng, n=6000):
    """Points on the floor and four walls of a room, with poles in it."""
    u, v = rng.uniform(-8, 8, (2, n))
    up = rng.uniform(0, 3, n)
    kind = rng.integers(0, 6, n)
    x = np.select([kind == 1, kind == 2], [np.full(n, -8.3), np.full(n, 8.3)], u)
    y = np.select([kind == 3, kind == 4], [np.full(n, -8.3), np.full(n, 8.3)], v)
    z = np.where(kind == 0, -1.7, up)
    poles = kind == 5
    x[poles], y[poles] = np.where(u > 0, 4.2, -3.3)[poles], np.where(v > 0, 2.3, -4.6)[poles]
    return np.column_stack([x, y, z]) + 0.01 * rng.standard_normal((n, 3))


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture
def known(rng):
    voxel_map = VoxelMap(reach_m=50.0)
    voxel_map.add(room_points(rng), np.zeros(3))
    return voxel_map


def test_a_scan_is_matched_with_the_map(rng, known):
    truth = exp_se3(np.array([0.3, -0.2, 0.1, 0.02, -0.01, 0.04]))
    inverse = np.linalg.inv(truth)
    points = room_points(np.random.default_rng(1), 2000) @ inverse[:3, :3].T + inverse[:3, 3]
    matched = match(known.voxels, points, PosePrior(np.eye(4), NOTHING_HELD))
    assert np.abs(log_se3(np.linalg.inv(truth) @ matched.map_from_sensor)).max() < 3e-3
    assert matched.agreement > 0.7
    assert 1000 < matched.matched_points <= matched.points == 2000


def slowly_held(voxels, slot, off, height_m):
    """How firmly a point is held along each axis, 1/m^2.

    off: (3,) from the mean, along the axes. height_m: (3,), how far off along them it may be
    because the height at which a beam hit the object is unknown.
    """
    firm, spreads = np.zeros(3), voxels.spreads[slot]
    for k in range(voxels.fixed_axes[slot]):
        lever = 1 + (off[k + 1 :] ** 2 / (spreads[k + 1 :] + FLOOR_M**2)).sum()
        variance = spreads[k] * (1 + lever / (voxels.counts[slot] - 3)) + FLOOR_M**2
        firm[k] = 1 / (variance + height_m[k] ** 2)
    return firm


def test_equations_equal_those_of_the_slow_twin(rng, known):
    points = room_points(np.random.default_rng(2), 200)
    pose, scale = exp_se3(0.02 * rng.standard_normal(6)), 4.0
    H, b, statistics = normal_equations(known.voxels, points, pose, scale, FLOOR_M)
    slow_H, slow_b, slow_statistics = np.zeros((6, 6)), np.zeros(6), np.zeros(3)
    voxels = known.voxels
    for point in points:
        arm = pose[:3, :3] @ point
        slot = surface_at(voxels, *(arm + pose[:3, 3]))
        if slot < 0:
            continue
        off = voxels.axes[slot] @ (arm + pose[:3, 3] - voxels.means[slot])
        along = voxels.axes[slot] @ pose[:3, :3]
        rising = pose[:3, 2] @ arm > 0
        unknown_m = TRACED_RAD * np.linalg.norm(arm) * along[:, 2] * rising
        firm = slowly_held(voxels, slot, off, unknown_m)
        squared = firm @ off**2
        share = 1 / (1 + squared / scale**2) ** 2
        shrunk = along**3 / (along**2 + TILT**2) @ pose[:3, :3].T
        rows = np.hstack([shrunk, np.cross(arm, voxels.axes[slot])])
        into = voxels.axes[slot, 0] @ arm / np.linalg.norm(arm)
        rises = voxels.fixed_axes[slot] == 1 and rising
        weights = share * firm * (into**2 / (into**2 + GRAZING**2) if rises else 1.0)
        slow_H += rows.T @ (weights[:, None] * rows)
        slow_b += rows.T @ (weights * off)
        slow_statistics += (1, share, share * squared)
    assert np.allclose(H, slow_H)
    assert np.allclose(b, slow_b)
    assert np.allclose(statistics, slow_statistics)


def test_one_beams_trace_on_a_road_is_no_surface(rng):
    voxel_map = VoxelMap(reach_m=50.0)
    angle = rng.uniform(-0.5, 0.5, 4000)
    trace = np.column_stack([9 * np.cos(angle), 9 * np.sin(angle), np.full(4000, -1.9)])
    voxel_map.add(trace + 0.02 * rng.standard_normal(trace.shape), np.zeros(3))
    # Where the ring bends enough within a voxel, its plane is the road's: that holds no way along.
    upright = np.abs(voxel_map.voxels.axes[:, 0, 2])[voxel_map.voxels.fixed_axes > 0]
    assert (upright > 0.9).all()
    assert (voxel_map.voxels.fixed_axes < 2).all()


def test_one_beams_trace_over_a_crown_has_little_information_about_height(rng):
    """The trace sinks as the sensor comes closer; a ceiling, hit from below, stays."""
    turn, along = rng.uniform(-0.05, 0.05, 400), rng.uniform(40, 47, 400)
    steep = np.tan(np.radians(11.0))
    trace = np.column_stack([along * np.cos(turn), along * np.sin(turn), steep * along])
    ceiling = np.column_stack([rng.uniform(8, 15, 400), rng.uniform(-2, 2, 400), np.full(400, 2.5)])
    firm = {}
    for name, points in (("trace", trace), ("ceiling", ceiling)):
        known = VoxelMap(reach_m=60.0)
        known.add(points + rng.normal(0, 0.01, points.shape), np.zeros(3))
        forward = np.eye(4)
        forward[0, 3] = 0.5
        H, _, statistics = normal_equations(known.voxels, points[::4].copy(), forward, 1.0, FLOOR_M)
        assert statistics[0] > 50
        firm[name] = H[2, 2] / statistics[1]
    assert firm["trace"] < 0.2 * firm["ceiling"]


def test_tilted_surfaces_inform_falling_beams_more_than_rising_ones(rng):
    """Upright walls keep their information about horizontal motion."""
    across = rng.uniform(-3, 3, 600)
    firm = {}
    for name, lean, up in (("rising", 1.0, 6.0), ("falling", 1.0, -6.0), ("wall", 0.0, 6.0)):
        height = rng.uniform(-1.5, 1.5, 600)
        points = np.column_stack([30 + lean * height, across, up + height])
        known = VoxelMap(reach_m=60.0)
        known.add(points + rng.normal(0, 0.03, points.shape), np.zeros(3))
        H, _, statistics = normal_equations(
            known.voxels, points[::4].copy(), np.eye(4), 3.0, FLOOR_M
        )
        firm[name] = np.diag(H)[:3] / statistics[1]
    assert firm["rising"][2] < 0.1 * firm["falling"][2]
    assert firm["wall"][0] > firm["falling"][0]


def test_far_voxels_are_dropped_and_the_table_grows(rng):
    voxel_map = VoxelMap(reach_m=30.0)
    for step in range(60):
        at = np.array([10.0 * step, 0, 0])
        voxel_map.add(at + rng.uniform(-20, 20, (3000, 3)) * (1, 1, 0.1), at)
    assert len(voxel_map) < 0.5 * len(voxel_map.voxels.keys)
    last = voxel_map.voxels.means[voxel_map.voxels.counts > 5]
    assert last[:, 0].max() > 590
    assert last[:, 0].min() > 400
    assert voxel_map.voxels.counts.sum() > 3 * 3000


def test_points_out_of_range_are_left_out(known):
    before = len(known)
    known.add(np.array([[1e7, 0, 0], [0, 0, -1e9]]), np.zeros(3))
    assert len(known) <= before + 1


def corridor(rng, n=8000):
    """Points on floor, ceiling and both walls of a corridor along x, 3 m wide and 2.8 m high."""
    side = rng.integers(0, 4, n)
    x, across, up = rng.uniform(0, 12, n), rng.uniform(-1.5, 1.5, n), rng.uniform(-0.6, 2.2, n)
    y = np.select([side == 0, side == 1], [np.full(n, -1.5), np.full(n, 1.5)], across)
    z = np.select([side == 2, side == 3], [np.full(n, -0.6), np.full(n, 2.2)], up)
    return np.column_stack([x, y, z]) + 0.005 * rng.standard_normal((n, 3)), side


def test_between_near_walls_the_floor_has_its_own_voxels(rng):
    voxel_map = VoxelMap(reach_m=50.0)
    points, side = corridor(rng)
    voxel_map.add(points, np.zeros(3))
    level = points[(side >= 2) & (np.abs(points[:, 1]) < 0.9)]
    slots = np.array([surface_at(voxel_map.voxels, *point) for point in level])
    upright = np.abs(voxel_map.voxels.axes[slots, 0, 2])
    assert (slots >= 0).mean() > 0.95
    assert (upright[slots >= 0] > 0.95).mean() > 0.95


def test_a_full_voxel_does_not_change(rng):
    flat = np.column_stack([rng.uniform(0, 1, (2 * int(MOST), 2)), np.full(2 * int(MOST), 0.2)])
    voxel_map = VoxelMap(reach_m=50.0)
    voxel_map.add(flat, np.zeros(3))
    slot = surface_at(voxel_map.voxels, 0.5, 0.5, 0.2)
    voxel_map.add(flat + 0.1 * UP, np.zeros(3))
    assert voxel_map.voxels.counts[slot] == MOST
    assert voxel_map.voxels.means[slot, 2] == pytest.approx(0.2)


def test_points_off_a_surface_contradict_it_and_rough_ones_do_not(rng, known):
    floor = np.column_stack([rng.uniform(-6, 6, (200, 2)), np.full(200, -1.7)])
    assert contradicts(known.voxels, floor + 0.08 * UP).mean() < 0.1
    assert contradicts(known.voxels, floor + 0.4 * UP).mean() > 0.9
