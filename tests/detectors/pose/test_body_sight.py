"""The rays that tell of a body are those that a slow way in NumPy picks and joins."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.core import LidarScan, Pose
from roadscope.detectors.pose.body_kernels import EMPTY, HIT, PASSED, Rays
from roadscope.detectors.pose.body_model import BodyModel
from roadscope.detectors.pose.body_rays import sight
from roadscope.detectors.pose.body_sight_kernels import (
    BEAM,
    BESIDE,
    LEAP_M,
    LEAP_SD,
    ROUGHNESS_M,
    WIDEST,
    Grid,
    joined,
)
from roadscope.detectors.pose.body_start import ANGLES, CLOSE_M, starts
from roadscope.envs.sensors.lidar_spec import SPECS

SPEC = SPECS["vlp16"]


def some_scan(seed, seam, rough):
    """A body of several beams, other returns and holes; which returns are the body's."""
    rng = np.random.default_rng(seed)
    ring, step = (a.ravel() for a in np.meshgrid(np.arange(3, 11), np.arange(60), indexing="ij"))
    column = (step + (SPEC.columns - 30 if seam else 200)) % SPEC.columns
    own = (step > 8) & (step < 50 - ring) & (rng.random(len(ring)) < 0.9)
    ranges = np.where(own, 12 + 0.01 * step + rough * rng.standard_normal(len(ring)), 30.0)
    azimuth, up = SPEC.azimuths()[column], SPEC.elevations[ring]
    flat = ranges * np.cos(up)
    points = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), ranges * np.sin(up)])
    order = rng.permutation(np.flatnonzero(own | (rng.random(len(ring)) < 0.5)))
    arrays = points.astype(np.float32), rng.random(len(ring)).astype(np.float32)
    taken = [a[order] for a in (*arrays, ring.astype(np.int16), column.astype(np.int32))]
    return LidarScan(*taken, np.zeros(len(order), np.float32), 0.0, "lidar"), own[order]


