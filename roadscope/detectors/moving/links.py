"""Which candidates of successive scans are one vehicle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.core import Pose
from roadscope.detectors.moving.extraction import Candidate
from roadscope.detectors.moving.link_kernels import brought, rate

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
