"""Which candidates of successive scans are one vehicle, and how large it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.core import Category, Pose
from roadscope.core.jit import compiled
from roadscope.detectors.moving.extraction import Candidate
from roadscope.detectors.shape.bodies import BODIES, Body

# --------------------------------------------------------------------------------------------------
# Where a vehicle is seen from the drive's frame, and how it goes: compiled inner loops.

TURNS = np.radians(np.arange(-24.0, 25.0, 4.0))
"""By which a body may stand askew to the way that it goes."""


@compiled()
def brought(
    points: np.ndarray, origin: np.ndarray, matrix: np.ndarray, face_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (N, 3), sensor (2,) and mark (2,) in the frame that (4, 4) leads to.

    points (N, 3), N at least 1, origin (2,): metres. The mark is the mean of what lies no deeper
    than `face_m` behind the point nearest along the line of sight.
    """
    out, count = np.empty((len(points), 3)), len(points)
    mx, my = 0.0, 0.0
    for i in range(count):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            out[i, k] = x * matrix[k, 0] + y * matrix[k, 1] + z * matrix[k, 2] + matrix[k, 3]
        mx, my = mx + out[i, 0], my + out[i, 1]
    place = np.empty(2)
    for k in range(2):
        place[k] = origin[0] * matrix[k, 0] + origin[1] * matrix[k, 1] + matrix[k, 3]
    sx, sy = mx / count - place[0], my / count - place[1]
    away = max(np.hypot(sx, sy), 1e-9)
    depths, nearest = np.empty(count), np.inf
    for i in range(count):
        depths[i] = ((out[i, 0] - place[0]) * sx + (out[i, 1] - place[1]) * sy) / away
        nearest = min(nearest, depths[i])
    mark, held = np.zeros(2), 0
    for i in range(count):
        if depths[i] <= nearest + face_m:
            mark[0], mark[1], held = mark[0] + out[i, 0], mark[1] + out[i, 1], held + 1
    return out, place, mark / held


