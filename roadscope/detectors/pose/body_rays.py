"""The rays of a scan that tell about one body: those of its returns, and rays beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.envs.sensors.lidar_spec import LidarSpec

HIT, PASSED, EMPTY = 0, 1, 2
"""Kinds of rays: with a return from the body, with a return from something else, without a
return."""
BUDGET = 400
"""Default of `body_scan`: so many returns inside long runs of neighbours are used."""
BESIDE = 4
"""Columns beyond the first and the last return of each beam whose rays are used."""
ROUGHNESS_M = 0.004
"""Departure of real surfaces from a body model, added to the range noise; chosen by hand."""
LEAST_BRIGHTNESS = 0.05
"""Intensity of the darkest body."""
SEAM_COLUMNS = 3
"""Columns at either end of a sweep; a body in them may have been measured only in part."""
SEAM_S = 0.05
"""A sweep measures a body within this time, unless the seam of the sweep goes through the body."""


class BodyRays(NamedTuple):
    """M rays.

    origin: (M, 3) metres, world frame, z above the road. direction: (M, 2) unit vectors.
    slope: (M,) rise per horizontal metre. reach: (M,) horizontal metres to the return, inf for
    none. kind: (M,) int64, `HIT`, `PASSED` or `EMPTY`. sigma: (M,) metres, noise of the reach.
    time: (M,) seconds from the reference time. need: (M,) least cosine of incidence at which the
    body would send a return from a range of one metre; it grows with the range squared.
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
        """Return at most `most` rays, evenly chosen, those at the silhouette first."""
        changes = np.diff(self.kind == HIT, prepend=False, append=False)
        is_edge = changes[1:] | changes[:-1]
        edges, others = np.flatnonzero(is_edge), np.flatnonzero(~is_edge)
        edges = edges[:: -(-len(edges) // max(most - most // 4, 1)) or 1]
        others = others[:: -(-len(others) // max(most - len(edges), 1)) or 1]
        return self.rows(np.sort(np.append(edges, others)))

    def points(self, velocity: np.ndarray) -> np.ndarray:
        """Return where the body's returns (N, 2) were at the reference time, world frame.

        velocity: (2,) of the body, metres per second.
        """
        hits = self.rows(self.kind == HIT)
        ends = hits.origin[:, :2] + hits.reach[:, None] * hits.direction
        return np.asarray(ends - hits.time[:, None] * velocity)


@dataclass(frozen=True, slots=True)
class BodyScan:
    """What one scan tells about one body.

    rays: with times in seconds from the scan's stamp.
    origin: (2,) of the sensor, metres, world frame. returns: number of the body's returns.
    cut: whether the sweep begins or ends on the body, so that only a part may have been measured.
    """

    rays: BodyRays
    origin: np.ndarray
    returns: int
    cut: bool

    @property
    def times(self) -> np.ndarray:
        """(N,) times at which the returns of the body were measured, seconds from the stamp."""
        return np.asarray(self.rays.time[self.rays.kind == HIT])

    @property
    def is_split(self) -> bool:
        """Whether the body was measured when the sweep began and again when it ended."""
        times = self.times
        return bool(np.ptp(times) > SEAM_S) if len(times) else False


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
    """Return the rays of a scan that tell about a body.

    target: (N,) bool, whether each return of the scan is from the body.
    world_from_lidar: at the stamp; z = 0 is the road.
    sensor_velocity: (2,) metres per second, world frame. sensor_turn: radians per second about its
        z axis.
    rolling: whether columns were measured one after the other, as in a real sweep, or all at the
        stamp.
    budget: most returns inside long runs of neighbours; if there are more, they are thinned out.
    rough_m: departure of the body's surface from its model, metres.

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
    ring, column, range_m, kind = _grid(spec, scan, target, budget)
    time = spec.sweep_s * (column / spec.columns - 0.5) + spec.firing_offsets_s[ring]
    time = time * float(rolling)
    azimuth = spec.azimuth_start + spec.azimuth_span / spec.columns * column + sensor_turn * time
    flat, up = np.cos(spec.elevations[ring]), np.sin(spec.elevations[ring])
    lidar = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up], axis=1)
    world = lidar @ world_from_lidar.matrix[:3, :3].T
    level = np.hypot(world[:, 0], world[:, 1])
    origin = np.tile(world_from_lidar.translation, (len(time), 1))
    origin[:, :2] += time[:, None] * velocity
    rays = BodyRays(
        origin,
        world[:, :2] / level[:, None],
        world[:, 2] / level,
        range_m * level,
        kind,
        np.hypot(spec.range_noise_m * level, rough_m),
        time,
        np.full(len(time), _need(spec, scan, target)),
    )
    own = scan.column[target]
    is_cut = rolling and bool(((own < SEAM_COLUMNS) | (own >= spec.columns - SEAM_COLUMNS)).any())
    hits = int((kind == HIT).sum())
    return BodyScan(rays, world_from_lidar.translation[:2].copy(), hits, is_cut)


def checked_velocity(name: str, velocity: np.ndarray) -> np.ndarray:
    """Return a velocity as (2,) float64, m/s; `ValueError` unless it is finite x and y."""
    checked = np.ascontiguousarray(velocity, dtype=np.float64)
    if checked.shape != (2,) or not np.isfinite(checked).all():
        raise ValueError(f"{name} must be finite x and y in metres per second, got {velocity!r}")
    return checked


def _grid(
    spec: LidarSpec, scan: LidarScan, target: np.ndarray, budget: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return ring, column, range in metres (inf for none) and kind of the rays, beam after beam.

    They are rays of the beams with a return from the body, from `BESIDE` columns before the first
    such return to `BESIDE` columns behind the last.
    """
    if not target.any():
        none = np.empty(0, np.int64)
        return none, none, np.empty(0), none
    # Columns are counted from the end of the widest gap between the body's columns.
    own = np.unique(scan.column[target]).astype(np.int64)
    gaps = np.diff(own, append=own[0] + spec.columns)
    start = np.roll(own, -1)[np.argmax(gaps)] - BESIDE
    width = spec.columns - gaps.max() + 1 + 2 * BESIDE
    place = (scan.column - start) % spec.columns
    rows = np.flatnonzero(place < width)
    cells = np.full((2, spec.beams, width), np.inf)
    at = 1 - target[rows], scan.ring[rows], place[rows]
    np.minimum.at(cells, at, np.linalg.norm(scan.points[rows].astype(np.float64), axis=1))
    is_own = np.isfinite(cells[0])
    rings, places = np.flatnonzero(is_own.any(axis=1)), np.arange(width)
    first = is_own[rings].argmax(axis=1)[:, None]
    last = width - 1 - is_own[rings, ::-1].argmax(axis=1)[:, None]
    near, column = np.nonzero((places >= first - BESIDE) & (places <= last + BESIDE))
    # Inside long runs of returns some are left out; two at either end are the silhouette.
    is_hit = is_own[rings[near], column]
    is_end = np.pad(~is_hit | (np.diff(near, prepend=-1) != 0), 2, constant_values=True)
    is_inside = ~np.lib.stride_tricks.sliding_window_view(is_end, 5).any(axis=1)
    share = min(1.0, budget / max(int(is_inside.sum()), 1))
    keep = ~is_inside | (np.diff(np.floor(share * np.cumsum(is_inside)), prepend=0.0) > 0)
    ring, column = rings[near[keep]], column[keep]
    own_m, other_m = cells[0, ring, column], cells[1, ring, column]
    kind = np.where(np.isfinite(own_m), HIT, np.where(np.isfinite(other_m), PASSED, EMPTY))
    range_m = np.where(kind == HIT, own_m, other_m)
    return ring, (column + start) % spec.columns, range_m, kind


def _need(spec: LidarSpec, scan: LidarScan, target: np.ndarray) -> float:
    """Return `BodyRays.need`, from the body's brightest return."""
    ranges = np.linalg.norm(scan.points[target].astype(np.float64), axis=1)
    # The receiver compensates for the range squared only in the far field.
    near = 4.0 * ranges / spec.range_max_m
    bright = scan.intensity[target] * (1.0 + near * near)
    brightest = max(LEAST_BRIGHTNESS, float(bright.max(initial=0.0)))
    return float(spec.detection_limit / (brightest * spec.range_max_m**2))
