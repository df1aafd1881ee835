"""Links candidates of successive scans to vehicles, and estimates the vehicles' sizes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

import numpy as np

from roadscope.core import Category, Pose
from roadscope.core.jit import compiled
from roadscope.detectors.moving.extraction import Candidate
from roadscope.detectors.shape.bodies import BODIES, Body

# --------------------------------------------------------------------------------------------------
# Which candidates of successive scans are one vehicle.

MOST_SIGHTINGS = 4
"""Most sightings of a vehicle that are stored; the oldest ones are dropped. Chosen by hand."""
MOST_MISSED = 2
"""A vehicle that is missed in more scans in a row than this is dropped. Chosen by hand."""
FASTEST_M_S = 45.0
"""Gate of a vehicle with one sighting: it has moved at most at this speed. Chosen by hand."""
NEAR_M = 2.0
"""Gate around the predicted position of a vehicle: its visible part changes. Chosen by hand."""
FACE_M = 1.0
"""A vehicle's position is the mean of its returns down to this depth behind the nearest one. Chosen
by hand."""
SLOWEST_M_S = 1.5
"""An object slower than this does not move: a new part of it has become visible. Chosen by hand."""
LEAST_SIGHTINGS = 3
"""Least number of sightings with which the speed is used. Chosen by hand."""


@compiled()
def in_drive_frame(
    points: np.ndarray, origin: np.ndarray, drive_from_ego: np.ndarray, face_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (N, 3), sensor (2,) and position (2,) of a vehicle in the drive's frame.

    points: (N, 3), N at least 1, metres, ego frame. origin: (2,) metres, ego frame, the sensor.
    drive_from_ego: (4, 4). The position is the mean of the points that lie at most `face_m` behind
    the nearest one along the line of sight.
    """
    m = drive_from_ego
    out, count = np.empty((len(points), 3)), len(points)
    mx, my = 0.0, 0.0
    for i in range(count):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            out[i, k] = x * m[k, 0] + y * m[k, 1] + z * m[k, 2] + m[k, 3]
        mx, my = mx + out[i, 0], my + out[i, 1]
    sensor = np.empty(2)
    for k in range(2):
        sensor[k] = origin[0] * m[k, 0] + origin[1] * m[k, 1] + m[k, 3]
    sx, sy = mx / count - sensor[0], my / count - sensor[1]
    distance = max(np.hypot(sx, sy), 1e-9)
    depths, nearest = np.empty(count), np.inf
    for i in range(count):
        depths[i] = ((out[i, 0] - sensor[0]) * sx + (out[i, 1] - sensor[1]) * sy) / distance
        nearest = min(nearest, depths[i])
    position, at_face = np.zeros(2), 0
    for i in range(count):
        if depths[i] <= nearest + face_m:
            position[0] += out[i, 0]
            position[1] += out[i, 1]
            at_face += 1
    return out, sensor, position / at_face


