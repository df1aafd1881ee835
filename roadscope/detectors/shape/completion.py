"""Completes a cluster to a whole body, from a heading and the faces turned to the sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from roadscope.core import wrap_angle
from roadscope.core.jit import compiled
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.bodies import BODIES, LONGEST_M, WIDEST_M, BodyTable, body_table
from roadscope.detectors.shape.cluster import Cluster, diagonal
from roadscope.detectors.shape.recognition import Vehicle

# --------------------------------------------------------------------------------------------------
# The bodies in a cluster; one that holds several is cut where its outline jumps.

MIN_POINTS = 3
"""Least number of returns of a road user."""
LEAST_M = 0.25
"""Least diagonal of a cluster: a thin post is no road user. Chosen by hand."""
FIT_MIN = -18.0
"""Least log likelihood of the best kind of body; far below that of any road user in our scans."""
JUMP_M = 0.6
"""Neighbouring outline points farther apart may lie on two bodies. Round corners and range noise
give smaller gaps on one body."""
RAGGED_M = 0.3
"""Greatest root mean square distance of an outline from its faces; above it the outline is probably
that of two bodies. It is three times the range noise of the LUX."""
CUTS = 3
"""A cluster is cut in two, its parts are cut again, and so on, at most so often."""

Fit = Callable[[Cluster, Horizon], Vehicle | None]
"""Returns the road user that fits a cluster, None if none does."""


def bodies_in(cluster: Cluster, horizon: Horizon, fit: Fit, *, cuts: int = CUTS) -> list[Vehicle]:
    """Return the road user that fits a cluster, or those that fit its parts.

    The cluster is cut if it is too large, if no road user fits, or if the outline departs from the
    faces of the one that fits best.
    """
    # Parts are no larger.
    if len(cluster.points) < MIN_POINTS or (extent_m := diagonal(cluster.points)) < LEAST_M:
        return []
    vehicle = fit(cluster, horizon) if extent_m <= LONGEST_M + WIDEST_M else None
    if vehicle is not None and vehicle.residual_m <= RAGGED_M:
        return [vehicle]
    parts = cut(cluster) if cuts else []
    bodies = [body for part in parts for body in bodies_in(part, horizon, fit, cuts=cuts - 1)]
    return bodies if bodies or vehicle is None else [vehicle]


def cut(cluster: Cluster) -> list[Cluster]:
    """Return the parts on either side of the widest jump of the outline; none without a jump."""
    steps = np.diff(cluster.outline, axis=0)
    gaps = np.hypot(steps[:, 0], steps[:, 1])
    if not len(gaps) or gaps.max() < JUMP_M:
        return []
    last = int(gaps.argmax())
    ahead = cluster.outline.mean(axis=0) - cluster.origin
    middle = np.arctan2(ahead[1], ahead[0])
    ends = _azimuths(cluster.outline[last : last + 2], cluster.origin, middle)
    left = _azimuths(cluster.points[:, :2], cluster.origin, middle) > ends.mean()
    return [
        Cluster(cluster.points[m], cluster.ring[m], cluster.column[m], outline, cluster.origin)
        for m, outline in (
            (~left, cluster.outline[: last + 1]),
            (left, cluster.outline[last + 1 :]),
        )
    ]


def _azimuths(points: np.ndarray, origin: np.ndarray, middle: float) -> np.ndarray:
    """Return the azimuths of (N, 2) points from the sensor, relative to `middle`, radians."""
    x, y = (points - origin).T
    return np.asarray(wrap_angle(np.arctan2(y, x) - middle))


# --------------------------------------------------------------------------------------------------
# The whole body, from a rectangle's heading and the faces that are turned to the sensor.


class ShownCluster(NamedTuple):
    """A cluster, and whether more of its body may be hidden beyond the ends of its outline.

    outline: (M, 2) metres. points: (N, 3) metres. ring: (N,) int64. origin: (2,) metres, the
    sensor. hidden_right, hidden_left: whether something nearer may hide a part of the body beyond
    the right and the left end of the outline. step: radians from column to column.
    """

    outline: np.ndarray
    points: np.ndarray
    ring: np.ndarray
    origin: np.ndarray
    hidden_right: bool
    hidden_left: bool
    step: float


_table = cache(body_table)


def completions(cluster: Cluster, yaws: Sequence[float], horizon: Horizon) -> list[Vehicle | None]:
    """Return for each heading the road user that fits a cluster, None where it is too large.

    yaws: radians, along either side of the rectangle.
    """
    return completed(shown_by(cluster, horizon), yaws)


def shown_by(cluster: Cluster, horizon: Horizon) -> ShownCluster:
    """Return a cluster with the ends beyond which a part of its body may be hidden."""
    return ShownCluster(
        cluster.outline,
        cluster.points,
        cluster.ring,
        cluster.origin,
        *horizon.hides(cluster.outline),
        horizon.step,
    )


def completed(shown: ShownCluster, yaws: Sequence[float]) -> list[Vehicle | None]:
    """Return the same as `completions`, for a `ShownCluster`."""
    rows = whole_bodies(shown, np.array(yaws), _table())
    return [_vehicle(row, len(shown.outline)) for row in rows.tolist()]


def _vehicle(row: list[float], points: int) -> Vehicle | None:
    """Return the vehicle that a row of `whole_bodies` describes, None if no body fits."""
    body, x, y, length, width, height, yaw, residual_m, fit = row
    if body < 0 or fit < FIT_MIN:
        return None
    category = BODIES[int(body)].category
    return Vehicle((x, y), (length, width, height), yaw, category, residual_m, points, fit)


# --------------------------------------------------------------------------------------------------
# Kernels: the likeliest body whose visible sides are those of a cluster.

FACE_M = 0.4
"""Outline points up to this far behind the nearest one belong to a face: range noise, and corners
of 0.35 m."""
SLACK_M = 0.1
"""Standard deviation of an edge, besides the spacing of the returns: noise and round corners.
Chosen by hand."""
LOST, GRAZING = 0.1, 0.2
"""The far part of a side has no returns with the probability LOST + (1 - LOST) exp(-c / GRAZING),
where c is the cosine of incidence: at grazing incidence too little light comes back. Chosen by
hand."""
CORNER_M, NO_FACE = 0.5, 0.6
"""If less than `CORNER_M` of a side is visible, which a round corner and noise can show of any
side, this probability is at least `NO_FACE`. Chosen by hand."""
PARTIAL_DENSITY = 0.25
"""Probability density, 1/m, of the visible length of a side whose far part has no returns. Chosen
by hand."""
MOST_SPACING_M = 5.0
"""Greatest spacing of returns along a side. Chosen by hand."""
SPACING_SHARE = 0.3
"""Standard deviation of an end between two beams, as a share of their spacing: that of a uniform
distribution is 12^-1/2."""
LEVELS = 5
"""With returns of at least so many beams on a body, the highest one shows its height. Chosen by
hand."""
CLIPPED_M = 2.2
"""A highest return above this only bounds the height from below, because ground removal drops
higher ones."""


class BodySide(NamedTuple):
    """A body along one of its axes; coordinates along the axis in metres.

    low, high: least and greatest coordinate of a return. facing: end that faces the sensor, -1 for
    the low one, 1 for the high one, 0 if the sensor is in between. face: coordinate of the face at
    that end. sensor: coordinate of the sensor. open_low, open_high: whether a part of the body may
    be hidden beyond the low and the high end.
    """

    low: float
    high: float
    facing: float
    face: float
    sensor: float
    open_low: bool
    open_high: bool


@compiled()
def whole_bodies(shown: ShownCluster, yaws: np.ndarray, bodies: BodyTable) -> np.ndarray:
    """Return (Y, 9), the body that fits a cluster with each of (Y,) headings, radians.

    Columns: row of the body in the table, negative where the cluster is too large for any; x and y
    of its centre; length, width, height; yaw in [-pi/2, pi/2]; root mean square distance of the
    outline from the faces; log likelihood.
    """
    out = np.zeros((len(yaws), 9))
    top, gap = _top_and_gap(shown.points, shown.ring)
    for k in range(len(yaws)):
        yaw, row = yaws[k], out[k]
        one, other, residual = _visible_sides(shown, yaw)
        first, second = one.high - one.low, other.high - other.low
        faces = one.facing != 0.0 or other.facing != 0.0
        if not faces or min(first, second) > WIDEST_M or max(first, second) > LONGEST_M:
            row[0] = -1.0
            continue
        body, across, fit = _likeliest_body(one, other, shown.step, top, gap, bodies)
        first_size, second_size = (1, 0) if across else (0, 1)
        mean, spread = bodies.means[body], bodies.spreads[body]
        _, first = _side_fits(one, other, shown.step, mean[first_size], spread[first_size])
        _, second = _side_fits(other, one, shown.step, mean[second_size], spread[second_size])
        u, v = _centre_along(one, first), _centre_along(other, second)
        cos, sin = np.cos(yaw), np.sin(yaw)
        row[0], row[1], row[2] = body, u * cos - v * sin, u * sin + v * cos
        row[3], row[4] = (second, first) if across else (first, second)
        row[5] = max(mean[2], top)
        if gap >= 0.0:
            # Mean of the prior height and of where the returns end, weighted by their variances.
            variance = SLACK_M * SLACK_M + gap * gap / 12.0
            weighted = mean[2] * variance + (top + 0.5 * gap) * spread[2] * spread[2]
            row[5] = max(weighted / (variance + spread[2] * spread[2]), top)
        row[6] = np.arctan(np.tan(yaw + (0.5 * np.pi if across else 0.0)))
        row[7], row[8] = residual, fit
    return out


@compiled()
def _top_and_gap(points: np.ndarray, ring: np.ndarray) -> tuple[float, float]:
    """Return the highest z, and how far above it the body may end, metres; -1 if unknown."""
    top, bottom = points[0, 2], points[0, 2]
    has_return = np.zeros(ring.max() + 1, np.bool_)
    for i in range(len(points)):
        top, bottom = max(top, points[i, 2]), min(bottom, points[i, 2])
        has_return[ring[i]] = True
    levels = has_return.sum()
    if levels < LEVELS or top > CLIPPED_M:
        return top, -1.0
    return top, (top - bottom) / (levels - 1)


@compiled()
def _visible_sides(shown: ShownCluster, yaw: float) -> tuple[BodySide, BodySide, float]:
    """Return a cluster's body along a heading, across it, and the misfit of the outline.

    The misfit is the root mean square distance of the outline from the nearer face, metres.
    """
    cos, sin = np.cos(yaw), np.sin(yaw)
    one, other = _side_along(shown, cos, sin), _side_along(shown, -sin, cos)
    outline, total = shown.outline, 0.0
    for i in range(len(outline)):
        x, y = outline[i]
        off = _distance(one, x * cos + y * sin), _distance(other, y * cos - x * sin)
        total += min(off[0], off[1]) ** 2
    open_one, open_other = np.zeros(2, np.bool_), np.zeros(2, np.bool_)
    for end in range(2):
        if shown.hidden_left if end else shown.hidden_right:
            x, y = outline[-end]
            u, v = x * cos + y * sin, y * cos - x * sin
            # If the outline ends on a face across one axis, its body may continue along the other.
            if _distance(one, u) <= _distance(other, v):
                open_other[1 if v > (other.low + other.high) / 2 else 0] = True
            else:
                open_one[1 if u > (one.low + one.high) / 2 else 0] = True
    return (
        BodySide(one.low, one.high, one.facing, one.face, one.sensor, open_one[0], open_one[1]),
        BodySide(
            other.low,
            other.high,
            other.facing,
            other.face,
            other.sensor,
            open_other[0],
            open_other[1],
        ),
        np.sqrt(total / len(outline)),
    )


@compiled()
def _side_along(shown: ShownCluster, x: float, y: float) -> BodySide:
    """Return a body along the axis (x, y), a unit vector; `open_low` and `open_high` are False.

    Its face is at the mean of the outline's points on the side that is turned to the sensor.
    """
    low, high = np.inf, -np.inf
    for i in range(len(shown.points)):
        u = shown.points[i, 0] * x + shown.points[i, 1] * y
        low, high = min(low, u), max(high, u)
    sensor = shown.origin[0] * x + shown.origin[1] * y
    facing = -1.0 if sensor < low else (1.0 if sensor > high else 0.0)
    outline, edge = shown.outline, np.inf
    for i in range(len(outline)):
        edge = min(edge, -facing * (outline[i, 0] * x + outline[i, 1] * y))
    count, total = 0, 0.0
    for i in range(len(outline)):
        u = -facing * (outline[i, 0] * x + outline[i, 1] * y)
        if u <= edge + FACE_M:
            count, total = count + 1, total + u
    return BodySide(low, high, facing, -facing * total / count, sensor, False, False)


@compiled(borrowing=True)
def _distance(side: BodySide, coordinate: float) -> float:
    """Return the distance of a coordinate from the face; inf if no side faces the sensor."""
    return abs(coordinate - side.face) if side.facing != 0.0 else np.inf


@compiled()
def _likeliest_body(
    one: BodySide, other: BodySide, step: float, top: float, gap: float, bodies: BodyTable
) -> tuple[int, bool, float]:
    """Return the kind of body, whether its length is along the other axis, and log likelihood.

    top, gap: as from `_top_and_gap`. step: radians from column to column.
    """
    best, body, across = -np.inf, -1, False
    for b in range(len(bodies.log_shares)):
        mean, spread = bodies.means[b], bodies.spreads[b]
        slack = np.sqrt(spread[2] * spread[2] + SLACK_M * SLACK_M)
        if gap < 0.0:
            height_fit = np.log(max(0.5 * math.erfc((top - mean[2]) / slack * 0.70710678), 1e-300))
        else:
            variance = slack * slack + gap * gap / 12.0
            off = top + 0.5 * gap - mean[2]
            height_fit = -0.5 * off * off / variance - 0.5 * np.log(variance)
        for along in range(2):
            total = bodies.log_shares[b] + height_fit
            total += _side_fits(one, other, step, mean[along], spread[along])[0]
            total += _side_fits(other, one, step, mean[1 - along], spread[1 - along])[0]
            if total > best:
                best, body, across = total, b, along == 1
    return body, across, best


@compiled()
def _centre_along(side: BodySide, extent: float) -> float:
    """Return the coordinate of the centre of a body of this extent along one axis, metres."""
    middle: float = 0.5 * (side.low + side.high)
    if side.open_low and not side.open_high:
        middle = (side.face if side.facing > 0.0 else side.high) - 0.5 * extent
    elif side.open_high and not side.open_low:
        middle = (side.face if side.facing < 0.0 else side.low) + 0.5 * extent
    elif side.facing != 0.0 and not side.open_low:
        middle = side.face - side.facing * 0.5 * extent
    return middle


@compiled()
def _side_fits(
    side: BodySide, other: BodySide, step: float, mean: float, spread: float
) -> tuple[float, float]:
    """Return the log likelihood of the visible extent along an axis, and the expected extent.

    Either the whole extent is visible, except for up to one spacing of returns at each far end, or
    any part of it is. other: the other axis. step: radians from column to column. mean, spread:
    prior mean and standard deviation of the extent, metres.
    """
    across = abs(other.face - other.sensor) if other.facing != 0.0 else 0.0
    if side.facing == 0.0:
        visible = side.high - side.low
        far = max(abs(side.high - side.sensor), abs(side.low - side.sensor))
    else:
        visible = side.high - side.face if side.facing < 0 else side.face - side.low
        far = abs(side.face - side.sensor) + visible
    reach = np.sqrt(far * far + across * across)
    hidden = side.open_low or side.open_high
    partial, spacing = 1.0, 0.0
    # Behind a nearer object, and at grazing incidence, the returns of a side may end anywhere.
    density = 1.0 / max(mean, 0.5) if hidden else PARTIAL_DENSITY
    if not hidden and across > 0.0:
        cosine = across / reach
        spacing = min(reach * step / max(cosine, 1e-3), MOST_SPACING_M)
        partial = LOST + (1.0 - LOST) * np.exp(-cosine / GRAZING)
        if side.facing != 0.0 and visible < CORNER_M:
            partial = max(partial, NO_FACE)
    ends = 2.0 if side.facing == 0.0 else 1.0
    whole = visible + 0.5 * ends * spacing
    error = SPACING_SHARE * ends * spacing + SLACK_M
    variance = error * error + spread * spread
    by_whole = (1.0 - partial) * np.exp(-0.5 * (whole - mean) ** 2 / variance) / np.sqrt(variance)
    by_whole *= 0.39894228
    slack = np.sqrt(spread * spread + SLACK_M * SLACK_M)
    z = (visible - mean) / slack
    beyond = 0.5 * math.erfc(z * 0.70710678)
    by_part = partial * beyond * density
    from_whole = (whole * spread * spread + mean * error * error) / variance
    # Mean of the prior on the condition that the extent exceeds the visible one.
    tail = 0.39894228 * np.exp(-0.5 * z * z) / max(beyond, 1e-12)
    from_part = max(mean + slack * tail, visible) if z < 6.0 else visible
    weight = by_whole / max(by_whole + by_part, 1e-300)
    extent = weight * from_whole + (1.0 - weight) * from_part
    return np.log(max(by_whole + by_part, 1e-300)), max(extent, 0.9 * visible)
