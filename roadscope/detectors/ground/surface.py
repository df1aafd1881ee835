"""The height of the ground around the sensor, estimated outwards from the ego."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud

SECTORS = 120
"""Sectors around the sensor, 3 degrees each: a car ahead at 30 m fills one, its neighbours are
free."""
FIRST_M, BIN_M, GROWTH, BINS = 2.0, 0.7, 0.035, 72
"""Sectors are cut into `BINS` bins of range: where the first begins, the least length of a bin, and
its length as a share of range; the last ends at about 110 m. Chosen by hand."""
FLAT_M, STANDING_M = 0.12, 1.2
"""A bin shows no ground if more returns lie between both heights above its lowest return than below
the first: those are of an upright face. Higher ones, of tree crowns, do not count. Chosen by
hand."""


class GroundRule(NamedTuple):
    """What is assumed of roads and of the mounting; chosen by hand on simulated roads.

    height_m, tilt: standard deviations of the calibrated height and, in radians, of the calibrated
        pitch and roll against the ground near the ego. slope: of the slope of the ground against
        the plane that is fitted there.
    bend: variance of the slope that is added per metre; 0.0004 is 2.6 degrees in 5 m.
    steepest: greatest slope, that of banks beside the road.
    noise_m: standard deviation of the lowest return of a bin from the ground.
    gate: a return is taken for ground within so many standard deviations plus twice `noise_m`.
    kerb_m, across: standard deviation between the heights of neighbouring sectors at distance 0,
        and its growth with the distance between them.
    gap_m: where the standard deviation of the ground exceeds this, the neighbours decide. lean_m:
        standard deviation of the height on which they agree, and of the slope if the estimate is
        replaced. leap_m: greatest distance of that height from the estimate, beyond twice
        `noise_m`.
    """

    height_m: float = 0.15
    tilt: float = 0.03
    slope: float = 0.02
    bend: float = 0.0004
    steepest: float = 0.4
    noise_m: float = 0.05
    gate: float = 2.5
    kerb_m: float = 0.15
    across: float = 0.17
    gap_m: float = 0.12
    lean_m: float = 0.1
    leap_m: float = 0.15


RULE = GroundRule()
SIDE_SECTORS, LEAST_SHOWING = 4, 3
"""A sector is compared with so many on either side. Where the ground is uncertain, at least
`LEAST_SHOWING` of these nine must show ground; beyond `gap_m` more than half of them."""
FLAT_GROUND_M, UNEVEN_GROUND_M = 0.1, 0.25
"""Where the estimate is nearer than the first to the calibrated plane on which the wheels stand,
that plane is used. Beyond the second the estimate is used, between both a weighted mean. Chosen by
hand."""
LEAST_BEAMS, LEAST_SECTORS, LEAST_BINS = 8, 12, 3.0
"""With fewer beams, such as the four layers of the LUX, the road has returns at one or two ranges
only, too few for an estimate. Ground in fewer sectors, or in fewer bins of a sector on average, is
too little, too. In scans without beam numbers all are 0; the first rule does not hold for them."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundSurface:
    """The ground around a sensor, above the plane z = 0 of the ego frame.

    heights: (S, B) metres at the middles of sectors and bins, None where the ground is that plane.
    origin: (2,) metres, where the sensor stands.
    """

    heights: np.ndarray | None
    origin: np.ndarray

    @staticmethod
    def of(cloud: Cloud, rule: GroundRule = RULE) -> GroundSurface:
        """Estimate the ground of a whole scan."""
        return GroundSurface.levelled(cloud, rule)[0]

    @staticmethod
    def levelled(cloud: Cloud, rule: GroundRule = RULE) -> tuple[GroundSurface, Cloud]:
        """Return the ground of a whole scan, and the scan with heights above it in place of z.

        A plane is fitted to the ground near the ego, beginning with the calibrated one. From there
        the estimate proceeds outwards, bin by bin in all sectors: in each sector a Kalman filter
        over range estimates height and slope from the lowest returns and from the neighbouring
        sectors. So the ground may rise, fall and lean, and lowest returns of cars and walls are
        left out.
        """
        if not len(cloud) or 0 < cloud.ring.max() < LEAST_BEAMS - 1:
            return GroundSurface(None, cloud.origin), cloud
        sector, place = _polar(cloud.points, cloud.origin)
        ranges, lows = _lowest(cloud.points, cloud.origin, sector, place)
        heights, accepted = _front(ranges, lows, _near_plane(ranges, lows, rule), rule)
        bins = accepted.sum(axis=1)[accepted.any(axis=1)]
        enough = len(bins) >= LEAST_SECTORS and bins.mean() >= LEAST_BINS
        share = (np.abs(heights) - FLAT_GROUND_M) / (UNEVEN_GROUND_M - FLAT_GROUND_M)
        if not enough or not (share > 0).any():
            return GroundSurface(None, cloud.origin), cloud
        heights *= np.clip(share, 0, 1)
        points = cloud.points.copy()
        points[:, 2] -= _between(heights, sector, place)
        return GroundSurface(heights, cloud.origin), cloud._trusted(points=points)

    def below(self, points: np.ndarray) -> np.ndarray:
        """Return the height of the ground below (N, 2 or 3) points, (N,) metres."""
        if self.heights is None:
            return np.zeros(len(points))
        return _between(self.heights, *_polar(points, self.origin))