def rate(times: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Return the velocity (2,) of positions (K, 2) at times (K,) by least squares; 0 if K is 1."""
    off = times - times.mean()
    spread = (off * off).sum()
    slope: np.ndarray = (off[:, None] * positions).sum(axis=0)
    return slope / spread if spread > 0.0 else np.zeros(2)


def unsteady(times: np.ndarray, positions: np.ndarray, velocity: np.ndarray) -> float:
    """Return the root mean square distance of positions (K, 2) from motion at a velocity (2,)."""
    middle, (x, y) = times.mean(), positions.mean(axis=0)
    dx = positions[:, 0] - x - (times - middle) * velocity[0]
    dy = positions[:, 1] - y - (times - middle) * velocity[1]
    return math.sqrt((dx * dx + dy * dy).sum() / len(times))


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A candidate in the drive's frame, which does not move with the ego.

    stamp_s: of its scan. measured_s: when the sweep measured the vehicle.
    points: (N, 3) metres. origin: (2,) metres, the sensor at that time. position: (2,) metres, of
        the vehicle, see `FACE_M`.
    """

    stamp_s: float
    measured_s: float
    points: np.ndarray
    origin: np.ndarray
    position: np.ndarray
    candidate: Candidate

    def at_stamp(self, velocity: np.ndarray, most: int) -> np.ndarray:
        """Return at most `most` points, (N, 2), moved to where they were at the stamp.

        velocity: (2,) m/s, of the body. Without this, a body that is measured when the sweep begins
        and again when it ends would have two parts in different positions.
        """
        step = -(-len(self.points) // most)
        moved = self.candidate.times_s[::step, None] * velocity
        points: np.ndarray = self.points[::step, :2] - moved
        return points

    @staticmethod
    def of(candidate: Candidate, stamp_s: float, drive_from_ego: Pose) -> Sighting:
        """Return a candidate in the drive's frame."""
        points, origin, position = in_drive_frame(
            candidate.points, candidate.origin, drive_from_ego.matrix, FACE_M
        )
        return Sighting(stamp_s, stamp_s + candidate.time_s, points, origin, position, candidate)


class Chain:
    """The latest sightings of one vehicle.

    sightings: oldest first. count: how many there were, dropped ones included. times: (K,) seconds,
    when each was measured. positions: (K, 2) metres. velocity: (2,) m/s, zero after one sighting.
    All are in the drive's frame, which is fixed to the road.
    """

    def __init__(self) -> None:
        self.sightings: list[Sighting] = []
        self.count = 0
        self.times, self.positions, self.velocity = np.empty(0), np.empty((0, 2)), np.zeros(2)

    def add(self, sighting: Sighting) -> None:
        """Append a sighting and drop the oldest beyond `MOST_SIGHTINGS`."""
        self.sightings = [*self.sightings, sighting][-MOST_SIGHTINGS:]
        self.count += 1
        self.times = np.array([s.measured_s for s in self.sightings])
        self.positions = np.array([s.position for s in self.sightings])
        self.velocity = rate(self.times, self.positions)

    @property
    def moves(self) -> bool:
        """Whether it is fast; below `LEAST_SIGHTINGS`, whether there are several sightings."""
        if len(self.sightings) < LEAST_SIGHTINGS:
            return len(self.sightings) > 1
        return math.hypot(*self.velocity.tolist()) >= SLOWEST_M_S


class Links:
    """Links the candidates of successive scans to vehicles, each to the nearest prediction."""

    def __init__(self) -> None:
        self.chains: list[Chain] = []

    def update(self, stamp_s: float, candidates: Sequence[Candidate], drive_from_ego: Pose) -> None:
        """Link the candidates of the next scan to the chains; the others begin new chains."""
        sightings = [Sighting.of(candidate, stamp_s, drive_from_ego) for candidate in candidates]
        free_chains, free = list(range(len(self.chains))), list(range(len(sightings)))
        for _, row, column in sorted(self._pairs(sightings)):
            if row in free_chains and column in free:
                self.chains[row].add(sightings[column])
                free_chains.remove(row)
                free.remove(column)
        stamps = sorted({s.stamp_s for c in self.chains for s in c.sightings} | {stamp_s})
        oldest_s = stamps[-min(len(stamps), MOST_MISSED + 1)]
        recent = [c for c in self.chains if c.sightings[-1].stamp_s >= oldest_s]
        self.chains = recent + [_new_chain(sightings[column]) for column in free]

    def _pairs(self, sightings: Sequence[Sighting]) -> list[tuple[float, int, int]]:
        """Return all pairs inside the gate: distance over gate, chain, sighting."""
        if not sightings or not self.chains:
            return []
        measured_s = np.array([sighting.measured_s for sighting in sightings])
        positions = np.array([sighting.position for sighting in sightings])
        last_s = np.array([chain.times[-1] for chain in self.chains])
        last = np.array([chain.positions[-1] for chain in self.chains])
        velocities = np.array([chain.velocity for chain in self.chains])
        known = np.array([len(chain.sightings) > 1 for chain in self.chains])
        elapsed_s = measured_s - last_s[:, None]
        off = positions - (last[:, None] + elapsed_s[..., None] * velocities[:, None])
        distances = np.hypot(off[..., 0], off[..., 1])
        gate = np.where(known[:, None], NEAR_M, FASTEST_M_S * elapsed_s)
        rows, columns = np.nonzero(distances <= gate)
        shares = distances[rows, columns] / gate[rows, columns]
        return list(zip(shares.tolist(), rows.tolist(), columns.tolist(), strict=True))


def _new_chain(sighting: Sighting) -> Chain:
    chain = Chain()
    chain.add(sighting)
    return chain


# --------------------------------------------------------------------------------------------------
# The size of a vehicle of which a part is visible.

VEHICLES = (Category.CAR, Category.VAN, Category.TRUCK)
"""Buses count as trucks: they differ in height, and roofs are often above the beams."""
TWO_WHEELERS = [b for b in BODIES if b.category is Category.MOTORCYCLE]
TRIED = TWO_WHEELERS + [b for b in BODIES if b.category in VEHICLES]
LIMITS_M = np.array(
    [[mean + 2 * spread for mean, spread in (b.length, b.width, b.height)] for b in TRIED]
)
"""(B, 3) length, width and height, two standard deviations above the means of each kind of body."""
RIDER_M = 1.3
"""A rider on a two-wheeler is higher than this, a corner of a car lower. Chosen by hand."""
OFFSETS = np.radians(np.arange(-24.0, 25.0, 4.0))
"""Angles between a body's heading and its direction of motion that are tried, radians."""


class BodySize(NamedTuple):
    """Length, width and height, metres."""

    length: float
    width: float
    height: float


def usual(chains: Sequence[Chain]) -> list[tuple[Body, BodySize]]:
    """Return for each chain the first kind of body in `TRIED` that holds its returns, and its size.

    Two-wheelers come first, but only for returns as high as a rider: a part of a car that is as
    narrow is lower.
    """
    if not any(chain.sightings for chain in chains):
        return []
    extents = iter(_extents(chains).tolist())
    bodies = []
    for chain in chains:
        own = [next(extents) for _ in chain.sightings]
        long, wide = (median(extent[axis] for extent in own) for axis in range(2))
        top = max(extent[2] for extent in own)
        fits: np.ndarray = np.all(np.array([long, wide, top]) <= LIMITS_M, axis=1)
        fits[: len(TWO_WHEELERS)] &= top > RIDER_M
        # Returns that no body holds count as the last one.
        body = TRIED[int(fits.argmax()) if fits.any() else -1]
        size = BodySize(max(body.length[0], long), body.width[0], body.height[0])
        bodies.append((body, size))
    return bodies


def _extents(chains: Sequence[Chain]) -> np.ndarray:
    """Return the extents of the returns of all sightings, (S, 3) metres: along, across, highest z.

    The returns are moved to the stamp with the chain's velocity. The heading is the one near the
    direction of motion that gives the least rectangle.
    """
    sightings = [(s, chain.velocity.tolist()) for chain in chains for s in chain.sightings]
    counts = [len(s.points) for s, _ in sightings]
    starts = np.cumsum([0, *counts[:-1]])
    x, y, z = np.concatenate([s.points for s, _ in sightings]).T
    times_s = np.concatenate([s.candidate.times_s for s, _ in sightings])
    velocity_x, velocity_y = np.repeat([v for _, v in sightings], counts, axis=0).T
    x, y = x - times_s * velocity_x, y - times_s * velocity_y
    towards = [math.atan2(v_y, v_x) for _, (v_x, v_y) in sightings]
    cos, sin = (
        np.repeat([[f(yaw + turn) for yaw in towards] for turn in OFFSETS.tolist()], counts, axis=1)
        for f in (math.cos, math.sin)
    )
    long, wide = (
        np.maximum.reduceat(v, starts, axis=1) - np.minimum.reduceat(v, starts, axis=1)
        for v in (cos * x + sin * y, cos * y - sin * x)
    )
    best, all_rows = (long * wide).argmin(axis=0), np.arange(len(sightings))
    top = np.maximum.reduceat(z, starts)
    return np.stack([long[best, all_rows], wide[best, all_rows], top], axis=1)
