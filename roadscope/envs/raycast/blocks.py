"""Blocks of columns with neighbouring azimuths, and the units that each block may hit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.core.sorting import stable_order
from roadscope.envs.raycast.batch import WIDTH
from roadscope.envs.raycast.shapes import STILL, Shapes

# --------------------------------------------------------------------------------------------------
# Columns sorted by azimuth into blocks.

SLACK = 1e-9
"""Every conservative bound is widened by this relative amount, which is far above rounding."""

LEVEL_ERROR = 1e-6
"""Greatest error of the length of `ahead` in columns that count as level."""


class RayColumns(NamedTuple):
    """C columns of B rays.

    origins, ahead, up: (C, 3), world frame. stamps_s: (C,). slopes: (B,), increasing.
    knots: (C,) int64, fractions: (C,), where the stamp lies between the knots of the poses.
    level: all `ahead` are horizontal unit vectors and all `up` are the z axis.
    """

    origins: np.ndarray
    ahead: np.ndarray
    up: np.ndarray
    stamps_s: np.ndarray
    slopes: np.ndarray
    knots: np.ndarray
    fractions: np.ndarray
    level: bool


class Blocks(NamedTuple):
    """N blocks of `WIDTH` columns with neighbouring azimuths.

    order: (C,) int64, columns by azimuth; block n holds places n * WIDTH onwards.
    seam: (2,) horizontal direction; azimuths wrap in the opposite direction.
    lows, highs: (N,) pseudo-angle of the first and the last column, increasing.
    centres: (N, 3) middle of the origins. spreads, lifts: (N,) their greatest horizontal and
        vertical distance from it.
    times: (N, 2) middle and half length of the time in seconds.
    wedges: (N, 4) x and y of the middle direction, cosine and sine of the half angle of `ahead`.
    horizontal_lengths: (N, 2) the least one of `ahead`, the greatest one of `up`.
    climbs: (R, 3, B), R is N, or 1 if level. A climb is the rise of a ray over its horizontal run.
        For each beam: the least climb of it and all beams above, the greatest climb of it and all
        beams below, and the greatest horizontal length of its rays' directions.
    """

    order: np.ndarray
    seam: np.ndarray
    lows: np.ndarray
    highs: np.ndarray
    centres: np.ndarray
    spreads: np.ndarray
    lifts: np.ndarray
    times: np.ndarray
    wedges: np.ndarray
    horizontal_lengths: np.ndarray
    climbs: np.ndarray


@compiled(borrowing=True)
def is_level(ahead: np.ndarray, up: np.ndarray) -> bool:
    """Return whether all `ahead` are horizontal unit vectors and all `up` are the z axis."""
    for c in range(len(ahead)):
        x, y = ahead[c, 0], ahead[c, 1]
        # |x^2 + y^2 - 1| is about twice the error of the length.
        if ahead[c, 2] != 0.0 or abs(x * x + y * y - 1.0) > LEVEL_ERROR:
            return False
        if up[c, 0] != 0.0 or up[c, 1] != 0.0 or up[c, 2] != 1.0:
            return False
    return True


@compiled()
def sort_into_blocks(rays: RayColumns) -> Blocks:
    """Return the columns in sorted blocks, with bounds of each block."""
    x = y = 0.0
    for c in range(len(rays.ahead)):
        x += rays.ahead[c, 0]
        y += rays.ahead[c, 1]
    length = np.sqrt(x * x + y * y)
    seam = np.array([1.0, 0.0])
    if length > 1e-3 * len(rays.ahead):
        seam[0], seam[1] = x / length, y / length
    angles = _pseudo_angles(rays.ahead, seam)
    order = _order(angles)
    size = -(-len(order) // WIDTH)
    rows = 1 if rays.level else size
    lows, highs = np.empty(size), np.empty(size)
    for n in range(size):
        lows[n] = angles[order[n * WIDTH]]
        highs[n] = angles[order[min((n + 1) * WIDTH, len(order)) - 1]]
    blocks = Blocks(
        order,
        seam,
        lows,
        highs,
        np.empty((size, 3)),
        np.empty(size),
        np.empty(size),
        np.empty((size, 2)),
        np.empty((size, 4)),
        np.empty((size, 2)),
        np.empty((rows, 3, len(rays.slopes))),
    )
    _bound_blocks(rays, blocks)
    _bound_climbs(rays, blocks)
    return blocks


@compiled()
def _order(angles: np.ndarray) -> np.ndarray:
    """Return the order of columns by angle.

    It is found without sorting if the angles rise or fall except at one place, as a rotating
    sensor's do.
    """
    size = len(angles)
    rises = falls = start = 0
    for c in range(size):
        after = angles[c + 1] if c + 1 < size else angles[0]
        rises += after > angles[c]
        falls += after < angles[c]
    if rises > 1 and falls > 1:
        return stable_order(angles)
    for c in range(1, size):
        if angles[c] < angles[start]:
            start = c
    step = 1 if rises >= falls else -1
    order = np.empty(size, np.int64)
    for place in range(size):
        order[place] = start
        start += step
        start += size if start < 0 else 0
        start -= size if start == size else 0
    return order


@compiled(forceinline=True)
def _length(x: float, y: float) -> float:
    length: float = np.sqrt(x * x + y * y)
    return length


@compiled(forceinline=True)
def pseudo_angle(x: float, y: float) -> float:
    """Return a number from -2 to 2 that grows with the azimuth, without trigonometry."""
    size = abs(x) + abs(y)
    if size == 0.0:
        return 0.0
    ratio = y / size
    if x >= 0.0:
        return ratio
    return 2.0 - ratio if y >= 0.0 else -2.0 - ratio


@compiled()
def _pseudo_angles(ahead: np.ndarray, seam: np.ndarray) -> np.ndarray:
    """Return (C,) pseudo-angles of the columns, 0 in the direction `seam`."""
    angles = np.empty(len(ahead))
    for c in range(len(ahead)):
        x, y = ahead[c, 0], ahead[c, 1]
        angles[c] = pseudo_angle(seam[0] * x + seam[1] * y, seam[0] * y - seam[1] * x)
    return angles


@compiled()
def _bound_blocks(rays: RayColumns, blocks: Blocks) -> None:
    for n in range(len(blocks.lows)):
        start, end = n * WIDTH, min((n + 1) * WIDTH, len(blocks.order))
        x = y = z = mx = my = 0.0
        early, late = np.inf, -np.inf
        shortest, longest_up = np.inf, 0.0
        for i in range(start, end):
            c = blocks.order[i]
            x += rays.origins[c, 0] / (end - start)
            y += rays.origins[c, 1] / (end - start)
            z += rays.origins[c, 2] / (end - start)
            early, late = min(early, rays.stamps_s[c]), max(late, rays.stamps_s[c])
            size = _length(rays.ahead[c, 0], rays.ahead[c, 1])
            shortest = min(shortest, size)
            longest_up = max(longest_up, _length(rays.up[c, 0], rays.up[c, 1]))
            if size > 0.0:
                mx += rays.ahead[c, 0] / size
                my += rays.ahead[c, 1] / size
        blocks.centres[n, 0], blocks.centres[n, 1], blocks.centres[n, 2] = x, y, z
        blocks.times[n, 0], blocks.times[n, 1] = 0.5 * (early + late), 0.5 * (late - early)
        blocks.horizontal_lengths[n, 0], blocks.horizontal_lengths[n, 1] = shortest, longest_up
        spread = lift = 0.0
        for i in range(start, end):
            c = blocks.order[i]
            spread = max(spread, _length(rays.origins[c, 0] - x, rays.origins[c, 1] - y))
            lift = max(lift, abs(rays.origins[c, 2] - z))
        blocks.spreads[n], blocks.lifts[n] = spread, lift
        _bound_wedge(rays, blocks, n, mx, my)


@compiled(borrowing=True)
def _bound_wedge(rays: RayColumns, blocks: Blocks, n: int, mx: float, my: float) -> None:
    wedges, size = blocks.wedges, _length(mx, my)
    wedges[n, 0], wedges[n, 1], wedges[n, 2], wedges[n, 3] = 1.0, 0.0, -1.0, 0.0
    if size == 0.0:
        return
    mx, my = mx / size, my / size
    along, across = 1.0, 0.0
    for i in range(n * WIDTH, min((n + 1) * WIDTH, len(blocks.order))):
        x, y = rays.ahead[blocks.order[i], 0], rays.ahead[blocks.order[i], 1]
        length = _length(x, y)
        if length == 0.0:
            return
        along = min(along, (mx * x + my * y) / length)
        across = max(across, abs(mx * y - my * x) / length)
    if along > 0.1:
        wedges[n, 0], wedges[n, 1] = mx, my
        wedges[n, 2], wedges[n, 3] = np.sqrt(max(0.0, 1.0 - across * across)), across + SLACK


@compiled()
def _bound_climbs(rays: RayColumns, blocks: Blocks) -> None:
    beams = len(rays.slopes)
    for n in range(len(blocks.climbs)):
        least, most, run = blocks.climbs[n, 0], blocks.climbs[n, 1], blocks.climbs[n, 2]
        if rays.level:
            for j in range(beams):
                margin = LEVEL_ERROR * abs(rays.slopes[j])
                least[j], most[j] = rays.slopes[j] - margin, rays.slopes[j] + margin
                run[j] = 1.0 + LEVEL_ERROR
            continue
        least[:], most[:], run[:] = np.inf, -np.inf, 0.0
        for c in blocks.order[n * WIDTH : (n + 1) * WIDTH]:
            for j in range(beams):
                s = rays.slopes[j]
                x = rays.ahead[c, 0] + s * rays.up[c, 0]
                y = rays.ahead[c, 1] + s * rays.up[c, 1]
                size = np.sqrt(x * x + y * y)
                climb = (rays.ahead[c, 2] + s * rays.up[c, 2]) / size
                least[j], most[j] = min(least[j], climb), max(most[j], climb)
                run[j] = max(run[j], size)
        for j in range(1, beams):
            most[j] = max(most[j], most[j - 1])
            least[beams - 1 - j] = min(least[beams - 1 - j], least[beams - j])


# --------------------------------------------------------------------------------------------------
# The units that each block of columns may hit, nearest first.


class ActorMotion(NamedTuple):
    """Poses of A actors at K knots, with bounds.

    poses: (K, A, 3) x, y, yaw. speeds: (A, 2) greatest speed in m/s and yaw rate in rad/s.
    extents: (A, 3) x and y of the middle of all positions, and a bound of their distance from it,
    metres.
    """

    poses: np.ndarray
    speeds: np.ndarray
    extents: np.ndarray


class Stances(NamedTuple):
    """How U units stand on the ground; all zeros on the plane z = 0.

    uneven: whether there is a terrain; shears and tilts are empty without one.
    shears: (S, 3) of scenery: height of the ground under it, slopes along x and y.
    tilts: (K, A, 3) of actors at the knots, as `Terrain.stances`: height, and slopes ahead and to
    the left.
    bounds: (U, 3) least and greatest height, and a bound of the slope in any direction.
    """

    uneven: bool
    shears: np.ndarray
    tilts: np.ndarray
    bounds: np.ndarray


class BlockUnits(NamedTuple):
    """Units of each block.

    starts: (N + 1,) int64, block n has rows starts[n] to starts[n + 1] of units.
    units: (S,) int64, those of each block from near to far.
    """

    starts: np.ndarray
    units: np.ndarray


class SensorRegion(NamedTuple):
    """A circle that contains all origins of rays, and the greatest range; metres."""

    x: float
    y: float
    radius: float
    max_range: float


@compiled()
def bound_motion(poses: np.ndarray, knots_s: np.ndarray) -> ActorMotion:
    """Return bounds of the motion of all actors."""
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
    return ActorMotion(poses, speeds, extents)


@compiled()
def bound_stances(shapes: Shapes, shears: np.ndarray, tilts: np.ndarray, uneven: bool) -> Stances:
    """Return how the units stand, with bounds over all knots."""
    bounds = np.zeros((len(shapes.unit_poses), 3))
    if uneven:
        for u in range(len(bounds)):
            actor = shapes.unit_poses[u]
            if actor == STILL:
                bounds[u, 0] = bounds[u, 1] = shears[u, 0]
                bounds[u, 2] = abs(shears[u, 1]) + abs(shears[u, 2])
                continue
            bounds[u, 0], bounds[u, 1] = np.inf, -np.inf
            for k in range(len(tilts)):
                bounds[u, 0] = min(bounds[u, 0], tilts[k, actor, 0])
                bounds[u, 1] = max(bounds[u, 1], tilts[k, actor, 0])
                slope = abs(tilts[k, actor, 1]) + abs(tilts[k, actor, 2])
                bounds[u, 2] = max(bounds[u, 2], slope)
    return Stances(uneven, shears, tilts, bounds)


@compiled()
def units_by_block(
    rays: RayColumns,
    blocks: Blocks,
    shapes: Shapes,
    motion: ActorMotion,
    stances: Stances,
    max_range_m: float,
) -> BlockUnits:
    """Return for each block a superset of the units that its rays can hit within the range."""
    x_low = y_low = np.inf
    x_high = y_high = -np.inf
    for c in range(len(rays.origins)):
        x_low, x_high = min(x_low, rays.origins[c, 0]), max(x_high, rays.origins[c, 0])
        y_low, y_high = min(y_low, rays.origins[c, 1]), max(y_high, rays.origins[c, 1])
    reach = np.sqrt((x_high - x_low) ** 2 + (y_high - y_low) ** 2)
    sensor = SensorRegion(0.5 * (x_low + x_high), 0.5 * (y_low + y_high), reach, max_range_m)
    steepest = max(abs(rays.slopes[0]), abs(rays.slopes[-1]))
    spans = np.empty((len(shapes.unit_poses), 4), np.int64)
    nearest = np.empty(len(shapes.unit_poses))
    ray_spread = _ray_spread(blocks, steepest)
    _find_spans(blocks, shapes, motion, stances.bounds, sensor, ray_spread, spans, nearest)
    return _fill(len(blocks.lows), stable_order(nearest), spans)


@compiled(borrowing=True)
def _ray_spread(blocks: Blocks, steepest: float) -> float:
    """Return the tangent of the largest horizontal angle between a ray and its column's `ahead`."""
    most = 0.0
    for n in range(len(blocks.horizontal_lengths)):
        lateral = steepest * blocks.horizontal_lengths[n, 1]
        shortest = blocks.horizontal_lengths[n, 0] - lateral
        if shortest <= 0.0:
            return np.inf
        most = max(most, lateral / shortest)
    return most


