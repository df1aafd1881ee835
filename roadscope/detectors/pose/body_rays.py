"""The rays of a scan that say something about one body: its returns and the rays beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.envs.sensors.lidar_spec import LidarSpec

HIT, PASSED, EMPTY = 0, 1, 2
"""A return of the body, a return of something else, no return."""
BUDGET = 320
"""Returns above which neighbours are joined, unless another number is asked for."""
BESIDE = 4
"""Columns beyond the first and the last return of each beam whose rays are used."""
ENOUGH_OF_A_BEAM = 10
"""Returns of one beam that are worth keeping; with more beams than fit the budget some are left."""
MOST_JOINED = 4
"""Most neighbours that are joined: over so few columns a face is all but plane."""
STEP_M, STEP_SD = 0.15, 3.0
"""Neighbours whose ranges differ by more than so many metres and so many standard deviations of
their noise are not joined."""
ROUGHNESS_M = 0.004
"""Departure of real surfaces from a drawn body, added to the range noise; chosen by hand."""
LEAST_BRIGHTNESS = 0.05
"""Intensity of the darkest body."""
SEAM_COLUMNS = 3
"""Columns at either end of a sweep: a body there may have been measured in part."""


class BodyRays(NamedTuple):
    """M rays.

    origin: (M, 3) metres, world frame, z above the road. direction: (M, 2) unit vectors.
    slope: (M,) rise per horizontal metre. reach: (M,) horizontal metres to the return, inf for
    none. kind: (M,) int64, `HIT`, `PASSED` or `EMPTY`. sigma: (M,) metres, of the reach.
    time: (M,) seconds from the reference time. need: (M,) cosine of incidence that a surface
    needs to send a return at one metre; it grows with the range squared.
    """

    origin: np.ndarray
    direction: np.ndarray
    slope: np.ndarray
    reach: np.ndarray
    kind: np.ndarray
    sigma: np.ndarray
    time: np.ndarray
    need: np.ndarray

    def rows(self, index: np.ndarray | slice) -> BodyRays:
        """Return some of the rays."""
        return BodyRays(*(np.ascontiguousarray(column[index]) for column in self))

    def thinned(self, most: int) -> BodyRays:
        """Return at most so many rays, evenly chosen."""
        return self.rows(slice(None, None, -(-len(self.slope) // most) or 1))

    def points(self, velocity: np.ndarray) -> np.ndarray:
        """Return where the body's returns (N, 2) were at the reference time, world frame.

        velocity: (2,) of the body, metres per second.
        """
        hits = self.rows(self.kind == HIT)
        ends = hits.origin[:, :2] + hits.reach[:, None] * hits.direction
        return np.asarray(ends - hits.time[:, None] * velocity)


class Returns(NamedTuple):
    """N returns: points (N, 3), metres, lidar frame; ring, column and intensity (N,)."""

    points: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    intensity: np.ndarray


class SensorMotion(NamedTuple):
    """Where the sensor was at the stamp and how it moved.

    world_from_lidar: (4, 4), z = 0 on the road. velocity: (2,) m/s, world frame. turn_rate: rad/s
    about its z axis. rolling: whether the columns were measured one after the other.
    """

    world_from_lidar: np.ndarray
    velocity: np.ndarray
    turn_rate: float = 0.0
    rolling: bool = True


@dataclass(frozen=True, slots=True)
class BodyScan:
    """What one scan says about one body.

    rays: times in seconds from the scan's stamp.
    origin: (2,) of the sensor, metres, world frame. returns: how many the body sent back.
    cut: whether the sweep begins or ends on the body, so that only a part may have been measured.
    """

    rays: BodyRays
    origin: np.ndarray
    returns: int
    cut: bool

    @property
    def points(self) -> np.ndarray:
        """(N, 2) returns of the body seen from above, metres, world frame."""
        return self.rays.points(np.zeros(2))

    @property
    def times(self) -> np.ndarray:
        """(N,) when the returns of the body were measured, seconds from the stamp."""
        return self.rays.time[self.rays.kind == HIT]


def body_scan(
    spec: LidarSpec,
    scan: LidarScan,
    target: np.ndarray,
    world_from_lidar: Pose,
    *,
    sensor_velocity: np.ndarray | None = None,
    sensor_turn: float = 0.0,
    rolling: bool = True,
    budget: int = BUDGET,
    rough_m: float = ROUGHNESS_M,
) -> BodyScan:
    """Return the rays of a scan that say something about a body.

    target: (N,) bool, which returns of the scan are the body's. world_from_lidar: at the stamp,
    z = 0 on the road. sensor_velocity: (2,) metres per second, world frame; sensor_turn: radians
    per second about its z axis. rolling: whether columns were measured one after the other, as a
    real sweep is, or all at the stamp.
    budget: returns above which neighbours are joined. rough_m: departure of the body's surface
    from the drawn one, metres.
    Of several returns of one ray the nearest counts, so duplicates and order change nothing.
    """
    target = np.asarray(target)
    if target.shape != (len(scan),) or target.dtype != np.bool_:
        raise ValueError(
            f"target must be one bool for each of the {len(scan)} returns, got "
            f"{target.dtype} {target.shape}"
        )
    velocity = np.zeros(2) if sensor_velocity is None else sensor_velocity
    velocity = checked_velocity("sensor_velocity", velocity)
    motion = SensorMotion(world_from_lidar.matrix, velocity, float(sensor_turn), rolling)
    returns = Returns(scan.points, scan.ring, scan.column, scan.intensity)
    return body_scan_of(spec, returns, target, motion, budget=budget, rough_m=rough_m)


def body_scan_of(
    spec: LidarSpec,
    returns: Returns,
    target: np.ndarray,
    motion: SensorMotion,
    *,
    budget: int = BUDGET,
    rough_m: float = ROUGHNESS_M,
) -> BodyScan:
    """Return what `body_scan` does from returns that need not be all of a scan."""
    grid, brightest = _grid(spec, returns, target, budget)
    rays = _rays(spec, grid, motion, rough_m)
    need = spec.detection_limit / (brightest * spec.range_max_m**2)
    rays = rays._replace(need=np.full(len(grid.ring), need))
    column = returns.column[target]
    is_at_seam = (column < SEAM_COLUMNS) | (column >= spec.columns - SEAM_COLUMNS)
    return BodyScan(
        _joined(rays, grid, budget, rough_m),
        motion.world_from_lidar[:2, 3].copy(),
        int((grid.kind == HIT).sum()),
        motion.rolling and bool(is_at_seam.any()),
    )


def checked_velocity(name: str, velocity: np.ndarray) -> np.ndarray:
    """Return a (2,) float64 velocity, m/s; ValueError when it is no finite one."""
    checked = np.ascontiguousarray(velocity, dtype=np.float64)
    if checked.shape != (2,) or not np.isfinite(checked).all():
        raise ValueError(f"{name} must be finite x and y in metres per second, got {velocity!r}")
    return checked


class _Grid(NamedTuple):
    """Rays, beam after beam: ring, column, range in metres (inf without a return) and kind."""

    ring: np.ndarray
    column: np.ndarray
    range_m: np.ndarray
    kind: np.ndarray


def _grid(
    spec: LidarSpec, returns: Returns, target: np.ndarray, budget: int
) -> tuple[_Grid, float]:
    """Return the rays of the beams that met the body, from beside its first return to its last.

    The second is the intensity of its brightest return, as it would be in the far field.
    """
    if not target.any():
        none = np.empty(0, np.int64)
        return _Grid(none, none, np.empty(0), none), LEAST_BRIGHTNESS
    # Columns are counted from the end of the widest gap between the body's columns.
    own = np.unique(returns.column[target]).astype(np.int64)
    gaps = np.diff(own, append=own[0] + spec.columns)
    start = np.roll(own, -1)[np.argmax(gaps)] - BESIDE
    width = spec.columns - gaps.max() + 1 + 2 * BESIDE
    place = (returns.column - start) % spec.columns
    rows = np.flatnonzero(place < width)
    ranges = np.linalg.norm(returns.points[rows].astype(np.float64), axis=1)
    # The receiver makes up for the range squared in the far field alone.
    near = 4.0 * ranges / spec.range_max_m
    bright = returns.intensity[rows] * (1.0 + near * near) * target[rows]
    cells = np.full((2, spec.beams, width), np.inf)
    np.minimum.at(cells, (1 - target[rows], returns.ring[rows], place[rows]), ranges)
    is_own = np.isfinite(cells[0])
    rings = np.flatnonzero(is_own.any(axis=1))
    rings = rings[:: -(-len(rings) * ENOUGH_OF_A_BEAM // budget)]
    first = is_own[rings].argmax(axis=1)[:, None]
    last = width - 1 - is_own[rings, ::-1].argmax(axis=1)[:, None]
    places = np.arange(width)
    near, at = np.nonzero((places >= first - BESIDE) & (places <= last + BESIDE))
    own_m, other_m = cells[0, rings[near], at], cells[1, rings[near], at]
    kind = np.where(np.isfinite(own_m), HIT, np.where(np.isfinite(other_m), PASSED, EMPTY))
    range_m = np.where(kind == HIT, own_m, other_m)
    grid = _Grid(rings[near], (at + start) % spec.columns, range_m, kind)
    return grid, max(LEAST_BRIGHTNESS, float(bright.max()))


def _rays(spec: LidarSpec, grid: _Grid, motion: SensorMotion, rough_m: float) -> BodyRays:
    """Return the rays of a grid in the world frame; they need no light."""
    time = spec.sweep_s * (grid.column / spec.columns - 0.5) + spec.firing_offsets_s[grid.ring]
    time = time * float(motion.rolling)
    azimuth = spec.azimuth_start + spec.azimuth_span / spec.columns * grid.column
    azimuth = azimuth + motion.turn_rate * time
    elevation = spec.elevations[grid.ring]
    flat = np.cos(elevation)
    lidar = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=1)
    world = lidar @ motion.world_from_lidar[:3, :3].T
    level = np.hypot(world[:, 0], world[:, 1])
    origin = np.tile(motion.world_from_lidar[:3, 3], (len(time), 1))
    origin[:, :2] += time[:, None] * motion.velocity
    return BodyRays(
        origin,
        world[:, :2] / level[:, None],
        world[:, 2] / level,
        grid.range_m * level,
        grid.kind,
        np.hypot(spec.range_noise_m * level, rough_m),
        time,
        np.zeros(len(time)),
    )


def _joined(rays: BodyRays, grid: _Grid, budget: int, rough_m: float) -> BodyRays:
    """Return the rays, neighbours inside long runs of returns averaged until few enough are left.

    Points of a plane have their mean in it. The two returns at either end of a run stay alone:
    they are the silhouette.
    """
    is_hit = rays.kind == HIT
    if is_hit.sum() <= budget:
        return rays
    size = min(-(-int(is_hit.sum()) // budget), MOST_JOINED)
    step_m = np.maximum(STEP_M, STEP_SD * np.hypot(rays.sigma[1:], rays.sigma[:-1]))
    with np.errstate(invalid="ignore"):
        is_near = np.abs(np.diff(rays.reach)) <= step_m
    continues = is_hit[1:] & is_hit[:-1] & is_near & (np.diff(grid.ring) == 0)
    begins = np.append(True, ~(continues & (np.abs(np.diff(grid.column)) == 1)))
    place, firsts = np.arange(len(begins)), np.flatnonzero(begins)
    run = np.cumsum(begins) - 1
    from_begin, to_end = place - firsts[run], np.append(firsts, len(begins))[run + 1] - 1 - place
    is_middle = is_hit & (from_begin >= 2) & (to_end >= 2)
    group_begins = np.flatnonzero(~is_middle | ((from_begin - 2) % size == 0))
    counts = np.diff(np.append(group_begins, len(begins)))
    means = _means(rays, group_begins, counts, rough_m)
    # What is still too much inside the runs is left out evenly; the ends stay.
    in_middle = is_middle[group_begins]
    every = max(-(-int(in_middle.sum()) // budget), 1)
    return means.rows(~in_middle | (np.cumsum(in_middle) % every == 0))


def _means(rays: BodyRays, begins: np.ndarray, counts: np.ndarray, rough_m: float) -> BodyRays:
    """Return one ray for each group: to the mean of its ends from the mean of its starts.

    begins: (G,) first row of each group. counts: (G,) rows of each group.
    At their mean direction a plane is nearer than the mean of its ranges says, by more than a
    millimetre where it is seen at a slant.
    """
    is_alone = counts == 1

    def mean(values: np.ndarray) -> np.ndarray:
        sums = np.add.reduceat(values, begins, axis=0)
        return np.asarray(sums / counts.reshape(-1, *[1] * (values.ndim - 1)))

    # A ray without a return is alone in its group, and infinitely long.
    length = np.where(np.repeat(is_alone, counts), 1.0, rays.reach)
    end = mean(length[:, None] * rays.direction)
    away = np.hypot(end[:, 0], end[:, 1])
    noise = (rays.sigma[begins] ** 2 - rough_m**2) / counts
    return BodyRays(
        mean(rays.origin),
        end / away[:, None],
        mean(length * rays.slope) / away,
        np.where(is_alone, rays.reach[begins], away),
        rays.kind[begins],
        np.sqrt(noise + rough_m**2),
        mean(rays.time),
        rays.need[begins],
    )
