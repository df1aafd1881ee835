"""The speed of a sensor from its first scans: at that speed, static objects coincide."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from roadscope.core import LidarScan
from roadscope.core.jit import compiled
from roadscope.odometry.cubes import EMPTY, Index, slot_of

# --------------------------------------------------------------------------------------------------
# Ends of objects in a scan, and slim objects.

JUMP_M, JUMP_SHARE = 0.4, 0.02
"""A neighbouring beam that is farther by this distance and share of range misses the object."""
UPRIGHT = 2
"""Greatest shift in columns of an upright end from ring to ring."""
WIDEST_GAP = 32
"""Greatest number of columns from return to return that may be the sensor's own step."""
SAMPLED = 8
"""The angle of one in this number of pairs of neighbours is measured."""
OUTSIDE = -1.0
"""Range of a beam outside the sensor's field of view."""


@compiled()
def nearest(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, rings: int, columns: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the range of the nearest return of each beam, and its row in `points`.

    Both have the shape (rings, columns): metres, 0 without a return, and int64, -1 without one.
    """
    reach, number = np.zeros((rings, columns)), np.full((rings, columns), -1, np.int64)
    for n in range(len(points)):
        x, y, z = points[n]
        here, r, c = np.sqrt(x * x + y * y + z * z), ring[n], column[n]
        if here > 0.0 and (number[r, c] < 0 or here < reach[r, c]):
            reach[r, c], number[r, c] = here, n
    return reach, number


@compiled()
def spacing(points: np.ndarray, number: np.ndarray) -> tuple[int, float]:
    """Return columns from beam to beam, and radians from column to column; 0 of both if unknown.

    Columns may be finer than the sensor's own steps: then many are empty.
    """
    counts, angle_counts = np.zeros(WIDEST_GAP + 1, np.int64), np.zeros(WIDEST_GAP + 1, np.int64)
    angles = np.zeros(WIDEST_GAP + 1)
    for r in range(number.shape[0]):
        last = -1
        for c in range(number.shape[1]):
            if number[r, c] < 0:
                continue
            gap = c - last
            if last >= 0 and gap <= WIDEST_GAP:
                if counts[gap] % SAMPLED == 0:
                    one, other = points[number[r, last]], points[number[r, c]]
                    cross = one[0] * other[1] - one[1] * other[0]
                    angles[gap] += abs(np.arctan2(cross, one[0] * other[0] + one[1] * other[1]))
                    angle_counts[gap] += 1
                counts[gap] += 1
            last = c
    half, gap = counts.sum() / 2, 0
    while gap < WIDEST_GAP and counts[: gap + 1].sum() < max(half, 1):
        gap += 1
    return (gap, angles[gap] / (angle_counts[gap] * gap)) if angle_counts[gap] else (0, 0.0)


@compiled()
def _beside(reach: np.ndarray, r: Index, c: Index, closed: bool) -> float:
    """Return the range of a beam whose column may be beyond the first or the last."""
    columns = reach.shape[1]
    if not closed and not 0 <= c < columns:
        return OUTSIDE
    far: float = reach[r, c % columns]
    return far


@compiled()
def ends(reach: np.ndarray, ring: np.ndarray, column: np.ndarray, closed: bool) -> np.ndarray:
    """Return (N,) whether an object ends at a return, to the left or the right.

    closed: whether the last column is beside the first. Walls of tunnels and the ground have no
    ends: their returns lie where the beams point and move with the sensor.
    """
    rings, columns = reach.shape
    edges = np.zeros((rings, columns), np.bool_)
    for r in range(rings):
        for c in range(columns):
            here = reach[r, c]
            if not 0.0 < here < np.inf:
                continue
            least = here * (1.0 + JUMP_SHARE) + JUMP_M
            for side in (-1, 1):
                near = False
                for d in range(1, 3):
                    there = _beside(reach, r, c + side * d, closed)
                    near |= there == OUTSIDE or 0.0 < there < least
                edges[r, c] |= not near
    marks = np.zeros(len(ring), np.bool_)
    for n in range(len(ring)):
        r, c = ring[n], column[n]
        marks[n] = edges[r, c] and (
            _upright(edges, reach, r, c, -1) or _upright(edges, reach, r, c, 1)
        )
    return marks


@compiled()
def _upright(edges: np.ndarray, reach: np.ndarray, r: Index, c: Index, up: int) -> bool:
    """Return whether the ring above or below ends at the same object in nearly the same direction.

    Beams that leave a wall over its top do so one after the other, at places that move with the
    sensor.
    """
    if not 0 <= r + up < reach.shape[0]:
        return False
    here = reach[r, c]
    for d in range(-UPRIGHT, UPRIGHT + 1):
        k = (c + d) % reach.shape[1]
        if edges[r + up, k] and abs(reach[r + up, k] - here) < JUMP_M + JUMP_SHARE * here:
            return True
    return False


@compiled()
def slim(
    reach: np.ndarray,
    ring: np.ndarray,
    column: np.ndarray,
    candidates: np.ndarray,
    closed: bool,
    widest_columns: float,
) -> np.ndarray:
    """Return (N,) whether a candidate, (N,) bool, is the middle of a slim object.

    It is at most `widest_columns` wide at a range of 1 m, and beams on both sides are farther.
    Partly hidden objects, and those at the edge of the field of view, are not slim.
    """
    marks = np.zeros(len(ring), np.bool_)
    for n in range(len(ring)):
        here = reach[ring[n], column[n]]
        if not candidates[n] or not 0.0 < here < np.inf:
            continue
        most = max(int(widest_columns / here), 1)
        left = _columns_to_the_side(reach, ring[n], column[n], -1, most, closed)
        right = _columns_to_the_side(reach, ring[n], column[n], 1, most, closed)
        marks[n] = right >= 0 and 0 <= left - right <= 1 and left + right < most
    return marks


@compiled()
def _columns_to_the_side(
    reach: np.ndarray, r: Index, c: Index, side: int, most: int, closed: bool
) -> int:
    """Return the number of further columns on the same object to one side; -1 if it does not end.

    most: greatest number. An object ends where two beams in a row are farther: one may have no
    return.
    """
    here = reach[r, c]
    margin = here * JUMP_SHARE + JUMP_M
    same, missed = 0, 0
    for d in range(1, most + 3):
        there = _beside(reach, r, c + side * d, closed)
        if there == OUTSIDE or 0.0 < there < here - margin:
            return -1
        if 0.0 < there < here + margin:
            same, missed = d, 0
            continue
        missed += 1
        if missed == 2:
            return same
    return -1


# --------------------------------------------------------------------------------------------------
# Ranges of a scan by ring and column.

WHOLE = 0.97
"""Share of a turn from which the first column counts as beside the last."""


@dataclass(frozen=True, slots=True)
class BeamTable:
    """Returns by ring and column; of two in one cell the nearer one counts.

    reach: (rings, columns) metres, 0 without a return. ring, column: (N,) of each return. first:
    (N,) bool, whether it is the one that counts. step_rad: from column to column, 0 if unknown.
    """

    reach: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    first: np.ndarray
    step_rad: float

    @staticmethod
    def of(points: np.ndarray, ring: np.ndarray, column: np.ndarray) -> BeamTable:
        """Return the table of N points; columns finer than the sensor's steps are joined."""
        rings, columns = int(ring.max()) + 1, int(column.max()) + 1
        reach, number = nearest(points, ring, column, rings, columns)
        gap, step_rad = spacing(points, number)
        if gap > 1:
            column, step_rad = column // gap, step_rad * gap
            reach, number = nearest(points, ring, column, rings, (columns - 1) // gap + 1)
        first = number[ring, column] == np.arange(len(ring))
        return BeamTable(reach, ring, column, first, step_rad)

    @property
    def closed(self) -> bool:
        """Whether the field of view is a full turn."""
        return bool(self.reach.shape[1] * self.step_rad >= WHOLE * 2 * np.pi)

    def ends(self) -> np.ndarray:
        """Return (N,) whether returns are upright ends of objects."""
        marks: np.ndarray = ends(self.reach, self.ring, self.column, self.closed) & self.first
        return marks

    def slim(self, candidates: np.ndarray, widest_m: float) -> np.ndarray:
        """Return (N,) whether candidates are middles of objects of at most that width."""
        if not self.step_rad:
            return np.zeros(len(candidates), bool)
        marks: np.ndarray = slim(
            self.reach,
            self.ring,
            self.column,
            candidates & self.first,
            self.closed,
            widest_m / self.step_rad,
        )
        return marks


# --------------------------------------------------------------------------------------------------
# How well ends of objects in several scans coincide at a speed.

STEPS, REACH = 6, 3.0
"""Number of Gauss-Newton steps, and standard deviations beyond which a pair does not count."""


@compiled()
def gathered(
    points: np.ndarray, ahead: np.ndarray, scans: np.ndarray, speeds: np.ndarray, cell_m: float
) -> np.ndarray:
    """Return (V,) the number of pairs of different scans in one cell of the ground plane, by speed.

    points: (N, 2) metres, turned as the sensor was at first. ahead: (N, 2) s, where they are moved
    by a speed. scans: (N,) which of the scans, fewer than 32. speeds: (V,) m/s ahead.
    """
    slots = 1024
    while slots < 2 * len(points):
        slots *= 2
    scores = np.zeros(len(speeds))
    keys, scan_bits = np.full(slots, EMPTY), np.zeros(slots, np.int64)
    cells, taken = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    for s in range(len(speeds)):
        for n in range(len(points)):
            x, y = points[n, 0] + speeds[s] * ahead[n, 0], points[n, 1] + speeds[s] * ahead[n, 1]
            i, j = np.int32(np.floor(x / cell_m)), np.int32(np.floor(y / cell_m))
            cells[n] = (1 << 62) + np.int64(i) * (1 << 32) + j
        size = 0
        for n in range(len(points)):
            slot = slot_of(keys, cells[n])
            taken[size] = slot
            size += keys[slot] == EMPTY
            keys[slot] = cells[n]
            scan_bits[slot] |= 1 << scans[n]
        pairs = 0
        for k in range(size):
            bits, count = scan_bits[taken[k]], 0
            while bits:
                bits &= bits - 1
                count += 1
            pairs += count * (count - 1) // 2
            keys[taken[k]], scan_bits[taken[k]] = EMPTY, 0
        scores[s] = pairs
    return scores


@compiled()
def joined(
    points: np.ndarray, ahead: np.ndarray, scans: np.ndarray, speed: float, near_m: float
) -> tuple[float, float]:
    """Return the speed near another at which points of different scans meet best, and its weight.

    As `gathered`, without cells: least squares over all pairs, weighed by Welsch's function of
    how far they are apart. The weight, s^2, is the information of all pairs about the speed;
    0 where none do. near_m: the standard deviation of that function. points: in order of the
    second axis, as they are moved by the speed.
    """
    weight = 0.0
    for _ in range(STEPS):
        weight, vector = 0.0, 0.0
        for i in range(len(points)):
            for j in range(i - 1, -1, -1):
                along, aside = ahead[i, 0] - ahead[j, 0], ahead[i, 1] - ahead[j, 1]
                y = points[i, 1] - points[j, 1] + speed * aside
                if y > 2 * REACH * near_m:
                    break
                x = points[i, 0] - points[j, 0] + speed * along
                if scans[i] == scans[j] or max(abs(x), abs(y)) > REACH * near_m:
                    continue
                share = np.exp(-0.5 * (x * x + y * y) / (near_m * near_m))
                weight += share * (along * along + aside * aside)
                vector += share * (along * x + aside * y)
        if weight <= 0.0:
            return speed, 0.0
        speed -= vector / weight
    return speed, weight


@compiled()
def count_separate(points: np.ndarray, apart_m: float) -> int:
    """Return the size of a greedy selection of (N, 2) points that are that far apart."""
    taken = np.empty((len(points), 2))
    count = 0
    for n in range(len(points)):
        alone = True
        for k in range(count):
            x, y = points[n, 0] - taken[k, 0], points[n, 1] - taken[k, 1]
            alone &= x * x + y * y > apart_m * apart_m
        if alone:
            taken[count] = points[n]
            count += 1
    return count


# --------------------------------------------------------------------------------------------------
# The speed search.

SPEEDS_M_S = np.arange(-8.0, 50.0, 0.25)
"""Speeds ahead that are tried."""
CELL_M = 0.4
"""Side of the cells of the ground plane in which ends must meet."""
LOWEST_M, TALLEST_M = 0.4, 4.3
"""Heights above the ground: lower returns are the ground; no road user is taller."""
NEAREST_M, FARTHEST_M = 1.5, 60.0
"""Ends and slim objects are used between these ranges; nearer is the own vehicle."""
NEAR_M, GROUND_SHARE = 25.0, 0.05
"""The ground is as high as this quantile of the heights of returns within that distance."""
BESIDE_M_S = 2.0
"""Speeds closer than this support each other rather than compete."""
LEAST_TALL = 8
"""Least mean number of ends of tall objects in a scan: a few are where beams leave the roof of a
tunnel, and move with the sensor."""
SLIM_M, PERSON_M = 0.6, 2.0
"""Vehicles of that height are wider; people and riders are as slim, but lower."""
FEW_SLIM, LEAST_SLIM, MANY_SLIM, APART_M = 2.0, 4.0, 10.0, 2.0
"""Mean numbers of slim objects in a scan from which they give a guess, decide, and decide alone;
objects within `APART_M` count as one. Beside the sensor a part of a lorry may look slim."""
ROUGHLY_M_S = 0.3
"""Standard deviation of a speed found by cells."""
NEAR_FIXTURE_M = 0.1
"""Standard deviation of the position of the same fixture in two scans."""
FINE_S2_M_S, FINEST_M_S = 0.15, 0.1
"""Standard deviation of a fine speed: this over its weight, and the latter because of sway."""
VAGUEST_M_S = 1.0
"""Largest standard deviation of a usable speed."""


@dataclass(frozen=True, slots=True)
class Ends:
    """Ends of objects in a scan, and slim objects.

    points: (K, 2) metres as measured. times_s: (K,). upright, tall, slim: (K,) bool, whether it is
    an upright end, one of a tall object, or the middle of a slim object.
    """

    points: np.ndarray
    times_s: np.ndarray
    upright: np.ndarray
    tall: np.ndarray
    slim: np.ndarray

    @staticmethod
    def of(scan: LidarScan) -> Ends:
        """Return the ends and slim objects of a scan."""
        points = scan.points
        if not len(points):
            return Ends(np.empty((0, 2)), np.empty(0), *np.empty((3, 0), bool))
        flat = np.hypot(points[:, 0], points[:, 1])
        near = (flat < NEAR_M) & (flat > 0)
        height_m = points[:, 2] - (np.quantile(points[near, 2], GROUND_SHARE) if near.any() else 0)
        usable = (flat < FARTHEST_M) & (flat > NEAREST_M)
        table = BeamTable.of(points, scan.ring, scan.column)
        # Without visible ground, the height of objects is unknown.
        grounded = usable & near.any()
        upright = table.ends() & usable & ((height_m > LOWEST_M) | ~near.any())
        slim_middles = table.slim(grounded & (height_m > PERSON_M), SLIM_M)
        selected = upright | slim_middles
        times = scan.stamp_s + scan.time_offset_s[selected].astype(np.float64)
        return Ends(
            points[selected, :2].astype(np.float64),
            times,
            upright[selected],
            (upright & grounded & (height_m > TALLEST_M))[selected],
            slim_middles[selected],
        )

    @property
    def slim_objects(self) -> int:
        """Number of slim objects."""
        return int(count_separate(self.points[self.slim], APART_M))


@dataclass(frozen=True, slots=True)
class Speed:
    """The best speed ahead, m/s, and the ratio of its score to the best of other speeds.

    by_fixtures: whether it comes from objects that cannot be road users. spread_m_s: standard
    deviation.
    """

    ahead_m_s: float
    clarity: float
    by_fixtures: bool = False
    spread_m_s: float = ROUGHLY_M_S

    CLEAR: ClassVar = 1.25
    """Least clarity of a speed that no other one competes with."""

    @staticmethod
    def measured(ahead_m_s: float) -> Speed:
        """Return a speed that was measured directly, for example by wheels."""
        return Speed(ahead_m_s, np.inf, by_fixtures=True)

    @property
    def clear(self) -> bool:
        """Whether no other speed has a similar score."""
        return self.clarity >= self.CLEAR

    @property
    def reliable(self) -> bool:
        """Whether it is reliable: objects as low as vehicles may all belong to traffic."""
        return self.clear and self.by_fixtures and self.spread_m_s <= VAGUEST_M_S


def speed_of(scans: list[Ends], rate_rad_s: float) -> Speed:
    """Return the speed at which consecutive scans agree, for a turn rate about the vertical.

    A guess from few fixtures is better than one from objects that may be traffic.
    """
    fixed = marked_fixtures(scans)
    if fixed is not None:
        return _by_fixtures(scans, rate_rad_s, fixed)
    if _slim_objects(scans) >= FEW_SLIM:
        guess = _by_fixtures(scans, rate_rad_s, [each.slim for each in scans])
        if guess.reliable:
            return replace(guess, by_fixtures=False)
    return _JoinedEnds.at(scans, rate_rad_s, [each.upright for each in scans]).roughly()


def standing_speed_of(scans: list[Ends], rate_rad_s: float) -> Speed:
    """Return the speed at which fixtures agree; not clear if there are too few."""
    fixed = marked_fixtures(scans)
    return Speed(0.0, 0.0) if fixed is None else _by_fixtures(scans, rate_rad_s, fixed)


def _by_fixtures(scans: list[Ends], rate: float, fixed: list[np.ndarray]) -> Speed:
    ends_joined = _JoinedEnds.at(scans, rate, fixed)
    rough = replace(ends_joined.roughly(), by_fixtures=True)
    return ends_joined.finely(rough) if rough.clear else rough


def marked_fixtures(scans: list[Ends]) -> list[np.ndarray] | None:
    """Return the marks of fixtures in each scan; None if there are too few."""
    objects = _slim_objects(scans)
    enough_tall = sum(int(each.tall.sum()) for each in scans) >= LEAST_TALL * len(scans)
    slim_counts = objects >= LEAST_SLIM
    tall_counts = enough_tall and objects < MANY_SLIM
    if not (tall_counts or slim_counts):
        return None
    return [each.tall & tall_counts | each.slim & slim_counts for each in scans]


def _slim_objects(scans: list[Ends]) -> float:
    """Return the mean number of slim objects in a scan."""
    return sum(each.slim_objects for each in scans) / max(len(scans), 1)


@dataclass(frozen=True, slots=True)
class _JoinedEnds:
    """Selected ends of consecutive scans.

    points: (N, 2) metres, turned as the sensor was at first. ahead: (N, 2) s, where they are moved
    by a speed, along the arc on which the sensor drives. scans: (N,) numbers.
    """

    points: np.ndarray
    ahead: np.ndarray
    scans: np.ndarray

    @staticmethod
    def at(scans: list[Ends], rate: float, chosen: list[np.ndarray]) -> _JoinedEnds:
        """Return the selected ends of all scans; rate: rad/s about the vertical."""
        points = np.concatenate([each.points[c] for each, c in zip(scans, chosen, strict=True)])
        times = np.concatenate([each.times_s[c] for each, c in zip(scans, chosen, strict=True)])
        number = np.concatenate([np.full(int(c.sum()), i) for i, c in enumerate(chosen)])
        times = times - times.min(initial=np.inf)
        angles = rate * times
        cosines, sines = np.cos(angles), np.sin(angles)
        turned = np.column_stack(
            [
                cosines * points[:, 0] - sines * points[:, 1],
                sines * points[:, 0] + cosines * points[:, 1],
            ]
        )
        half = times[:, None] * np.column_stack([np.cos(0.5 * angles), np.sin(0.5 * angles)])
        return _JoinedEnds(turned, half, number)

    def roughly(self) -> Speed:
        """Return the best speed by counting cells."""
        if len(self.points) < 2:
            return Speed(0.0, 0.0)
        scores = gathered(self.points, self.ahead, self.scans, SPEEDS_M_S, CELL_M)
        scores = scores - np.median(scores)  # Ends meet by chance at any speed.
        best = int(scores.argmax())
        others = scores[np.abs(SPEEDS_M_S - SPEEDS_M_S[best]) > BESIDE_M_S]
        around = slice(max(best - 1, 0), best + 2)
        weights = np.maximum(scores[around], 0.0) + 1e-9
        middle = float(weights @ SPEEDS_M_S[around] / weights.sum())
        return Speed(middle, float(scores[best] / max(others.max(), 1.0)))

    def finely(self, rough: Speed) -> Speed:
        """Return the speed near a rough one at which the points themselves coincide."""
        order = np.argsort(self.points[:, 1] + rough.ahead_m_s * self.ahead[:, 1])
        ahead_m_s, weight = joined(
            self.points[order],
            self.ahead[order],
            self.scans[order],
            rough.ahead_m_s,
            NEAR_FIXTURE_M,
        )
        if not weight or abs(ahead_m_s - rough.ahead_m_s) > BESIDE_M_S:
            return rough
        spread_m_s = float(np.hypot(FINE_S2_M_S / weight, FINEST_M_S))
        return replace(rough, ahead_m_s=ahead_m_s, spread_m_s=spread_m_s)