@compiled(borrowing=True)
def _find_spans(
    blocks: Blocks,
    shapes: Shapes,
    motion: ActorMotion,
    bounds: np.ndarray,
    sensor: SensorRegion,
    ray_spread: float,
    spans: np.ndarray,
    nearest: np.ndarray,
) -> None:
    """Write the least distance of each unit, and two half-open ranges of blocks that may hit it.

    The second range is empty unless the unit lies across the seam. ray_spread: of `_ray_spread`.
    """
    count = len(blocks.lows)
    for u in range(len(shapes.unit_poses)):
        actor = shapes.unit_poses[u]
        circles = shapes.unit_circles
        x, y, reach = circles[u, 0], circles[u, 1], circles[u, 2]
        if actor != STILL:
            reach += np.sqrt(x * x + y * y) + motion.extents[actor, 2]
            x, y = motion.extents[actor, 0], motion.extents[actor, 1]
            reach += bounds[u, 2] * shapes.unit_heights[u, 1]
        reach = (reach + sensor.radius) * (1.0 + SLACK)
        dx, dy = x - sensor.x, y - sensor.y
        distance = np.sqrt(dx * dx + dy * dy)
        nearest[u] = distance - reach
        spans[u, 0] = spans[u, 1] = spans[u, 2] = spans[u, 3] = 0
        if nearest[u] > sensor.max_range:
            continue
        spans[u, 1] = count
        wide = reach + (distance + reach) * ray_spread
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
    """Return the index of the first number that is not below the value."""
    low, high = 0, len(rising)
    while low < high:
        middle = (low + high) >> 1
        if rising[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@compiled()
def _fill(count: int, order: np.ndarray, spans: np.ndarray) -> BlockUnits:
    """Return the units of `count` blocks. order: (U,) units from near to far. spans: (U, 4)."""
    starts = np.zeros(count + 2, np.int64)
    for u in range(len(spans)):
        for n in range(spans[u, 0], spans[u, 1]):
            starts[n + 2] += 1
        for n in range(spans[u, 2], spans[u, 3]):
            starts[n + 2] += 1
    for n in range(1, len(starts)):
        starts[n] += starts[n - 1]
    units = np.empty(starts[-1], np.int64)
    for u in order:
        for n in range(spans[u, 0], spans[u, 1]):
            units[starts[n + 1]] = u
            starts[n + 1] += 1
        for n in range(spans[u, 2], spans[u, 3]):
            units[starts[n + 1]] = u
            starts[n + 1] += 1
    return BlockUnits(starts[:-1], units)
