"""How fast a sensor is whose first scans have just come: the speed at which things come together.

The majority does not decide: among lorries most returns move along with the sensor. Fixtures are
asked first: what is higher above the ground than any vehicle, or higher than any person and too
slim for a vehicle, as posts, trunks, lamps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from roadscope.core import LidarScan
from roadscope.odometry.inertial.beam_table import BeamTable
from roadscope.odometry.inertial.speed_kernels import count_apart, gathered, joined

SPEEDS_M_S = np.arange(-8.0, 50.0, 0.25)
CELL_M = 0.4
LOWEST_M, TALLEST_M = 0.4, 4.3
"""Above the ground: lower is the ground; no road user is taller."""
FARTHEST_M = 60.0
NEAR_M, GROUND_SHARE = 25.0, 0.05
"""The ground is the lowest share of what is so near."""
BESIDE_M_S = 2.0
"""Speeds closer than this support each other rather than compete."""
LEAST_TALL = 8
"""Ends of tall things, in a scan on average, from which they decide. A few are met where beams
leave the roof of a tunnel, and travel with the sensor."""
SLIM_M, PERSON_M = 0.6, 2.0
"""Vehicles that are so high are wider; people and riders are as slim, but not so high."""
FEW_SLIM, LEAST_SLIM, MANY_SLIM, APART_M = 2.0, 4.0, 10.0, 2.0
"""Slim things, in a scan on average, from which they guess, decide, and decide alone; nearer ones
count as one. Beside the sensor a piece of a lorry may be seen by itself."""
ROUGHLY_M_S = 0.3
"""Standard deviation of a speed that is told by cells."""
NEAR_FIXTURE_M = 0.1
"""How far apart the same fixture is met."""
FINE_S2_M_S, FINEST_M_S = 0.15, 0.1
"""A fine speed errs by so much over its weight, in tunnels as on roads; the body sways, besides."""
VAGUEST_M_S = 1.0
"""One that errs by more tells nothing."""


@dataclass(frozen=True, slots=True)
class Ends:
    """Where things end in a scan, and where slim ones are.

    points: (K, 2) metres as measured. times_s: (K,). upright, tall, slim: (K,) bool, whether it is
    an upright end, one of a tall thing, or the middle of a slim thing.
    """

    points: np.ndarray
    times_s: np.ndarray
    upright: np.ndarray
    tall: np.ndarray
    slim: np.ndarray

    @staticmethod
    def of(scan: LidarScan) -> Ends:
        """Find them."""
        points = scan.points
        if not len(points):
            return Ends(np.empty((0, 2)), np.empty(0), *np.empty((3, 0), bool))
        flat = np.hypot(points[:, 0], points[:, 1])
        near = (flat < NEAR_M) & (flat > 0)
        height_m = points[:, 2] - (np.quantile(points[near, 2], GROUND_SHARE) if near.any() else 0)
        usable = (flat < FARTHEST_M) & (flat > 1.5)
        table = BeamTable.of(points, scan.ring, scan.column)
        # Where no ground is seen, nothing is known to be taller than vehicles.
        grounded = usable & near.any()
        upright = table.ends() & usable & ((height_m > LOWEST_M) | ~near.any())
        free = table.slim(grounded & (height_m > PERSON_M), SLIM_M)
        kept = upright | free
        times = scan.stamp_s + scan.time_offset_s[kept].astype(np.float64)
        return Ends(points[kept, :2].astype(np.float64), times, upright[kept],
                    (upright & grounded & (height_m > TALLEST_M))[kept], free[kept])  # fmt: skip

    @property
    def slim_things(self) -> int:
        """Return how many slim things there are."""
        return int(count_apart(self.points[self.slim], APART_M))


@dataclass(frozen=True, slots=True)
class Speed:
    """The best speed ahead, m/s, and how many times as much it gathers as the best of others.

    by_fixtures: whether only things decided that no road user can be. spread_m_s: how far off it
    may be, one standard deviation.
    """

    ahead_m_s: float
    clarity: float
    by_fixtures: bool = False
    spread_m_s: float = ROUGHLY_M_S

    CLEAR: ClassVar = 1.25

    @staticmethod
    def told(ahead_m_s: float) -> Speed:
        """Return a speed that was not looked for but told."""
        return Speed(ahead_m_s, np.inf, by_fixtures=True)

    @property
    def clear(self) -> bool:
        """Whether no other speed comes close."""
        return self.clarity >= self.CLEAR

    @property
    def known(self) -> bool:
        """Whether it is to be believed: what is as low as vehicles may all move along."""
        return self.clear and self.by_fixtures and self.spread_m_s <= VAGUEST_M_S


def speed_of(scans: list[Ends], rate_rad_s: float) -> Speed:
    """Return the speed at which scans in a row agree; with the turn rate about the vertical.

    Where fixtures are too few to decide, they guess better than what may be traffic.
    """
    fixed = _fixed(scans)
    if fixed is not None:
        return _by_fixtures(scans, rate_rad_s, fixed)
    if _slim_things(scans) >= FEW_SLIM:
        guess = _by_fixtures(scans, rate_rad_s, [each.slim for each in scans])
        if guess.known:
            return replace(guess, by_fixtures=False)
    return _Looks.at(scans, rate_rad_s, [each.upright for each in scans]).roughly()


def standing_speed_of(scans: list[Ends], rate_rad_s: float) -> Speed:
    """Return the speed at which fixtures agree; not clear where there are too few."""
    fixed = _fixed(scans)
    return Speed(0.0, 0.0) if fixed is None else _by_fixtures(scans, rate_rad_s, fixed)


def _by_fixtures(scans: list[Ends], rate: float, fixed: list[np.ndarray]) -> Speed:
    looks = _Looks.at(scans, rate, fixed)
    found = replace(looks.roughly(), by_fixtures=True)
    return looks.finely(found) if found.clear else found


def _fixed(scans: list[Ends]) -> list[np.ndarray] | None:
    """Return which ends of each scan are of fixtures; None where there are too few."""
    things = _slim_things(scans)
    enough_tall = sum(int(each.tall.sum()) for each in scans) >= LEAST_TALL * len(scans)
    slim_counts = things >= LEAST_SLIM
    tall_counts = enough_tall and things < MANY_SLIM
    if not (tall_counts or slim_counts):
        return None
    return [each.tall & tall_counts | each.slim & slim_counts for each in scans]


def _slim_things(scans: list[Ends]) -> float:
    """Return how many there are in a scan, on average."""
    return sum(each.slim_things for each in scans) / max(len(scans), 1)


@dataclass(frozen=True, slots=True)
class _Looks:
    """Chosen ends of scans in a row.

    points: (N, 2) metres, turned as the sensor was at first. ahead: (N, 2) s, where they are moved
    by a speed, along the arc on which the sensor drives. scans: (N,) numbers.
    """

    points: np.ndarray
    ahead: np.ndarray
    scans: np.ndarray

    @staticmethod
    def at(scans: list[Ends], rate: float, chosen: list[np.ndarray]) -> _Looks:
        """Join them; rate: rad/s about the vertical."""
        points = np.concatenate([each.points[c] for each, c in zip(scans, chosen, strict=True)])
        times = np.concatenate([each.times_s[c] for each, c in zip(scans, chosen, strict=True)])
        number = np.concatenate([np.full(int(c.sum()), i) for i, c in enumerate(chosen)])
        times = times - times.min(initial=np.inf)
        angles = rate * times
        cosines, sines = np.cos(angles), np.sin(angles)
        turned = np.column_stack([
            cosines * points[:, 0] - sines * points[:, 1],
            sines * points[:, 0] + cosines * points[:, 1],
        ])  # fmt: skip
        half = times[:, None] * np.column_stack([np.cos(0.5 * angles), np.sin(0.5 * angles)])
        return _Looks(turned, half, number)

    def roughly(self) -> Speed:
        """Return the best speed by cells."""
        if len(self.points) < 2:
            return Speed(0.0, 0.0)
        scores = gathered(self.points, self.ahead, self.scans, SPEEDS_M_S, CELL_M)
        scores = scores - np.median(scores)
        best = int(scores.argmax())
        others = scores[np.abs(SPEEDS_M_S - SPEEDS_M_S[best]) > BESIDE_M_S]
        around = slice(max(best - 1, 0), best + 2)
        weights = np.maximum(scores[around], 0.0) + 1e-9
        middle = float(weights @ SPEEDS_M_S[around] / weights.sum())
        return Speed(middle, float(scores[best] / max(others.max(), 1.0)))

    def finely(self, rough: Speed) -> Speed:
        """Return the speed near a rough one at which the points themselves meet."""
        order = np.argsort(self.points[:, 1] + rough.ahead_m_s * self.ahead[:, 1])
        ahead_m_s, weight = joined(self.points[order], self.ahead[order], self.scans[order],
                                   rough.ahead_m_s, NEAR_FIXTURE_M)  # fmt: skip
        if not weight or abs(ahead_m_s - rough.ahead_m_s) > BESIDE_M_S:
            return rough
        spread_m_s = float(np.hypot(FINE_S2_M_S / weight, FINEST_M_S))
        return replace(rough, ahead_m_s=ahead_m_s, spread_m_s=spread_m_s)
