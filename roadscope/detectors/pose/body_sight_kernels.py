"""From the returns of a scan to the rays that tell of one body: compiled inner loops."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import EMPTY, HIT, PASSED, Rays

BESIDE = 4
"""Columns looked at beyond the first and the last return of each beam."""
BEAM = 10
"""Returns of one beam that are worth keeping; with more beams than fit the budget some are left."""
WIDEST = 4
"""Most neighbours that are joined: over so few columns a face is all but plane."""
LEAP_M, LEAP_SD = 0.15, 3.0
"""Neighbouring returns are not joined whose ranges differ by more than so many metres and so many
standard deviations of their noise."""
ROUGHNESS_M = 0.004
"""Departure of real surfaces from a drawn body, added to the range noise."""


class Returns(NamedTuple):
    """N returns of a scan: points (N, 3), metres, lidar frame; ring, column and intensity (N,)."""

    points: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    intensity: np.ndarray


class Beams(NamedTuple):
    """What a LiDAR is; the fields are those of a `LidarSpec`.

    elevations, firing_offsets_s: (B,). columns: of a turn, or of the sweep. sweep: azimuth of
    the first column and step, radians, and seconds of the sweep. limits: range noise and greatest
    range, metres, and detection limit.
    """

    elevations: np.ndarray
    firing_offsets_s: np.ndarray
    columns: int
    sweep: tuple[float, float, float]
    limits: tuple[float, float, float]


class Motion(NamedTuple):
    """Place and way of the sensor at the stamp.

    matrix: (4, 4) `world_from_lidar`. velocity: (2,) m/s, world frame. turn: rad/s. rolling: 1
    where columns are measured one after the other, 0 where all at the stamp.
    """

    matrix: np.ndarray
    velocity: np.ndarray
    turn: float
    rolling: float


class Grid(NamedTuple):
    """Rays by beam and column, beam after beam: what each brought, at which range; inf for none."""

    ring: np.ndarray
    column: np.ndarray
    reach: np.ndarray
    kind: np.ndarray


@compiled()
def returns_about(
    returns: Returns, ordered: tuple[np.ndarray, np.ndarray], rows: np.ndarray, turn: int
) -> tuple[Returns, np.ndarray]:
    """Return a body's returns and those that its beams met in its columns and beside them.

    ordered: (N,) rows by column, and the columns in that order. rows: (K,) of the body, K at
    least 1. turn: columns of a turn. The second is (M,) bool, which returns are the body's.
    """
    target, met = np.zeros(len(returns.ring), np.bool_), np.zeros(returns.ring.max() + 1, np.bool_)
    first, last = returns.column[rows[0]], returns.column[rows[0]]
    for i in rows:
        target[i], met[returns.ring[i]] = True, True
        first, last = min(first, returns.column[i]), max(last, returns.column[i])
    if last - first > turn // 2:
        turned = (returns.column[rows] + turn // 2) % turn
        first, last = turned.min() - turn // 2, turned.max() - turn // 2
    if last - first > turn // 2:
        return returns, target
    first, last = first - BESIDE, last + BESIDE
    order, columns = ordered
    kept, count = np.empty(len(order), np.int64), 0
    for low, high in ((first, last), (first + turn, turn - 1), (0, last - turn)):
        start, end = np.searchsorted(columns, max(low, 0)), np.searchsorted(columns, high + 1)
        for i in order[start:end]:
            if met[returns.ring[i]]:
                kept[count] = i
                count += 1
    kept = kept[:count]
    chosen = Returns(
        returns.points[kept], returns.ring[kept], returns.column[kept], returns.intensity[kept]
    )
    return chosen, target[kept]


@compiled()
def rays_about(
    returns: Returns,
    ordered: tuple[np.ndarray, np.ndarray],
    rows: np.ndarray,
    lidar: tuple[Beams, Motion],
    budget: int,
) -> tuple[Rays, int]:
    """Return the rays that tell of a body, and how many returns it sent back.

    rows: (K,) of the body, K at least 1; the rest as in `returns_about` and `joined`.
    """
    beams, motion = lidar
    near, target = returns_about(returns, ordered, rows, beams.columns)
    grid = picked(near, target, beams, budget)
    rays = rays_of(grid, beams, motion, (need_of(near, target, beams), ROUGHNESS_M))
    return joined(rays, grid, budget, ROUGHNESS_M), (grid.kind == HIT).sum()


@compiled()
def picked(returns: Returns, target: np.ndarray, beams: Beams, budget: int) -> Grid:
    """List the beams that met the body, from a little beside its first return to its last.

    target: (N,) bool, which returns are the body's.
    """
    rows = np.flatnonzero(target)
    if len(rows) == 0:
        none = np.empty(0, np.int64)
        return Grid(none, none, np.empty(0), none)
    turn = beams.columns
    start = _seam(returns.column, rows, turn)
    width = int(((returns.column[rows] - start) % turn).max()) + 1 + 2 * BESIDE
    cells = np.full((2, len(beams.elevations), width), np.inf)
    for i in range(len(target)):
        place = ((returns.column[i] - start) % turn + BESIDE) % turn
        if place < width:
            near = cells[0 if target[i] else 1, returns.ring[i]]
            near[place] = min(near[place], _range(returns.points[i]))
    return _listed(cells, start, turn, budget)


@compiled()
def _listed(cells: np.ndarray, start: int, turn: int, budget: int) -> Grid:
    """List the rays of cells (2, B, W): ranges of the body's returns and of the others."""
    hit = np.isfinite(cells[0])
    met, width = 0, cells.shape[2]
    for ring in range(len(hit)):
        met += hit[ring].any()
    every, seen, count = -(-met * BEAM // budget), 0, 0
    grid = Grid(
        np.empty(hit.size, np.int64), np.empty(hit.size, np.int64),
        np.empty(hit.size), np.empty(hit.size, np.int64),
    )  # fmt: skip
    for ring in range(len(hit)):
        found = np.flatnonzero(hit[ring])
        if len(found) == 0:
            continue
        seen += 1
        if (seen - 1) % every:
            continue
        for place in range(max(found[0] - BESIDE, 0), min(found[-1] + BESIDE + 1, width)):
            own, other = cells[0, ring, place], cells[1, ring, place]
            grid.ring[count], grid.column[count] = ring, (place - BESIDE + start) % turn
            grid.reach[count] = own if np.isfinite(own) else other
            grid.kind[count] = HIT if np.isfinite(own) else PASSED if np.isfinite(other) else EMPTY
            count += 1
    return Grid(grid.ring[:count], grid.column[:count], grid.reach[:count], grid.kind[:count])


@compiled()
def _seam(columns: np.ndarray, rows: np.ndarray, turn: int) -> int:
    """Return the first column of some returns when the gap around the turn is left out."""
    found = np.sort(columns[rows].astype(np.int64))
    start, widest = found[0], found[0] + turn - found[-1]
    for i in range(1, len(found)):
        # Of equal gaps the first counts, that around the turn last.
        gap = found[i] - found[i - 1]
        if gap > widest or (gap == widest and start == found[0] and gap > 0):
            start, widest = found[i], gap
    return int(start)


@compiled()
def _range(point: np.ndarray) -> float:
    x, y, z = np.float64(point[0]), np.float64(point[1]), np.float64(point[2])
    return math.sqrt(x * x + y * y + z * z)


@compiled()
def rays_of(grid: Grid, beams: Beams, motion: Motion, met: tuple[float, float]) -> Rays:
    """Return the rays of a grid in the world frame.

    met: what is met; need as in `Rays`, of all of them, and roughness, metres.
    """
    (need, rough_m), count, m = met, len(grid.ring), motion.matrix
    first, step, sweep_s = beams.sweep
    rays = Rays(
        np.empty((count, 3)), np.empty((count, 2)), np.empty(count), np.empty(count),
        grid.kind, np.empty(count), np.empty(count), np.full(count, need),
    )  # fmt: skip
    flats, rises = np.cos(beams.elevations), np.sin(beams.elevations)
    for i in range(count):
        ring, column = grid.ring[i], grid.column[i]
        time = sweep_s * (column / beams.columns - 0.5) + beams.firing_offsets_s[ring]
        time *= motion.rolling
        azimuth = first + step * column + motion.turn * time
        flat, up = flats[ring], rises[ring]
        x, y = flat * math.cos(azimuth), flat * math.sin(azimuth)
        u = x * m[0, 0] + y * m[0, 1] + up * m[0, 2]
        v = x * m[1, 0] + y * m[1, 1] + up * m[1, 2]
        w = x * m[2, 0] + y * m[2, 1] + up * m[2, 2]
        level = math.sqrt(u * u + v * v)
        rays.origin[i, 0] = m[0, 3] + motion.velocity[0] * time
        rays.origin[i, 1] = m[1, 3] + motion.velocity[1] * time
        rays.origin[i, 2] = m[2, 3]
        rays.direction[i, 0], rays.direction[i, 1] = u / level, v / level
        rays.slope[i], rays.reach[i] = w / level, grid.reach[i] * level
        noise = beams.limits[0] * level
        rays.sigma[i], rays.time[i] = math.sqrt(noise * noise + rough_m * rough_m), time
    return rays


@compiled()
def need_of(returns: Returns, target: np.ndarray, beams: Beams) -> float:
    """Return the cosine that a return needs at one metre, from the brightest return."""
    _, range_max_m, limit = beams.limits
    rows = np.flatnonzero(target)
    if len(rows) == 0 or limit == 0.0:
        return 0.0
    brightest = 0.05
    for i in rows:
        # The receiver makes up for the range squared in the far field alone.
        near = 4.0 * _range(returns.points[i]) / range_max_m
        brightest = max(brightest, returns.intensity[i] * (1.0 + near * near))
    return limit / (brightest * range_max_m * range_max_m)


@compiled()
def joined(rays: Rays, grid: Grid, budget: int, rough_m: float) -> Rays:
    """Average neighbours inside long runs of returns until few enough are left.

    Points of a plane have their mean in it. The two returns at either end of a run stay alone:
    they are the silhouette.
    """
    hits = (rays.kind == HIT).sum()
    if hits <= budget:
        return rays
    size, total = min(-(-hits // budget), WIDEST), len(rays.kind)
    starts, within, after = _runs(rays, grid)
    opens = starts | (within < 2) | (after < 2) | ((within - 2) % size == 0)
    rows = np.flatnonzero(opens)
    middle = (rays.kind[rows] == HIT) & (within[rows] >= 2) & (after[rows] >= 2)
    # What is still too much inside the runs is left out evenly; the ends stay.
    step, passed, count = max(-(-middle.sum() // budget), 1), 0, 0
    out = Rays(
        np.empty((len(rows), 3)), np.empty((len(rows), 2)), np.empty(len(rows)),
        np.empty(len(rows)), np.empty(len(rows), np.int64), np.empty(len(rows)),
        np.empty(len(rows)), np.empty(len(rows)),
    )  # fmt: skip
    for k in range(len(rows)):
        passed += middle[k]
        if middle[k] and passed % step:
            continue
        _mean(rays, rows[k], rows[k + 1] if k + 1 < len(rows) else total, (out, count), rough_m)
        count += 1
    return Rays(
        out.origin[:count], out.direction[:count], out.slope[:count], out.reach[:count],
        out.kind[:count], out.sigma[:count], out.time[:count], out.need[:count],
    )  # fmt: skip


@compiled()
def _runs(rays: Rays, grid: Grid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where runs of neighbouring returns begin, and places from their begin and end."""
    total = len(rays.kind)
    starts, within = np.ones(total, np.bool_), np.zeros(total, np.int64)
    after = np.zeros(total, np.int64)
    for i in range(1, total):
        both = rays.kind[i] == HIT and rays.kind[i - 1] == HIT
        beside = grid.ring[i] == grid.ring[i - 1] and abs(grid.column[i] - grid.column[i - 1]) == 1
        noise = math.sqrt(rays.sigma[i] ** 2 + rays.sigma[i - 1] ** 2)
        leap_m = max(LEAP_M, LEAP_SD * noise)
        starts[i] = not (both and beside and abs(rays.reach[i] - rays.reach[i - 1]) <= leap_m)
        within[i] = 0 if starts[i] else within[i - 1] + 1
    for i in range(total - 2, -1, -1):
        after[i] = 0 if starts[i + 1] else after[i + 1] + 1
    return starts, within, after


@compiled()
def _mean(rays: Rays, first: int, last: int, into: tuple[Rays, int], rough_m: float) -> None:
    """Write rays in a row into one row: to the mean of their ends, from the mean of their starts.

    A plane's points have their mean in the plane; at their mean direction the plane is nearer
    than the mean of its ranges says, by more than a millimetre where it is seen at a slant.
    """
    out, row = into
    count = last - first
    out.origin[row] = 0.0
    x = y = rise = time = 0.0
    for i in range(first, last):
        # What brought nothing stands alone, infinitely far.
        reach = rays.reach[i] if count > 1 else 1.0
        out.origin[row] += rays.origin[i] / count
        x += reach * rays.direction[i, 0] / count
        y += reach * rays.direction[i, 1] / count
        rise += reach * rays.slope[i] / count
        time += rays.time[i] / count
    away = math.hypot(x, y)
    out.direction[row, 0], out.direction[row, 1] = x / away, y / away
    out.slope[row], out.time[row] = rise / away, time
    out.reach[row] = away if count > 1 else rays.reach[first]
    rough = rough_m * rough_m
    out.sigma[row] = math.sqrt((rays.sigma[first] ** 2 - rough) / count + rough)
    out.kind[row], out.need[row] = rays.kind[first], rays.need[first]


@compiled()
def points_of(rays: Rays, velocity: np.ndarray) -> np.ndarray:
    """Return (N, 2) where a body's returns were at the reference time, going at (2,) m/s."""
    out, count = np.empty((len(rays.kind), 2)), 0
    for i in range(len(rays.kind)):
        if rays.kind[i] == HIT:
            for k in range(2):
                met = rays.origin[i, k] + rays.reach[i] * rays.direction[i, k]
                out[count, k] = met - rays.time[i] * velocity[k]
            count += 1
    return out[:count]