def bin_edges() -> np.ndarray:
    """Return the ranges between which bins lie, (BINS + 1,) metres."""
    edges = [FIRST_M]
    for _ in range(BINS):
        edges.append(edges[-1] + max(BIN_M, GROWTH * edges[-1]))
    return np.array(edges)


EDGES_M = bin_edges()
MIDDLES_M = (EDGES_M[1:] + EDGES_M[:-1]) / 2


@compiled()
def _polar(points: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the sector of each return, a fraction, and its place among the bins' middles, (N,)."""
    sector, place = np.empty(len(points)), np.empty(len(points))
    for i in range(len(points)):
        x, y = points[i, 0] - origin[0], points[i, 1] - origin[1]
        sector[i] = (np.arctan2(y, x) / (2 * np.pi) + 0.5) * SECTORS
        reach = min(max(np.sqrt(x * x + y * y), MIDDLES_M[0]), MIDDLES_M[-1])
        b = min(np.searchsorted(MIDDLES_M, reach, "right"), BINS - 1) - 1
        place[i] = b + (reach - MIDDLES_M[b]) / (MIDDLES_M[b + 1] - MIDDLES_M[b])
    return sector, place


@compiled()
def _lowest(
    points: np.ndarray, origin: np.ndarray, sector: np.ndarray, place: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return range and height of the lowest return of bins that show ground, (S, B), else inf."""
    ranges, lows = np.full((2, SECTORS, BINS), np.inf)
    flat, standing = np.zeros((2, SECTORS, BINS))
    for step in range(2):
        for i in range(len(points)):
            s, b = int(sector[i]) % SECTORS, int(place[i] + 0.5)
            z = points[i, 2]
            if step == 0:
                if z < lows[s, b]:
                    lows[s, b] = z
                    x, y = points[i, 0] - origin[0], points[i, 1] - origin[1]
                    ranges[s, b] = np.sqrt(x * x + y * y)
            elif z - lows[s, b] < FLAT_M:
                flat[s, b] += 1
            elif z - lows[s, b] < STANDING_M:
                standing[s, b] += 1
    for s in range(SECTORS):
        for b in range(BINS):
            if standing[s, b] > flat[s, b]:
                lows[s, b] = np.inf
    return ranges, lows


NEAR_M = 20.0
"""The plane of the ground near the vehicle is fitted up to this range."""
GATES_M = (1.0, 0.5, 0.3, 0.2, 0.15, 0.15)
"""Distances from the plane within which a bin counts, one for each round of the fit."""


def _near_plane(ranges: np.ndarray, lows: np.ndarray, rule: GroundRule) -> np.ndarray:
    """Return height at the sensor and slopes along x and y of the ground near the vehicle, (3,).

    Robust least squares over bins; the calibrated plane is the prior.
    """
    s, b = np.nonzero((ranges < NEAR_M) & (lows < np.inf))
    reach, z = ranges[s, b], lows[s, b]
    azimuth = (s + 0.5) / SECTORS * 2 * np.pi - np.pi
    rows = np.column_stack([np.ones(len(s)), reach * np.cos(azimuth), reach * np.sin(azimuth)])
    prior = np.diag(np.array([rule.height_m, rule.tilt, rule.tilt]) ** -2.0)
    plane = np.zeros(3)
    for gate_m in GATES_M:
        off = z - rows @ plane
        near = np.abs(off) < gate_m
        # Errors of near bins are correlated, so all bins together weigh at most as much as 100.
        bin_weight = 1.0 / (rule.noise_m**2 * max(near.sum() / 100.0, 1.0))
        chosen = rows[near]
        normal = prior + bin_weight * chosen.T @ chosen
        plane = np.linalg.solve(normal, bin_weight * chosen.T @ z[near])
    return plane


@compiled()
def _front(
    ranges: np.ndarray, lows: np.ndarray, plane: np.ndarray, rule: GroundRule
) -> tuple[np.ndarray, np.ndarray]:
    """Return the heights of the ground at the middles of bins, (S, B), and which bins showed it.

    ranges, lows: (S, B) as from `_lowest`. plane: (3,) as from `_near_plane`.
    """
    heights, accepted = np.empty((SECTORS, BINS)), np.zeros((SECTORS, BINS), np.bool_)
    # Height and slope of each sector, and their covariance.
    state, var = np.empty((SECTORS, 2)), np.empty((SECTORS, 3))
    off, predicted, spread = np.empty((3, SECTORS))
    beside = np.empty(2 * SIDE_SECTORS + 1)
    for s in range(SECTORS):
        azimuth = (s + 0.5) / SECTORS * 2 * np.pi - np.pi
        slope = plane[1] * np.cos(azimuth) + plane[2] * np.sin(azimuth)
        state[s, 0], state[s, 1] = plane[0] + slope * MIDDLES_M[0], slope
        var[s, 0], var[s, 1], var[s, 2] = rule.noise_m**2, 0.0, rule.slope**2
    for b in range(BINS):
        step = MIDDLES_M[b] - MIDDLES_M[max(b - 1, 0)]
        for s in range(SECTORS):
            state[s, 0] += step * state[s, 1]
            var[s, 0] += step * (2 * var[s, 1] + step * var[s, 2]) + rule.bend * step**3 / 3
            var[s, 1] += step * var[s, 2] + rule.bend * step**2 / 2
            var[s, 2] += rule.bend * step
        predicted[:], spread[:] = state[:, 0], var[:, 0]
        beside_variance = rule.kerb_m**2 + (MIDDLES_M[b] * 2 * np.pi / SECTORS * rule.across) ** 2
        for s in range(SECTORS):
            for side in (-1, 1):
                n = (s + side) % SECTORS
                _update(state[s], var[s], 0.0, predicted[n], spread[n] + beside_variance)
            # It is inf or nan where the bin shows no ground; neither is less than inf.
            off[s] = lows[s, b] - state[s, 0] - (ranges[s, b] - MIDDLES_M[b]) * state[s, 1]
        for s in range(SECTORS):
            count = _neighbours(off, s, beside)
            near, unsure = 2 * rule.noise_m, np.sqrt(var[s, 0])
            continues = unsure < near or (unsure < rule.gap_m and count >= LEAST_SHOWING)
            if not continues and count > SIDE_SECTORS:
                # Two thirds of the neighbours are not lower: bodies are higher than the ground.
                common = beside[count // 3]
                gate = near + min(rule.gate * unsure, rule.leap_m)
                if common < -gate:
                    # No return comes from below the ground, so the estimate was not the ground.
                    azimuth = (s + 0.5) / SECTORS * 2 * np.pi - np.pi
                    state[s, 0] += common
                    state[s, 1] = plane[1] * np.cos(azimuth) + plane[2] * np.sin(azimuth)
                    var[s, 0], var[s, 1], var[s, 2] = rule.lean_m**2, 0.0, rule.lean_m**2
                elif common < gate:
                    _update(state[s], var[s], 0.0, state[s, 0] + common, rule.lean_m**2)
                continues = common < gate
            if continues and off[s] < np.inf:
                ahead = ranges[s, b] - MIDDLES_M[b]
                residual = lows[s, b] - state[s, 0] - ahead * state[s, 1]
                if abs(residual) < near + rule.gate * np.sqrt(var[s, 0]):
                    _update(state[s], var[s], ahead, lows[s, b], rule.noise_m**2)
                    accepted[s, b] = True
            state[s, 1] = min(max(state[s, 1], -rule.steepest), rule.steepest)
            heights[s, b] = state[s, 0]
    return heights, accepted


@compiled()
def _neighbours(off: np.ndarray, s: int, beside: np.ndarray) -> int:
    """Write the values of a sector and of its neighbours, rising, into `beside`; return how many.

    off: (S,) metres; those that are inf or nan, where a sector shows no ground, are left out.
    """
    count = 0
    for n in range(s - SIDE_SECTORS, s + SIDE_SECTORS + 1):
        value = off[n % SECTORS]
        if value < np.inf:
            k = count
            while k > 0 and beside[k - 1] > value:
                beside[k] = beside[k - 1]
                k -= 1
            beside[k] = value
            count += 1
    return count


@compiled()
def _update(state: np.ndarray, var: np.ndarray, ahead: float, height: float, noise: float) -> None:
    """Update a Kalman filter of height and slope by a height measured `ahead` metres farther.

    state: (2,) height and slope. var: (3,) variance of the height, covariance, variance of the
    slope. noise: variance of the measured height.
    """
    to_height = var[0] + ahead * var[1]
    to_slope = var[1] + ahead * var[2]
    total = to_height + ahead * to_slope + noise
    height_gain, slope_gain = to_height / total, to_slope / total
    residual = height - state[0] - ahead * state[1]
    state[0] += height_gain * residual
    state[1] += slope_gain * residual
    var[0], var[1], var[2] = (
        var[0] - height_gain * to_height,
        var[1] - height_gain * to_slope,
        var[2] - slope_gain * to_slope,
    )


@compiled()
def _between(heights: np.ndarray, sector: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return (S, B) heights at returns, (N,), interpolated between sectors and between bins.

    sector, place: (N,) as from `_polar`.
    """
    below = np.empty(len(sector))
    for i in range(len(sector)):
        middle, b = sector[i] - 0.5, min(int(place[i]), BINS - 2)
        s = int(np.floor(middle))
        u, v, near, far = middle - s, place[i] - b, s % SECTORS, (s + 1) % SECTORS
        one = heights[near, b] * (1 - v) + heights[near, b + 1] * v
        below[i] = one * (1 - u) + u * (heights[far, b] * (1 - v) + heights[far, b + 1] * v)
    return below
