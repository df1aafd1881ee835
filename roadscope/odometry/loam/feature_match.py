"""The motion between the features of two scans (Zhang and Singh 2017; Zhang 2022)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.estimates import covariance_of
from roadscope.odometry.loam.features import Features
from roadscope.odometry.rigid import inverse, log_se3, orthonormal

# --------------------------------------------------------------------------------------------------
# The nearest point of a ring, searched from its azimuth.

NONE = -1
ROUNDING_RAD = 1e-12
"""Added to the angles within which a point may be nearer, because of rounding, radians."""


class RingTable(NamedTuple):
    """Points ring by ring, by azimuth within a ring.

    points: (N, 3) metres. azimuths: (N,) rad. labels: (N,). starts: (R + 1,) where rings start.
    lows, highs: (R,) least and greatest elevation of a ring, rad.
    """

    points: np.ndarray
    azimuths: np.ndarray
    labels: np.ndarray
    starts: np.ndarray
    lows: np.ndarray
    highs: np.ndarray


def ring_table(points: np.ndarray, rings: np.ndarray, labels: np.ndarray) -> RingTable:
    """Return (N, 3) points with (N,) ring and label as a table."""
    azimuths = np.arctan2(points[:, 1], points[:, 0])
    order = np.lexsort((azimuths, rings))
    points, azimuths = np.ascontiguousarray(points[order]), azimuths[order]
    count = int(rings.max(initial=-1)) + 1
    starts = np.concatenate([[0], np.cumsum(np.bincount(rings, minlength=count))])
    elevations = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    lows, highs = np.full(count, np.inf), np.full(count, -np.inf)
    used = np.flatnonzero(np.diff(starts))
    if len(used):
        lows[used] = np.minimum.reduceat(elevations, starts[used])
        highs[used] = np.maximum.reduceat(elevations, starts[used])
    return RingTable(points, azimuths, labels[order], starts, lows, highs)


@compiled()
def nearest(
    table: RingTable,
    place: np.ndarray,
    label: int,
    home: int,
    farthest: int,
    least: int,
    most: float,
) -> tuple[int, int]:
    """Return index and ring of the nearest point; -1 if none is nearer than `most`, squared.

    label: the point's; negative for any. home: ring from which the search goes outwards, from
        `least` to `farthest` rings away.
    """
    flat2 = place[0] * place[0] + place[1] * place[1]
    reach2 = flat2 + place[2] * place[2]
    elevation, azimuth = np.arctan2(place[2], np.sqrt(flat2)), np.arctan2(place[1], place[0])
    steepest = _angle_within(most, reach2)
    count, index_found, ring_found = len(table.lows), NONE, NONE
    for step in range(least, farthest + 1):
        for side in (-1, 1):
            ring = home + side * step
            if ring < 0 or ring >= count or (step == 0 and side == 1):
                continue
            if max(table.lows[ring] - elevation, elevation - table.highs[ring]) > steepest:
                continue
            index, nearer = nearest_on(table, ring, place, azimuth, label, most, NONE)
            if index != NONE:
                index_found, ring_found, most = index, ring, nearer
                steepest = _angle_within(most, reach2)
    return index_found, ring_found


@compiled()
def nearest_on(
    table: RingTable,
    ring: int,
    place: np.ndarray,
    azimuth: float,
    label: int,
    most: float,
    skip: int,
) -> tuple[int, float]:
    """Return index and squared distance of the nearest point of a ring.

    place: (3,) metres, with its azimuth. most: upper bound of the squared distance. skip: an index
    that is ignored.
    """
    first, last = table.starts[ring], table.starts[ring + 1]
    flat2 = place[0] * place[0] + place[1] * place[1]
    middle = first + np.searchsorted(table.azimuths[first:last], azimuth)
    index_found, widest = NONE, _angle_within(most, flat2)
    for side in (-1, 1):
        k = middle if side == 1 else middle - 1
        for _ in range(last - first):
            k = last - 1 if k < first else (first if k >= last else k)
            turn = side * (table.azimuths[k] - azimuth)
            turn += 2 * np.pi if turn < 0 else 0.0
            if turn > np.pi or turn > widest:
                break
            if k != skip and (label < 0 or table.labels[k] == label):
                dx = table.points[k, 0] - place[0]
                dy = table.points[k, 1] - place[1]
                dz = table.points[k, 2] - place[2]
                squared = dx * dx + dy * dy + dz * dz
                if squared < most:
                    index_found, most = k, squared
                    widest = _angle_within(most, flat2)
            k += side
    return index_found, most


@compiled()
def _angle_within(most: float, square: float) -> float:
    """Return the largest angle, rad, between a place and a beam that passes within a distance.

    most: that distance, squared. square: the place's own from the sensor, squared.
    """
    if most >= square:
        return np.inf
    return float(np.arcsin(np.sqrt(most / square)) + ROUNDING_RAD)


# --------------------------------------------------------------------------------------------------
# The line or plane of the previous features for each feature.

RINGS_AWAY = 2
"""Greatest distance of the second ring from the first: some rings have no features."""
SLIM = 0.05
"""Sine of the angle between two sides of a triangle below which it counts as a line."""


class Pairs(NamedTuple):
    """K points, each paired with a line or a plane.

    points: (K, 3) metres, in the frame now. anchors: (K, 3) metres, a point of each line or plane,
    frame before. axes: (K, 2, 3) unit vectors along which the distance is measured: two across a
    line, or the normal of a plane and zeros.
    """

    points: np.ndarray
    anchors: np.ndarray
    axes: np.ndarray


@compiled()
def lines_of(
    points: np.ndarray,
    labels: np.ndarray,
    rings: np.ndarray,
    table: RingTable,
    matrix: np.ndarray,
    reach_m: float,
) -> Pairs:
    """Pair edges with lines (eq. 7) through the nearest edge and the nearest one of another ring.

    points: (N, 3) metres. labels: (N,) of the edges that may be nearest, negative for any. rings:
    (N,). table: the edges of the scan before. matrix: (4, 4) `before_from_now`. reach_m: search
    radius.
    """
    matched, anchors, axes = _empty_pairs(len(points))
    count, place, most = 0, np.empty(3), reach_m * reach_m
    for n in range(len(points)):
        _transform(matrix, points[n], place)
        j, ring = nearest(table, place, labels[n], rings[n], len(table.lows), 0, most)
        if j == NONE:
            continue
        k, _ = nearest(table, place, labels[n], ring, RINGS_AWAY, 1, most)
        if k == NONE:
            continue
        matched[count], anchors[count] = points[n], table.points[j]
        count += _across_line(table, j, k, axes[count])
    return Pairs(matched[:count], anchors[:count], axes[:count])


@compiled()
def planes_of(
    points: np.ndarray,
    labels: np.ndarray,
    rings: np.ndarray,
    table: RingTable,
    matrix: np.ndarray,
    reach_m: float,
) -> Pairs:
    """Pair points with planes (eq. 8) through the nearest point, another of its ring and a third.

    The third is the nearest one of another ring. Arguments as in `lines_of`. The printed numerator
    of eq. 8 lacks its cross product: a distance from a plane is meant (Zhang and Singh 2017, eq.
    3).
    """
    matched, anchors, axes = _empty_pairs(len(points))
    count, place, most = 0, np.empty(3), reach_m * reach_m
    for n in range(len(points)):
        _transform(matrix, points[n], place)
        j, ring = nearest(table, place, labels[n], rings[n], len(table.lows), 0, most)
        if j == NONE:
            continue
        azimuth = np.arctan2(place[1], place[0])
        k, _ = nearest_on(table, ring, place, azimuth, labels[n], most, j)
        m, _ = nearest(table, place, labels[n], ring, RINGS_AWAY, 1, most)
        if k == NONE or m == NONE:
            continue
        matched[count], anchors[count] = points[n], table.points[j]
        count += _across_plane(table, j, k, m, axes[count])
    return Pairs(matched[:count], anchors[:count], axes[:count])


@compiled()
def _empty_pairs(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.empty((count, 3)), np.empty((count, 3)), np.zeros((count, 2, 3))


@compiled()
def _transform(matrix: np.ndarray, point: np.ndarray, place: np.ndarray) -> None:
    for i in range(3):
        place[i] = matrix[i, 3]
        for j in range(3):
            place[i] += matrix[i, j] * point[j]


@compiled()
def _across_line(table: RingTable, one: int, other: int, axes: np.ndarray) -> int:
    """Write two unit axes perpendicular to the line through two points, given by their indices.

    Returns 1, or 0 for a line without direction.
    """
    points = table.points
    x = points[other, 0] - points[one, 0]
    y = points[other, 1] - points[one, 1]
    z = points[other, 2] - points[one, 2]
    length = np.sqrt(x * x + y * y + z * z)
    if not length > 0.0:
        return 0
    x, y, z = x / length, y / length, z / length
    # Any axis that is not along the line can be the first.
    if abs(z) < 0.9:
        flat = np.sqrt(x * x + y * y)
        a, b, c = -y / flat, x / flat, 0.0
    else:
        upright = np.sqrt(y * y + z * z)
        a, b, c = 0.0, -z / upright, y / upright
    axes[0, 0], axes[0, 1], axes[0, 2] = a, b, c
    axes[1, 0], axes[1, 1], axes[1, 2] = y * c - z * b, z * a - x * c, x * b - y * a
    return 1


@compiled()
def _across_plane(table: RingTable, corner: int, one: int, other: int, axes: np.ndarray) -> int:
    """Write the unit normal of the plane through three points, given by their indices.

    Returns 1, or 0 for a triangle that is too slim.
    """
    points = table.points
    ax, ay, az = (
        points[one, 0] - points[corner, 0],
        points[one, 1] - points[corner, 1],
        points[one, 2] - points[corner, 2],
    )
    bx, by, bz = (
        points[other, 0] - points[corner, 0],
        points[other, 1] - points[corner, 1],
        points[other, 2] - points[corner, 2],
    )
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    area2 = x * x + y * y + z * z
    sides2 = (ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)
    if not area2 > SLIM * SLIM * sides2:
        return 0
    length = np.sqrt(area2)
    axes[0, 0], axes[0, 1], axes[0, 2] = x / length, y / length, z / length
    axes[1] = 0.0
    return 1


# --------------------------------------------------------------------------------------------------
# Levenberg and Marquardt's method on distances from lines and planes (Zhang 2022, eq. 9-10).

STEPS = 4
"""Steps between two searches for neighbours. Chosen by hand."""
FIRST_LAMBDA, SHRUNK, RAISED = 1e-4, 0.3, 10.0
"""First damping, and its factors after a step that lowers the cost and after one that does not.
Chosen by hand."""
TUKEY = 4.685
"""Robust standard deviations beyond which a pair has no weight in the last search: those of the
bisquare with 95 % efficiency."""
DEVIATION = 1.4826
"""Ratio of the standard deviation to the median of absolute values of a normal distribution."""
FLOOR = 1e-9
"""Added to the diagonal, so that unknowns without any pair stay unchanged."""


@compiled()
def distances(pairs: Pairs, matrix: np.ndarray) -> np.ndarray:
    """Return the distance of each pair, (K,) metres, under a (4, 4) motion."""
    away, off = np.empty(len(pairs.points)), np.empty(2)
    for n in range(len(away)):
        _offsets(pairs, matrix, n, off)
        away[n] = np.sqrt(off[0] * off[0] + off[1] * off[1])
    return away


@compiled()
def bisquare(away: np.ndarray, least: float, wider: float) -> np.ndarray:
    """Return the weights, (K,) 1/m^2, of pairs by their distances: Tukey's bisquare.

    Their scatter is estimated by the median, but is at least `least`. wider: factor of the width
    for 95 % efficiency.
    """
    weights = np.empty(len(away))
    if len(away) == 0:
        return weights
    deviation = max(DEVIATION * np.median(away), least)
    for n in range(len(away)):
        share = min(away[n] / (wider * TUKEY * deviation), 1.0)
        weights[n] = ((1.0 - share * share) / deviation) ** 2
    return weights


@compiled()
def normal_equations(
    pairs: Pairs, weights: np.ndarray, matrix: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return J'WJ (6, 6), J'Wd (6,) and the sum of weighted squares.

    The unknowns are a shift, metres, and a turn about the sensor, radians, along the axes of
    the target frame of the (4, 4) motion.
    """
    H, b, cost = np.zeros((6, 6)), np.zeros(6), 0.0
    off, j, q = np.empty(2), np.empty(6), np.empty(3)
    for n in range(len(pairs.points)):
        if weights[n] <= 0.0:
            continue
        _offsets(pairs, matrix, n, off)
        for i in range(3):
            q[i] = (
                matrix[i, 0] * pairs.points[n, 0]
                + matrix[i, 1] * pairs.points[n, 1]
                + matrix[i, 2] * pairs.points[n, 2]
            )
        for k in range(2):
            a0, a1, a2 = pairs.axes[n, k]
            if a0 == 0.0 and a1 == 0.0 and a2 == 0.0:
                continue
            j[0], j[1], j[2] = a0, a1, a2
            j[3], j[4], j[5] = q[1] * a2 - q[2] * a1, q[2] * a0 - q[0] * a2, q[0] * a1 - q[1] * a0
            for r in range(6):
                b[r] += weights[n] * j[r] * off[k]
                for c in range(r, 6):
                    H[r, c] += weights[n] * j[r] * j[c]
            cost += weights[n] * off[k] * off[k]
    for r in range(6):
        for c in range(r):
            H[r, c] = H[c, r]
    return H, b, cost


