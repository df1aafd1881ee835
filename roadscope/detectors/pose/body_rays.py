"""The rays of a scan that tell of one body: its returns, and the rays that passed beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.detectors.pose.body_kernels import EMPTY, HIT, PASSED, Rays
from roadscope.envs.sensors.lidar_spec import LidarSpec

BESIDE = 4
"""Columns looked at beyond the first and the last return of each beam."""
BUDGET = 160
"""Returns above which neighbours are joined, unless said otherwise."""
BEAM = 10
"""Returns of one beam that are worth keeping; with more beams than fit the budget some are left."""
WIDEST = 4
"""Most neighbours that are joined: a plane's range is nearly linear over so few columns."""
LEAP_M = 0.15
"""Neighbouring returns whose ranges differ by more are not joined."""
ROUGHNESS_M = 0.004
"""Departure of real surfaces from a drawn body, added to the range noise."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """What one scan tells of one body.

    rays: times in seconds from the scan's stamp.
    origin: (2,) of the sensor, metres, world frame. returns: how many the body sent back.
    """

    rays: Rays
    origin: np.ndarray
    returns: int

    @property
    def points(self) -> np.ndarray:
        """(N, 2) returns of the body seen from above, metres, world frame."""
        hits = self.rays.kind == HIT
        ways = self.rays.reach[hits, None] * self.rays.direction[hits]
        points: np.ndarray = self.rays.origin[hits, :2] + ways
        return points


def sight(
    spec: LidarSpec,
    scan: LidarScan,
    target: np.ndarray,
    world_from_lidar: Pose,
    *,
    sensor_velocity: np.ndarray | None = None,
    sensor_turn: float = 0.0,
    rolling: bool = True,
    budget: int = BUDGET,
) -> Sighting:
    """Pick out the rays that tell of a body.

    target: (N,) bool, which returns of the scan are the body's. world_from_lidar: at the stamp,
    z = 0 on the road. sensor_velocity: (2,) metres per second, world frame; sensor_turn: radians
    per second about its z axis. rolling: whether columns were measured one after the other, as a
    real sweep is, or all at the stamp.
    budget: returns above which neighbours are joined.
    Of several returns of one ray the nearest counts, so duplicates and order change nothing.
    """
    target = np.asarray(target)
    if target.shape != (len(scan),) or target.dtype != np.bool_:
        raise ValueError(
            f"target must be one bool for each of the {len(scan)} returns, got "
            f"{target.dtype} {target.shape}"
        )
    grid = _grid(spec, scan, target, budget)
    offsets = spec.column_offsets_s()[grid.column] + spec.firing_offsets_s[grid.ring]
    offsets *= rolling
    directions = _directions(spec, grid, sensor_turn * offsets, world_from_lidar)
    level = np.hypot(directions[:, 0], directions[:, 1])
    velocity = np.zeros(2) if sensor_velocity is None else np.asarray(sensor_velocity, float)
    origin = np.tile(world_from_lidar.translation, (len(level), 1))
    origin[:, :2] += velocity * offsets[:, None]
    rays = Rays(
        origin,
        directions[:, :2] / level[:, None],
        directions[:, 2] / level,
        grid.reach * level,
        grid.kind,
        np.hypot(spec.range_noise_m * level, ROUGHNESS_M),
        offsets,
        np.full(len(level), _need(spec, scan, target)),
    )
    rays = _joined(rays, grid.ring, grid.column, budget)
    hits = int((grid.kind == HIT).sum())
    return Sighting(rays, world_from_lidar.translation[:2].copy(), hits)


@dataclass(frozen=True, slots=True)
class _Grid:
    """Rays by beam and column: kind and range of what each brought, inf for nothing."""

    ring: np.ndarray
    column: np.ndarray
    reach: np.ndarray
    kind: np.ndarray


def _grid(spec: LidarSpec, scan: LidarScan, target: np.ndarray, budget: int) -> _Grid:
    """List the beams that met the body, from a little beside its first return to its last."""
    if not target.any():
        none = np.empty(0, np.int64)
        return _Grid(none, none, np.empty(0), none)
    columns = scan.column.astype(np.int64)
    start = _seam(columns[target], spec.columns)
    place = (columns - start) % spec.columns
    width = int(place[target].max()) + 1 + 2 * BESIDE
    place = (place + BESIDE) % spec.columns
    near = place < width
    cells = np.full((2, spec.beams, width), np.inf)
    for i, chosen in enumerate((near & target, near & ~target)):
        ranges = np.linalg.norm(scan.points[chosen].astype(np.float64), axis=1)
        np.minimum.at(cells[i], (scan.ring[chosen], place[chosen]), ranges)
    hit = np.isfinite(cells[0])
    beside = _dilated(hit)
    beams = np.flatnonzero(hit.any(axis=1))
    kept = beams[:: -(-len(beams) * BEAM // budget)]
    beside[np.setdiff1d(beams, kept)] = False
    rings, places = np.nonzero(beside)
    own, other = cells[0][beside], cells[1][beside]
    kind = np.where(np.isfinite(own), HIT, np.where(np.isfinite(other), PASSED, EMPTY))
    reach = np.where(kind == HIT, own, other)
    return _Grid(rings, (places - BESIDE + start) % spec.columns, reach, kind.astype(np.int64))


def _seam(columns: np.ndarray, count: int) -> int:
    """Return the first column of the returns when the gap around the turn is left out."""
    found = np.unique(columns)
    gaps = np.diff(found, append=found[0] + count)
    return int(found[(np.argmax(gaps) + 1) % len(found)])


def _dilated(hit: np.ndarray) -> np.ndarray:
    """Mark in each row the cells from a little before its first to a little after its last."""
    places = np.arange(hit.shape[1])
    some = hit.any(axis=1)
    first = np.where(some, hit.argmax(axis=1), hit.shape[1] + BESIDE)
    last = hit.shape[1] - 1 - hit[:, ::-1].argmax(axis=1)
    mask: np.ndarray = (places >= first[:, None] - BESIDE) & (places <= last[:, None] + BESIDE)
    return mask


def _directions(
    spec: LidarSpec, grid: _Grid, turned: np.ndarray, world_from_lidar: Pose
) -> np.ndarray:
    azimuth, elevation = spec.azimuths()[grid.column] + turned, spec.elevations[grid.ring]
    flat = np.cos(elevation)
    ways = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    return Pose.from_parts(world_from_lidar.rotation, np.zeros(3)).apply(ways)


def _joined(rays: Rays, ring: np.ndarray, column: np.ndarray, budget: int) -> Rays:
    """Average neighbours inside long runs of returns until few enough are left.

    A plane's range is nearly linear over a few columns, so its mean lies on the mean direction.
    The two returns at either end of a run stay alone: they are the silhouette.
    """
    hits = int((rays.kind == HIT).sum())
    if hits <= budget:
        return rays
    size = min(-(-hits // budget), WIDEST)
    breaks = np.ones(len(ring), bool)
    breaks[1:] = (np.diff(ring) != 0) | (np.abs(np.diff(column)) != 1)
    with np.errstate(invalid="ignore"):
        breaks[1:] |= (rays.kind[1:] != HIT) | (rays.kind[:-1] != HIT)
        breaks[1:] |= np.abs(np.diff(rays.reach)) > LEAP_M
    starts = np.flatnonzero(breaks)
    lengths = np.diff(starts, append=len(ring))
    within = np.arange(len(ring)) - np.repeat(starts, lengths)
    after = np.repeat(lengths, lengths) - within - 1
    opens = breaks | (within < 2) | (after < 2) | ((within - 2) % size == 0)
    rows = np.flatnonzero(opens)
    counts = np.diff(rows, append=len(ring))
    # What is still too much inside the runs is left out evenly; the ends stay.
    middle = (rays.kind[rows] == HIT) & (within[rows] >= 2) & (after[rows] >= 2)
    step = max(-(-int(middle.sum()) // budget), 1)
    kept = ~middle | (np.cumsum(middle) % step == 0)
    sigma = np.sqrt((rays.sigma[rows] ** 2 - ROUGHNESS_M**2) / counts + ROUGHNESS_M**2)

    def mean(values: np.ndarray) -> np.ndarray:
        sums = np.add.reduceat(values, rows, axis=0)
        return sums / (counts[:, None] if values.ndim == 2 else counts)

    direction = mean(rays.direction)
    direction /= np.hypot(direction[:, 0], direction[:, 1])[:, None]
    joined = Rays(
        mean(rays.origin), direction, mean(rays.slope), mean(rays.reach), rays.kind[rows], sigma,
        mean(rays.time), rays.need[rows],
    )  # fmt: skip
    return Rays(*(values[kept] for values in joined))


def _need(spec: LidarSpec, scan: LidarScan, target: np.ndarray) -> float:
    """Return the cosine that a return needs at one metre, from the brightest return."""
    if not target.any() or spec.detection_limit == 0:
        return 0.0
    ranges = np.linalg.norm(scan.points[target].astype(np.float64), axis=1)
    # The receiver makes up for the range squared in the far field alone.
    signal = scan.intensity[target] * (1 + (4 * ranges / spec.range_max_m) ** 2)
    brightest = float(signal.max())
    return float(spec.detection_limit / (max(brightest, 0.05) * spec.range_max_m**2))