@compiled()
def rate(times: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Return the (2,) slope of marks (K, 2) over times (K,) by least squares, 0 of one."""
    middle, spread, slope = times.mean(), 0.0, np.zeros(2)
    for k in range(len(times)):
        off = times[k] - middle
        spread += off * off
        slope += off * marks[k]
    return slope / spread if spread > 0.0 else np.zeros(2)


@compiled()
def unsteady(times: np.ndarray, marks: np.ndarray, velocity: np.ndarray) -> float:
    """Root mean square distance of marks (K, 2) from even motion with a (2,) velocity."""
    middle, x, y = times.mean(), marks[:, 0].mean(), marks[:, 1].mean()
    total = 0.0
    for k in range(len(times)):
        dx = marks[k, 0] - x - (times[k] - middle) * velocity[0]
        dy = marks[k, 1] - y - (times[k] - middle) * velocity[1]
        total += dx * dx + dy * dy
    return float(np.sqrt(total / len(times)))


@compiled()
def roomy(
    points: np.ndarray,
    times_s: np.ndarray,
    starts: np.ndarray,
    chains: np.ndarray,
    velocities: np.ndarray,
    rules: tuple[np.ndarray, int, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Return which body has room for what is seen of each chain, (C,), and its length, (C,) metres.

    points: (N, 3) metres, and times_s (N,), seconds, of all sightings; starts: (S + 1,) where each
    of these begins, chains: (C + 1,) where the sightings of each chain begin; velocities: (C, 2)
    m/s. rules: length, width and height (B, 3) that there is room for; how many of the first count
    only for what is higher than the last number, metres. The last has room for all.
    """
    bounds, riders, rider_m = rules
    count = len(chains) - 1
    kinds, along = np.empty(count, np.int64), np.empty(count)
    for c in range(count):
        first, last = chains[c], chains[c + 1]
        seen = np.empty((last - first, 3))
        for k in range(first, last):
            part = slice(starts[k], starts[k + 1])
            seen[k - first] = spans(points[part], times_s[part], velocities[c])
        along[c], across = np.median(seen[:, 0]), np.median(seen[:, 1])
        top = seen[:, 2].max()
        body = 0 if top > rider_m else riders
        while body < len(bounds) - 1 and (
            along[c] > bounds[body, 0] or across > bounds[body, 1] or top > bounds[body, 2]
        ):
            body += 1
        kinds[c] = body
    return kinds, along


@compiled()
def spans(
    points: np.ndarray, times_s: np.ndarray, velocity: np.ndarray
) -> tuple[float, float, float]:
    """Return how far (N, 3) points reach along and across a body that goes that way, and up.

    Each point is carried back by its time (N,), seconds, with a (2,) velocity.
    """
    towards = math.atan2(velocity[1], velocity[0])
    least, along, across = np.inf, 0.0, 0.0
    places = np.empty((2, len(points)))
    for i in range(len(points)):
        places[0, i] = points[i, 0] - times_s[i] * velocity[0]
        places[1, i] = points[i, 1] - times_s[i] * velocity[1]
    for turn in TURNS:
        long, wide = _extents(places[0], places[1], np.cos(towards + turn), np.sin(towards + turn))
        if long * wide < least:
            along, across, least = long, wide, long * wide
    return along, across, points[:, 2].max()


# Places are finite, and the sign of a nought does not matter: several at a time.
@compiled(borrowing=True, fastmath={"nnan", "nsz"})
def _extents(x: np.ndarray, y: np.ndarray, cos: float, sin: float) -> tuple[float, float]:
    """Return how far places reach along a unit vector and across it."""
    low, high, right, left = np.inf, -np.inf, np.inf, -np.inf
    for i in range(len(x)):
        u, v = cos * x[i] + sin * y[i], cos * y[i] - sin * x[i]
        low, high = u if u < low else low, u if u > high else high
        right, left = v if v < right else right, v if v > left else left
    return high - low, left - right


# --------------------------------------------------------------------------------------------------
# Which candidates of successive scans are one vehicle.

KEPT = 4
"""Sightings of a vehicle that are remembered."""
MISSED = 2
"""Scans in a row without the vehicle after which it is forgotten."""
FASTEST_M_S = 45.0
NEAR_M = 2.0
"""How far from where it was expected a vehicle may be met: its visible part changes."""
FACE_M = 1.0
"""Depth of the part nearest to the sensor whose mean stands for the vehicle."""
SLOWEST_M_S = 1.5
"""What moves less than this has come into view rather than moved."""
SURE = 3
"""Sightings from which a speed says something."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A candidate in the drive's frame, which stays put while the ego moves.

    stamp_s: of its scan. met_s: when the vehicle was met within the sweep.
    points: (N, 3) metres. origin: (2,) metres, the sensor then. mark: (2,) metres, what the
        vehicle is followed by.
    """

    stamp_s: float
    met_s: float
    points: np.ndarray
    origin: np.ndarray
    mark: np.ndarray
    candidate: Candidate

    def at_stamp(self, velocity: np.ndarray, most: int) -> np.ndarray:
        """Return at most so many points, (N, 2), where they were at the stamp.

        velocity: (2,) m/s, of the body. One across the seam of a sweep is met at its beginning
        and at its end.
        """
        step = -(-len(self.points) // most)
        moved = self.candidate.times_s[::step, None] * velocity
        points: np.ndarray = self.points[::step, :2] - moved
        return points

    @staticmethod
    def of(candidate: Candidate, stamp_s: float, drive_from_ego: Pose) -> Sighting:
        """Bring a candidate into the drive's frame."""
        points, origin, mark = brought(
            candidate.points, candidate.origin, drive_from_ego.matrix, FACE_M
        )
        return Sighting(stamp_s, stamp_s + candidate.time_s, points, origin, mark, candidate)


class Chain:
    """One vehicle as it was seen lately.

    sightings: oldest first. count: of all of them, with those that are forgotten. times: (K,)
    seconds, when it was met in each, marks: (K, 2) metres, where. velocity: (2,) m/s; all in the
    drive's frame; zero after one sighting.
    """

    def __init__(self) -> None:
        self.sightings: list[Sighting] = []
        self.count = 0
        self.times, self.marks, self.velocity = np.empty(0), np.empty((0, 2)), np.zeros(2)

    def add(self, sighting: Sighting) -> None:
        """Append a sighting and forget the oldest beyond `KEPT`."""
        self.sightings = [*self.sightings, sighting][-KEPT:]
        self.count += 1
        self.times = np.array([s.met_s for s in self.sightings])
        self.marks = np.array([s.mark for s in self.sightings])
        self.velocity = np.asarray(rate(self.times, self.marks))

    @property
    def moves(self) -> bool:
        """Whether it was seen again and, as far as that can be told, elsewhere."""
        if len(self.sightings) < SURE:
            return len(self.sightings) > 1
        return math.hypot(*self.velocity.tolist()) >= SLOWEST_M_S


class Links:
    """Follows candidates from scan to scan, each to the nearest of where it is expected."""

    def __init__(self) -> None:
        self.chains: list[Chain] = []

    def update(self, stamp_s: float, found: Sequence[Candidate], drive_from_ego: Pose) -> None:
        """Take the candidates of the next scan in."""
        sightings = [Sighting.of(candidate, stamp_s, drive_from_ego) for candidate in found]
        free_chains, free = list(range(len(self.chains))), list(range(len(sightings)))
        for _, row, column in sorted(self._pairs(sightings)):
            if row in free_chains and column in free:
                self.chains[row].add(sightings[column])
                free_chains.remove(row)
                free.remove(column)
        stamps = sorted({s.stamp_s for c in self.chains for s in c.sightings} | {stamp_s})
        oldest_s = stamps[-min(len(stamps), MISSED + 1)]
        kept = [c for c in self.chains if c.sightings[-1].stamp_s >= oldest_s]
        self.chains = kept + [_begun(sightings[column]) for column in free]

    def _pairs(self, sightings: Sequence[Sighting]) -> list[tuple[float, int, int]]:
        """Return distance over gate, chain and sighting of all pairs that can be one vehicle."""
        if not sightings or not self.chains:
            return []
        met_s = np.array([sighting.met_s for sighting in sightings])
        marks = np.array([sighting.mark for sighting in sightings])
        last_s = np.array([chain.times[-1] for chain in self.chains])
        last = np.array([chain.marks[-1] for chain in self.chains])
        velocities = np.array([chain.velocity for chain in self.chains])
        known = np.array([len(chain.sightings) > 1 for chain in self.chains])
        elapsed_s = met_s - last_s[:, None]
        off = marks - (last[:, None] + elapsed_s[..., None] * velocities[:, None])
        apart = np.hypot(off[..., 0], off[..., 1])
        gate = np.where(known[:, None], NEAR_M, FASTEST_M_S * elapsed_s)
        rows, columns = np.nonzero(apart <= gate)
        shares = apart[rows, columns] / gate[rows, columns]
        return list(zip(shares.tolist(), rows.tolist(), columns.tolist(), strict=True))


def _begun(sighting: Sighting) -> Chain:
    chain = Chain()
    chain.add(sighting)
    return chain


# --------------------------------------------------------------------------------------------------
# How large a vehicle is taken to be of which a part is seen.

VEHICLES = (Category.CAR, Category.VAN, Category.TRUCK)
"""Buses go as trucks: what tells them apart is their height, and roofs are often above the beams.
"""
TWO_WHEELERS = [b for b in BODIES if b.category is Category.MOTORCYCLE]
TRIED = TWO_WHEELERS + [b for b in BODIES if b.category in VEHICLES]
ROOM_M = np.array(
    [[mean + 2 * spread for mean, spread in (b.length, b.width, b.height)] for b in TRIED]
)
"""(B, 3) length, width and height that a body of each kind hardly exceeds."""
RIDER_M = 1.3
"""Height that a rider reaches and a corner of a car does not."""

Size = tuple[float, float, float]


def usual(chains: Sequence[Chain]) -> list[tuple[Body, Size]]:
    """Return the first usual body that has room for what is seen of each, and its size.

    Two-wheelers come first, and are told by their rider: as narrow a part of a car is low.
    """
    sightings = [s for chain in chains for s in chain.sightings]
    if not sightings:
        return []
    kinds, along = roomy(
        np.concatenate([s.points for s in sightings]),
        np.concatenate([s.candidate.times_s for s in sightings]),
        np.cumsum([0, *(len(s.points) for s in sightings)]),
        np.cumsum([0, *(len(chain.sightings) for chain in chains)]),
        np.array([chain.velocity for chain in chains]),
        (ROOM_M, len(TWO_WHEELERS), RIDER_M),
    )
    bodies = [TRIED[kind] for kind in kinds.tolist()]
    lengths = [max(b.length[0], a) for b, a in zip(bodies, along.tolist(), strict=True)]
    return [
        (b, (length, b.width[0], b.height[0])) for b, length in zip(bodies, lengths, strict=True)
    ]