@compiled()
def descend(pairs: Pairs, weights: np.ndarray, start: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the (4, 4) motion after some descent steps from a start; only free unknowns change."""
    matrix, damping = start.copy(), FIRST_LAMBDA
    H, b, cost = normal_equations(pairs, weights, matrix)
    for _ in range(STEPS):
        damped = H.copy()
        for r in range(6):
            damped[r, r] += damping * H[r, r] + FLOOR
            if not free[r]:
                damped[r, :] = 0.0
                damped[:, r] = 0.0
                damped[r, r] = 1.0
        step = -np.linalg.solve(damped, np.where(free, b, 0.0))
        tried = moved(matrix, step)
        H_there, b_there, cost_there = normal_equations(pairs, weights, tried)
        if cost_there < cost:
            matrix, H, b, cost = tried, H_there, b_there, cost_there
            damping *= SHRUNK
        else:
            damping *= RAISED
    return matrix


@compiled()
def moved(matrix: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return a (4, 4) motion shifted and turned by a (6,) step along its target axes."""
    angle = np.sqrt(step[3] ** 2 + step[4] ** 2 + step[5] ** 2)
    once = np.sin(angle) / angle if angle > 1e-8 else 1.0
    twice = (1 - np.cos(angle)) / (angle * angle) if angle > 1e-8 else 0.5
    across = np.zeros((3, 3))
    across[0, 1], across[0, 2], across[1, 2] = -step[5], step[4], -step[3]
    across[1, 0], across[2, 0], across[2, 1] = step[5], -step[4], step[3]
    result = matrix.copy()
    turn = np.eye(3) + once * across + twice * (across @ across)
    result[:3, :3] = turn @ np.ascontiguousarray(matrix[:3, :3])
    result[:3, 3] += step[:3]
    return result


@compiled()
def _offsets(pairs: Pairs, matrix: np.ndarray, n: int, off: np.ndarray) -> None:
    """Write the offset of a pair's point from its anchor along both axes."""
    off[:] = 0.0
    for i in range(3):
        place = matrix[i, 3] - pairs.anchors[n, i]
        for j in range(3):
            place += matrix[i, j] * pairs.points[n, j]
        off[0] += pairs.axes[n, 0, i] * place
        off[1] += pairs.axes[n, 1, i] * place


# --------------------------------------------------------------------------------------------------
# Scan-to-scan matching (Zhang and Singh 2017; Zhang 2022, 2.3).

ALL = (True,) * 6
MOST_SEARCHES = 15
"""Most searches for neighbours."""
SHIFT_M, TURN_RAD = 1e-4, 1e-5
"""The search ends with a smaller step: these are far below the accuracy of a match."""
WIDER = (16.0, 16.0, 8.0, 4.0, 2.0, 1.0)
"""Factor of the width of the bisquare, from search to search."""
NOISE_M = 0.02
"""Least robust standard deviation of distances: the range noise of a return."""


@dataclass(frozen=True, slots=True, eq=False)
class FeatureMatch:
    """A motion from features.

    before_from_now: (4, 4). information: (6, 6), of a shift, metres, and a turn about the
        sensor, radians, along the axes of the frame before; by the scatter of the features.
    residual_m: weighted root mean square distance; nan without pairs. pair_count: pairs that count.
    """

    before_from_now: np.ndarray
    information: np.ndarray
    residual_m: float
    pair_count: int

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6) along the axes of the frame now."""
        return covariance_of(self.before_from_now, self.information)


def match_features(
    now: Features,
    before: Features,
    start: np.ndarray,
    *,
    edges: bool = True,
    planes: bool = True,
    same_label: bool = True,
    free: tuple[bool, ...] = ALL,
    reach_m: float = 5.0,
) -> FeatureMatch:
    """Return the motion that brings edges onto lines and planes onto planes of the previous scan.

    start: (4, 4) `before_from_now`, initial value. same_label: match only within clusters of one
        label. free: which of x, y, z, roll, pitch, yaw are estimated; others keep their start.
    reach_m: search radius for neighbours.
    """
    searches: list[Callable[[np.ndarray], Pairs]] = []
    if edges:
        rows = slice(now.sharp)
        table = ring_table(before.edges, before.edge_rings, before.edge_labels)
        labels = _labels(now.edge_labels[rows], same_label)
        searches.append(
            _search(lines_of, now.edges[rows], labels, now.edge_rings[rows], table, reach_m)
        )
    if planes:
        rows = slice(now.flat)
        table = ring_table(before.planes, before.plane_rings, before.plane_labels)
        labels = _labels(now.plane_labels[rows], same_label)
        searches.append(
            _search(planes_of, now.planes[rows], labels, now.plane_rings[rows], table, reach_m)
        )
    return settle(searches, start, free)


def settle(
    searches: list[Callable[[np.ndarray], Pairs]],
    start: np.ndarray,
    free: tuple[bool, ...] = ALL,
    most: int = MOST_SEARCHES,
) -> FeatureMatch:
    """Return the motion at which repeatedly searched pairs are nearest.

    searches: each returns the pairs of one kind at a (4, 4) motion. Weights are Tukey's bisquare
    of the scatter of each kind (Zhang and Singh's weights have this form), wider at first: most
    pairs belong to ground and walls along the road, and fit whatever the forward motion is.
    """
    pose, free_mask = start.copy(), np.array(free)
    for round_number in range(most):
        kinds = [search(pose) for search in searches]
        pairs = joined(kinds)
        if len(pairs.points) < free_mask.sum():
            break
        weights = pair_weights(kinds, pose, WIDER[min(round_number, len(WIDER) - 1)])
        previous, pose = pose, descend(pairs, weights, pose, free_mask)
        step = np.abs(log_se3(inverse(previous) @ pose))
        small = step[:3].max() < SHIFT_M and step[3:].max() < TURN_RAD
        if small and round_number + 1 >= len(WIDER):
            break
    return _feature_match([search(pose) for search in searches], orthonormal(pose))


def joined(kinds: list[Pairs]) -> Pairs:
    """Return pairs one after the other."""
    if not kinds:
        return Pairs(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2, 3)))
    return Pairs(*(np.concatenate(each) for each in zip(*kinds, strict=True)))


def _search(
    kernel: Callable[..., Pairs],
    points: np.ndarray,
    labels: np.ndarray,
    rings: np.ndarray,
    table: RingTable,
    reach_m: float,
) -> Callable[[np.ndarray], Pairs]:
    return lambda pose: kernel(points, labels, rings, table, pose, reach_m)


def _labels(labels: np.ndarray, same_label: bool) -> np.ndarray:
    return labels if same_label else np.full_like(labels, -1)


def pair_weights(kinds: list[Pairs], pose: np.ndarray, wider: float = 1.0) -> np.ndarray:
    """Return the weight of each pair, 1/m^2, by the bisquare of its kind."""
    each = [bisquare(distances(pairs, pose), NOISE_M, wider) for pairs in kinds]
    return np.concatenate([np.empty(0), *each])


def _feature_match(kinds: list[Pairs], pose: np.ndarray) -> FeatureMatch:
    pairs, weights = joined(kinds), pair_weights(kinds, pose)
    information, _, _ = normal_equations(pairs, weights, pose)
    squares = weights @ distances(pairs, pose) ** 2
    residual_m = float(np.sqrt(squares / weights.sum())) if len(weights) else float("nan")
    return FeatureMatch(pose, information, residual_m, int((weights > 0).sum()))
