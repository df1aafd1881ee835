"""The compiled likelihood of rays says what an obvious one says that tries every side."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from roadscope.detectors.pose import (
    EMPTY,
    EXACTLY_DRAWN,
    HIT,
    PASSED,
    ROUGHLY_DRAWN,
    VALUES,
    BodyModel,
    BodyRays,
    fill_outlines,
    new_outlines,
    ray_fits,
    saloon,
)

BRICK = BodyModel((4.0, 0.0), (2.0, 0.0), (0.0, 0.0))
"""From 0.15 to 1.5 m above the road."""


def rays_of(count, seed):
    """Return rays from around towards what stands near the origin, of every kind."""
    rng = np.random.default_rng(seed)
    bearing, distance = rng.uniform(-np.pi, np.pi, count), rng.uniform(5.0, 30.0, count)
    aim = bearing + np.pi + rng.uniform(-3.0, 3.0, count) / distance
    origin = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing)])
    kind = rng.integers(0, 3, count)
    reach = distance + rng.uniform(-2.5, 2.5, count)
    return BodyRays(
        np.column_stack([origin, rng.uniform(0.5, 2.0, count)]),
        np.column_stack([np.cos(aim), np.sin(aim)]),
        rng.uniform(-0.1, 0.05, count),
        np.where(kind == EMPTY, np.inf, np.where(kind == PASSED, distance + 20.0, reach)),
        kind.astype(np.int64),
        np.full(count, 0.02),
        rng.uniform(-0.3, 0.3, count),
        np.full(count, 4e-4),
    )


def slow_place(state, time):
    """Integrate speed and heading in small steps."""
    x, y, yaw, speed, turn, acceleration = state[:6]
    step = time / 2000
    for k in range(2000):
        middle = (k + 0.5) * step
        x += (speed + acceleration * middle) * step * math.cos(yaw + turn * middle)
        y += (speed + acceleration * middle) * step * math.sin(yaw + turn * middle)
    return x, y, yaw + turn * time


def slow_soft(z):
    share = min(max(z, -2.2), 2.2) / 4.4 + 0.5
    return share * share * (3 - 2 * share)


class RayCrossing(NamedTuple):
    """Where a ray crosses a section: how far within silhouette and heights, distance, cosine."""

    depth: float
    margin: float
    distance: float
    cosine: float


def slow_crossings(model, state, rays, m):
    """Return where a ray crosses each section: clip it by each side."""
    x, y, yaw = slow_place(state, rays.time[m])
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    start = turn @ (rays.origin[m, :2] - [x, y])
    direction = turn @ rays.direction[m]
    outlines, crossings = new_outlines(len(model.sections)), []
    fill_outlines(model.shape, state, outlines)
    for p, section in enumerate(model.sections):
        points = np.column_stack([outlines.x[p], outlines.y[p]]) - start
        aside = points @ [-direction[1], direction[0]]
        depth = min(aside.max(), -aside.min())
        if depth > 0:
            first, last, cosine = -np.inf, np.inf, 0.0
            for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
                side = b - a
                if np.hypot(*side) < 1e-9:
                    continue
                normal = np.array([side[1], -side[0]]) / np.hypot(*side)
                speed = normal @ direction
                if abs(speed) > 1e-12:
                    at = normal @ a / speed
                    if speed < 0 and at > first:
                        first, cosine = at, -speed
                    elif speed > 0:
                        last = min(last, at)
        else:
            nearest = np.abs(aside).argmin()
            first, last, cosine = points[nearest] @ direction, 0.0, 0.3
        level, slope = rays.origin[m, 2], rays.slope[m]
        height = level + slope * first
        margin = min(section.top_m - height, height - section.bottom_m)
        if depth > 0 and margin < 0:
            end = level + slope * last
            over = height > section.top_m
            within = section.top_m - end if over else end - section.bottom_m
            if within > 0:
                margin = within
                first = ((section.top_m if over else section.bottom_m) - level) / slope
        crossings.append(RayCrossing(depth, margin, first, cosine))
    return crossings


def slow_light(rays, m, crossing, tolerance):
    if rays.kind[m] == PASSED:
        return 1.0
    ratio = min(crossing.cosine / (rays.need[m] * crossing.distance**2), 16.0) ** tolerance.steep
    return ratio / (1 + ratio)


def slow_likelihood(model, state, rays, m, tolerance):
    left, density, silence = 1.0, tolerance.outlier / tolerance.outlier_m, 0.0
    least = tolerance.through if rays.kind[m] == PASSED else tolerance.lost
    for crossing in sorted(slow_crossings(model, state, rays, m), key=lambda c: c.distance):
        chance = slow_soft(crossing.depth / tolerance.edge_m)
        chance *= slow_soft(crossing.margin / tolerance.height_m)
        if not chance > 0 or not crossing.distance > 0:
            continue
        bright = slow_light(rays, m, crossing, tolerance)
        z = (rays.reach[m] - crossing.distance) / rays.sigma[m]
        normal = math.exp(-0.5 * z * z) / math.sqrt(2 * math.pi) / rays.sigma[m]
        if abs(z) < 6:
            density += left * chance * (1 - tolerance.outlier) * normal * max(bright, 0.01)
        if rays.kind[m] != HIT and crossing.distance >= rays.reach[m]:
            break
        silence += left * chance * max(1 - bright, least)
        left *= 1 - chance
    return density if rays.kind[m] == HIT else silence + left


def slow_misfit(model, state, rays, m, tolerance, slack_m):
    edge, sigma = tolerance.edge_m + slack_m, math.hypot(rays.sigma[m], slack_m)
    crossings = slow_crossings(model, state, rays, m)
    if rays.kind[m] != HIT:
        depths = [0.0]
        for crossing in crossings:
            if 0 < crossing.distance <= rays.reach[m]:
                light = slow_light(rays, m, crossing, tolerance)
                most = math.sqrt(-2 * math.log(1 - light)) if light < 1 else 3.5
                depths.append(min(crossing.depth / edge, crossing.margin / edge, most, 3.5))
        return max(depths)
    height, off = rays.origin[m, 2] + rays.slope[m] * rays.reach[m], [100.0]
    for section, crossing in zip(model.sections, crossings, strict=True):
        if section.bottom_m - 0.02 <= height <= section.top_m + 0.02:
            cosine, beside = crossing.cosine, -crossing.depth / edge
            scatter = math.hypot(sigma * cosine, edge * math.sqrt(1 - cosine**2))
            along = (crossing.distance - rays.reach[m]) * cosine / scatter
            off.append(along if crossing.depth > 0 else beside)
    return min(off, key=abs)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("tolerance", [ROUGHLY_DRAWN, EXACTLY_DRAWN], ids=["rough", "exact"])
@pytest.mark.parametrize("model", [BRICK, saloon((4.7, 0.1), (1.8, 0.05))], ids=["brick", "car"])
def test_likelihoods_of_rays_equal_the_plain_computation(model, tolerance):
    rng, rays = np.random.default_rng(1), rays_of(120, 1)
    states = rng.standard_normal((4, VALUES)) * [0.3, 0.3, 1, 3, 0.5, 0, 1, 1, 1, 1, 1]
    fits = ray_fits(states, model.shape, rays, tolerance, 0.0)
    for k, state in enumerate(states):
        slow = [slow_likelihood(model, state, rays, m, tolerance) for m in range(120)]
        np.testing.assert_allclose(np.log(fits.likelihoods[k]), np.log(slow), atol=1e-3)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("slack_m", [0.0, 0.08])
@pytest.mark.parametrize("model", [BRICK, saloon((4.7, 0.1), (1.8, 0.05))], ids=["brick", "car"])
def test_misfits_of_rays_equal_the_plain_computation(model, slack_m):
    rng, rays = np.random.default_rng(2), rays_of(120, 2)
    states = rng.standard_normal((4, VALUES)) * [0.3, 0.3, 1, 3, 0.5, 0, 1, 1, 1, 1, 1]
    fits = ray_fits(states, model.shape, rays, ROUGHLY_DRAWN, slack_m)
    for k, state in enumerate(states):
        slow = [slow_misfit(model, state, rays, m, ROUGHLY_DRAWN, slack_m) for m in range(120)]
        np.testing.assert_allclose(fits.misfits[k], slow, rtol=1e-3, atol=1e-3)


def level_ray(y, reach, kind=HIT):
    """Return one level ray along x at a height of 1 m from 20 m behind the origin."""
    return BodyRays(
        np.array([[-20.0, y, 1.0]]),
        np.array([[1.0, 0.0]]),
        np.zeros(1),
        np.array([reach]),
        np.array([kind]),
        np.array([0.02]),
        np.zeros(1),
        np.zeros(1),
    )


def misfit(ray, slack_m=0.0):
    return float(ray_fits(np.zeros((1, VALUES)), BRICK.shape, ray, ROUGHLY_DRAWN, slack_m)[1][0, 0])


def test_a_return_misfits_by_its_distance_from_the_face():
    assert misfit(level_ray(0.5, 18.0)) == pytest.approx(0.0, abs=1e-9)
    assert misfit(level_ray(0.5, 17.9)) == pytest.approx(5.0)
    assert misfit(level_ray(0.5, 18.1)) == pytest.approx(-5.0)
    assert misfit(level_ray(0.5, 17.9), 0.1) == pytest.approx(0.1 / math.hypot(0.02, 0.1))


def test_a_ray_that_passed_misfits_by_its_depth_up_to_a_bound():
    assert misfit(level_ray(1.1, 60.0, PASSED)) == 0.0
    assert misfit(level_ray(0.994, 60.0, PASSED)) == pytest.approx(1.0)
    assert misfit(level_ray(0.0, 60.0, PASSED)) == pytest.approx(3.5)
    # What stands nearer hides the body.
    assert misfit(level_ray(0.0, 10.0, PASSED)) == 0.0