def slow_grid(scan, target, budget):
    """Ring, column, reach and kind, beam after beam."""
    found = np.unique(scan.column[target])
    gaps = np.diff(found, append=found[0] + SPEC.columns)
    start = int(found[(np.argmax(gaps) + 1) % len(found)])
    place = (scan.column.astype(np.int64) - start) % SPEC.columns
    width = place[target].max() + 1 + 2 * BESIDE
    place = (place + BESIDE) % SPEC.columns
    cells = np.full((2, SPEC.beams, width), np.inf)
    for i in np.flatnonzero(place < width):
        near = cells[int(not target[i]), scan.ring[i]]
        near[place[i]] = min(near[place[i]], np.linalg.norm(scan.points[i].astype(float)))
    beams = np.flatnonzero(np.isfinite(cells[0]).any(axis=1))
    rows = []
    for ring in beams[:: -(-len(beams) * BEAM // budget)]:
        hit = np.flatnonzero(np.isfinite(cells[0, ring]))
        for p in range(max(hit[0] - BESIDE, 0), min(hit[-1] + BESIDE + 1, width)):
            own, other = cells[:, ring, p]
            kind = HIT if np.isfinite(own) else PASSED if np.isfinite(other) else EMPTY
            column = (p - BESIDE + start) % SPEC.columns
            rows.append((ring, column, own if kind == HIT else other, kind))
    return [np.array(column) for column in zip(*rows, strict=True)]


def slow_joined(rays, ring, column, budget):
    """Rays of which those inside long runs are means of neighbours."""
    hits = int((rays.kind == HIT).sum())
    if hits <= budget:
        return rays
    size = min(-(-hits // budget), WIDEST)
    breaks = np.ones(len(ring), bool)
    breaks[1:] = (np.diff(ring) != 0) | (np.abs(np.diff(column)) != 1)
    with np.errstate(invalid="ignore"):
        breaks[1:] |= (rays.kind[1:] != HIT) | (rays.kind[:-1] != HIT)
        noise = np.hypot(rays.sigma[1:], rays.sigma[:-1])
        breaks[1:] |= np.abs(np.diff(rays.reach)) > np.maximum(LEAP_M, LEAP_SD * noise)
    firsts = np.flatnonzero(breaks)
    lengths = np.diff(firsts, append=len(ring))
    within = np.arange(len(ring)) - np.repeat(firsts, lengths)
    after = np.repeat(lengths, lengths) - within - 1
    rows = np.flatnonzero(breaks | (within < 2) | (after < 2) | ((within - 2) % size == 0))
    parts = np.split(np.arange(len(ring)), rows[1:])
    middle = (rays.kind[rows] == HIT) & (within[rows] >= 2) & (after[rows] >= 2)
    step = max(-(-int(middle.sum()) // budget), 1)
    kept = ~middle | (np.cumsum(middle) % step == 0)
    means = [np.stack([c[p].mean(axis=0) for p in parts]) for c in rays]
    counts = np.array([len(p) for p in parts])
    for k in np.flatnonzero(counts > 1):
        rows_of = parts[k]
        ways = np.column_stack([rays.direction[rows_of], rays.slope[rows_of]])
        mean = (rays.reach[rows_of, None] * ways).mean(axis=0)
        reach = np.hypot(*mean[:2])
        means[1][k], means[2][k], means[3][k] = mean[:2] / reach, mean[2] / reach, reach
    means[5] = np.sqrt((rays.sigma[rows] ** 2 - ROUGHNESS_M**2) / counts + ROUGHNESS_M**2)
    return Rays(*(c[kept] for c in means))


def test_joined_returns_of_a_plane_lie_in_it():
    """Seen at 76 degrees, mean ranges along mean directions lie a millimetre behind it."""
    azimuths = 0.003 * np.arange(60)
    ways = np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    normal = np.array([np.cos(1.33), np.sin(1.33)])
    reach = 2.0 / (ways @ normal)
    flat = np.zeros(60)
    hit, column, ring = np.full(60, HIT), np.arange(60), np.zeros(60, np.int64)
    origin = np.zeros((60, 3))
    rays = Rays(origin, ways, flat, reach, hit, flat + 0.02, flat, flat)
    found = joined(rays, Grid(ring, column, reach, hit), 15, 0.0)
    assert len(found.reach) < 30
    np.testing.assert_allclose(found.reach * (found.direction @ normal), 2.0, atol=1e-9)


def test_noise_does_not_keep_neighbours_apart():
    """A face seen with a noise of 10 cm leaves as few rays as one without noise."""
    ring, column = np.zeros(200, np.int64), np.arange(200)
    hit, flat, origin = np.full(200, HIT), np.zeros(200), np.zeros((200, 3))
    ways = np.column_stack([np.cos(0.004 * column), np.sin(0.004 * column)])
    reach = 20.0 + 0.1 * np.random.default_rng(0).standard_normal(200)
    for sigma, apart in ((0.1, False), (0.02, True)):
        rays = Rays(origin, ways, flat, reach, hit, flat + sigma, flat, flat)
        found = joined(rays, Grid(ring, column, reach, hit), 48, 0.0)
        assert (len(found.reach) > 90) == apart


def slow_sight(spec, scan, target, pose, velocity, budget):
    ring, column, reach, kind = slow_grid(scan, target, budget)
    offsets = SPEC.column_offsets_s()[column] + SPEC.firing_offsets_s[ring]
    azimuth, up = SPEC.azimuths()[column], SPEC.elevations[ring]
    flat = np.cos(up)
    ways = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(up)])
    ways = ways @ pose.rotation.T
    level = np.hypot(ways[:, 0], ways[:, 1])
    origin = np.tile(pose.translation, (len(level), 1))
    origin[:, :2] += velocity * offsets[:, None]
    signal = np.linalg.norm(scan.points[target].astype(float), axis=1) * 4 / SPEC.range_max_m
    brightest = max(float((scan.intensity[target] * (1 + signal**2)).max()), 0.05)
    need = SPEC.detection_limit / (brightest * SPEC.range_max_m**2)
    sigma = np.hypot(spec.range_noise_m * level, ROUGHNESS_M)
    rays = Rays(
        origin, ways[:, :2] / level[:, None], ways[:, 2] / level, reach * level, kind, sigma,
        offsets, np.full(len(level), need),
    )  # fmt: skip
    return slow_joined(rays, ring, column, budget)


@pytest.mark.parametrize("budget", [12, 48, 500])
@pytest.mark.parametrize("noise_m", [0.03, 0.1])
@given(seed=st.integers(0, 2**32 - 1), seam=st.booleans(), rough=st.sampled_from([0.01, 0.1]))
@settings(max_examples=10, deadline=None)
def test_rays_are_those_of_the_slow_way(noise_m, budget, seed, seam, rough):
    scan, target = some_scan(seed, seam, rough)
    spec = replace(SPEC, range_noise_m=noise_m)
    pose, velocity = Pose.from_euler(1.0, 2.0, 1.8, yaw=0.4, pitch=0.02), np.array([8.0, -3.0])
    found = sight(spec, scan, target, pose, sensor_velocity=velocity, budget=budget)
    expected = slow_sight(spec, scan, target, pose, velocity, budget)
    for one, other in zip(found.rays, expected, strict=True):
        assert np.allclose(one, other, atol=1e-9)


def slow_starts(points, origin, model):
    axes = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
    off = np.full((len(points), len(ANGLES)), CLOSE_M)
    for axis in (axes, np.stack([-axes[1], axes[0]])):
        along = points @ axis
        low, high = along.min(axis=0), along.max(axis=0)
        ahead = (origin @ axis) > 0.5 * (low + high)
        off = np.minimum(off, np.where(ahead, high - along, along - low))
    first = ANGLES[np.argmin(off.sum(axis=0))]
    for yaw in first + np.arange(4) * np.pi / 2:
        axis, centre = np.array([np.cos(yaw), np.sin(yaw)]), np.zeros(2)
        sides = (axis, model.length_m[0]), (axis[::-1] * (-1, 1), model.width_m[0])
        for way, extent in sides:
            along, sensor = points @ way, origin @ way
            low, high = along.min(), along.max()
            near = high - extent / 2 if sensor > high else low + extent / 2
            centre += (near if not low <= sensor <= high else (low + high) / 2) * way
        yield [*centre, yaw]


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(3, 60))
def test_first_guesses_are_those_of_the_slow_way(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 2)) * [2.0, 0.5] + [20.0, 3.0]
    model = BodyModel((4.4, 0.3), (1.8, 0.1))
    expected = np.array(list(slow_starts(points, rng.normal(size=2), model)))
    rng = np.random.default_rng(seed)
    rng.normal(size=(count, 2))
    assert np.allclose(starts(points, rng.normal(size=2), model), expected, atol=1e-9)
