"""Which units each block of columns may see, nearest first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.raycast.blocks import SLACK, Blocks, Rays, pseudo_angle
from roadscope.envs.raycast.shapes import STILL, Shapes


class Motion(NamedTuple):
    """Poses of A actors at K knots.

    poses: (K, A, 3) x, y, yaw. speeds: (A, 2) greatest speed in m/s and yaw rate in rad/s.
    extents: (A, 3) middle x and y of all positions, greatest distance from it.
    """

    poses: np.ndarray
    speeds: np.ndarray
    extents: np.ndarray


class Members(NamedTuple):
    """Units per block.

    starts: (N + 1,) int64, block n owns rows starts[n] to starts[n + 1] of units.
    units: (S,) int64.
    """

    starts: np.ndarray
    units: np.ndarray


@compiled()
def follow(poses: np.ndarray, knots_s: np.ndarray) -> Motion:
    """Bound the motion of all actors."""
    count, actors = poses.shape[0], poses.shape[1]
    speeds, extents = np.zeros((actors, 2)), np.empty((actors, 3))
    for a in range(actors):
        x_low = x_high = poses[0, a, 0]
        y_low = y_high = poses[0, a, 1]
        for k in range(1, count):
            dx, dy = poses[k, a, 0] - poses[k - 1, a, 0], poses[k, a, 1] - poses[k - 1, a, 1]
            step = knots_s[k] - knots_s[k - 1]
            speeds[a, 0] = max(speeds[a, 0], np.sqrt(dx * dx + dy * dy) / step)
            speeds[a, 1] = max(speeds[a, 1], abs(poses[k, a, 2] - poses[k - 1, a, 2]) / step)
            x_low, x_high = min(x_low, poses[k, a, 0]), max(x_high, poses[k, a, 0])
            y_low, y_high = min(y_low, poses[k, a, 1]), max(y_high, poses[k, a, 1])
        extents[a, 0], extents[a, 1] = 0.5 * (x_low + x_high), 0.5 * (y_low + y_high)
        extents[a, 2] = np.sqrt((x_high - x_low) ** 2 + (y_high - y_low) ** 2)
    return Motion(poses, speeds, extents)


@compiled()
def assign(
    rays: Rays, blocks: Blocks, shapes: Shapes, motion: Motion, max_range_m: float
) -> Members:
    """Give each block a superset of the units that its rays can meet within the range."""
    x_low = y_low = np.inf
    x_high = y_high = -np.inf
    for c in range(len(rays.origins)):
        x_low, x_high = min(x_low, rays.origins[c, 0]), max(x_high, rays.origins[c, 0])
        y_low, y_high = min(y_low, rays.origins[c, 1]), max(y_high, rays.origins[c, 1])
    reach = np.sqrt((x_high - x_low) ** 2 + (y_high - y_low) ** 2)
    sensor = (0.5 * (x_low + x_high), 0.5 * (y_low + y_high), reach, max_range_m)
    steepest = max(abs(rays.slopes[0]), abs(rays.slopes[-1]))
    spans = np.empty((len(shapes.unit_poses), 4), np.int64)
    nearest = np.empty(len(shapes.unit_poses))
    _find_spans(blocks, shapes, motion, sensor, _sway(blocks, steepest), spans, nearest)
    return _fill(len(blocks.lows), np.argsort(nearest, kind="mergesort"), spans)


@compiled(borrowing=True)
def _sway(blocks: Blocks, steepest: float) -> float:
    """Tangent of the largest angle between a ray and its column's `ahead`, seen from above."""
    most = 0.0
    for n in range(len(blocks.sways)):
        lateral = steepest * blocks.sways[n, 1]
        room = blocks.sways[n, 0] - lateral
        if room <= 0.0:
            return np.inf
        most = max(most, lateral / room)
    return most


@compiled(borrowing=True)
def _find_spans(
    blocks: Blocks,
    shapes: Shapes,
    motion: Motion,
    sensor: tuple[float, float, float, float],
    sway: float,
    spans: np.ndarray,
    nearest: np.ndarray,
) -> None:
    """Two half-open ranges of blocks per unit, the second for what lies across the seam."""
    count = len(blocks.lows)
    for u in range(len(shapes.unit_poses)):
        actor = shapes.unit_poses[u]
        circles = shapes.unit_circles
        x, y, reach = circles[u, 0], circles[u, 1], circles[u, 2]
        if actor != STILL:
            reach += np.sqrt(x * x + y * y) + motion.extents[actor, 2]
            x, y = motion.extents[actor, 0], motion.extents[actor, 1]
        reach = (reach + sensor[2]) * (1.0 + SLACK)
        dx, dy = x - sensor[0], y - sensor[1]
        distance = np.sqrt(dx * dx + dy * dy)
        nearest[u] = distance - reach
        spans[u, 0] = spans[u, 1] = spans[u, 2] = spans[u, 3] = 0
        if nearest[u] > sensor[3]:
            continue
        spans[u, 1] = count
        wide = reach + (distance + reach) * sway
        if wide < 0.999 * distance:
            sine = (wide / distance) * (1.0 + SLACK)
            cosine = np.sqrt(1.0 - sine * sine)
            ex = blocks.seam[0] * dx + blocks.seam[1] * dy
            ey = blocks.seam[0] * dy - blocks.seam[1] * dx
            right = pseudo_angle(ex * cosine + ey * sine, ey * cosine - ex * sine) - SLACK
            left = pseudo_angle(ex * cosine - ey * sine, ey * cosine + ex * sine) + SLACK
            spans[u, 0] = _first_from(blocks.highs, right)
            spans[u, 1] = _first_from(blocks.lows, left)
            if left < right:
                spans[u, 2], spans[u, 3] = spans[u, 0], count
                spans[u, 0] = 0
                spans[u, 2] = max(spans[u, 1], spans[u, 2])


@compiled(borrowing=True)
def _first_from(rising: np.ndarray, value: float) -> int:
    """Return the first place whose number is not below the value."""
    low, high = 0, len(rising)
    while low < high:
        middle = (low + high) >> 1
        if rising[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@compiled()
def _fill(count: int, order: np.ndarray, spans: np.ndarray) -> Members:
    starts = np.zeros(count + 2, np.int64)
    for u in range(len(spans)):
        for n in range(spans[u, 0], spans[u, 1]):
            starts[n + 2] += 1
        for n in range(spans[u, 2], spans[u, 3]):
            starts[n + 2] += 1
    starts = np.cumsum(starts)
    units = np.empty(starts[-1], np.int64)
    for u in order:
        for n in range(spans[u, 0], spans[u, 1]):
            units[starts[n + 1]] = u
            starts[n + 1] += 1
        for n in range(spans[u, 2], spans[u, 3]):
            units[starts[n + 1]] = u
            starts[n + 1] += 1
    return Members(starts[:-1], units)
