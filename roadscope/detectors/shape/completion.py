"""The whole of a body from a rectangle's heading and the faces turned to the sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.bodies import BODIES, LONGEST_M, WIDEST_M, body_table
from roadscope.detectors.shape.cluster import Cluster
from roadscope.detectors.shape.heading_kernels import hull_heading
from roadscope.detectors.shape.recognition import Vehicle

# --------------------------------------------------------------------------------------------------
# From what is seen of a body, and which way it is turned, to the whole of it.

FACE_M = 0.4
"""How deep a face is taken to be: range noise, and corners of 0.35 m."""
SLACK_M = 0.1
"""Uncertainty of an edge beside the spacing of the returns: noise and rounding."""
LOST, GRAZING = 0.1, 0.2
"""Chance that the far end of a face returns nothing, and the cosine of incidence at which it has
grown by most of the rest: what is met at a grazing angle returns too little to be seen."""
CORNER_M, NO_FACE = 0.5, 0.6
"""As much of a side as a rounded corner and noise show of it; no more than that is rather a side
that returns nothing than a short one."""
UNSEEN = 0.25
"""Density per metre of how much shows of a side that no light falls on."""
LEVELS = 5
"""Beams on a body from which on its highest return tells its height."""
CLIPPED_M = 2.2
"""From here up the highest return tells a least height only: above, returns are dropped."""


class Seen(NamedTuple):
    """What a cluster shows; the fields are a `Cluster`'s.

    outline: (M, 2). points: (N, 3). ring: (N,). origin: (2,).
    """

    outline: np.ndarray
    points: np.ndarray
    ring: np.ndarray
    origin: np.ndarray


@compiled()
def diagonal(points: np.ndarray) -> float:
    """Diagonal of the upright box seen from above around points (N, 2 or 3), N at least 1."""
    x, y = points[0, 0], points[0, 1]
    left, right, low, high = x, x, y, y
    for i in range(1, len(points)):
        x, y = points[i, 0], points[i, 1]
        left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
    return float(np.hypot(right - left, high - low))


@compiled()
def least_bodies(
    seen: Seen, around: tuple[tuple[bool, bool], float], bodies: np.ndarray
) -> np.ndarray:
    """Return (1, 9) what `whole_bodies` does for the heading of the least rectangle around all."""
    points = seen.points[:, :2]
    order = np.argsort(points[:, 1], kind="mergesort")
    order = order[np.argsort(points[order, 0], kind="mergesort")]
    return whole_bodies(seen, around, np.array([hull_heading(points[order])]), bodies)


@compiled()
def whole_bodies(
    seen: Seen, around: tuple[tuple[bool, bool], float], yaws: np.ndarray, bodies: np.ndarray
) -> np.ndarray:
    """Return (Y, 9) what completes a cluster for each of (Y,) headings.

    Row of the body, negative where it is too large for any; x and y of its centre; length, width,
    height; yaw in [-pi/2, pi/2]; root mean square distance of the outline from the faces; log
    likelihood. around: whether a body may go on beyond the right and the left end of the
    outline, and radians from column to column. bodies: (K, 7), `body_table`.
    """
    hidden, step = around
    out, tall = np.zeros((len(yaws), 9)), heights(seen.points, seen.ring)
    for k in range(len(yaws)):
        yaw, row = yaws[k], out[k]
        sides, is_open, residual = seen_sides(seen, yaw, hidden)
        first, second = sides[0, 1] - sides[0, 0], sides[1, 1] - sides[1, 0]
        faces = sides[0, 2] != 0.0 or sides[1, 2] != 0.0
        if not faces or min(first, second) > WIDEST_M or max(first, second) > LONGEST_M:
            row[0] = -1.0
            continue
        body, axis, fit, extents = whole_body(sides, is_open, step, tall, bodies)
        u = centre_along(sides[0], is_open[0], extents[0])
        v = centre_along(sides[1], is_open[1], extents[1])
        cos, sin = np.cos(yaw), np.sin(yaw)
        row[0], row[1], row[2] = body, u * cos - v * sin, u * sin + v * cos
        row[3], row[4] = extents[axis], extents[1 - axis]
        row[5] = _height(bodies[body, 5], bodies[body, 6], tall)
        row[6] = np.arctan(np.tan(yaw + axis * 0.5 * np.pi))
        row[7], row[8] = residual, fit
    return out


@compiled()
def heights(points: np.ndarray, ring: np.ndarray) -> tuple[float, float]:
    """Highest return, and how far above it the body may end; -1 where that is not known."""
    top, bottom = points[0, 2], points[0, 2]
    met = np.zeros(ring.max() + 1, np.bool_)
    for i in range(len(points)):
        top, bottom = max(top, points[i, 2]), min(bottom, points[i, 2])
        met[ring[i]] = True
    levels = met.sum()
    if levels < LEVELS or top > CLIPPED_M:
        return top, -1.0
    return top, (top - bottom) / (levels - 1)


@compiled()
def _height(usual: float, spread: float, tall: tuple[float, float]) -> float:
    """Height of a body in metres: the usual one, drawn to where its returns end if that is told."""
    top, gap = tall
    if gap < 0.0:
        return max(usual, top)
    doubt = SLACK_M * SLACK_M + gap * gap / 12.0
    drawn = (usual * doubt + (top + 0.5 * gap) * spread * spread) / (doubt + spread * spread)
    return max(drawn, top)


@compiled()
def seen_sides(
    seen: Seen, yaw: float, hidden: tuple[bool, bool]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Look at a body along the two axes of its heading.

    hidden: whether the body may go on beyond the right and the left end of the outline.
    Returns sides (2, 5): lowest and highest seen, which side faces the sensor (-1, 1, or 0 when
    it stands in between), place of that face, place of the sensor; open (2, 2) bool: whether the
    body may go on below and above; and the root mean square distance of the outline from the
    faces, metres.
    """
    outline, points, origin = seen.outline, seen.points, seen.origin
    sides, is_open = np.zeros((2, 5)), np.zeros((2, 2), np.bool_)
    for k in range(2):
        x, y = (np.cos(yaw), np.sin(yaw)) if k == 0 else (-np.sin(yaw), np.cos(yaw))
        low, high = np.inf, -np.inf
        for i in range(len(points)):
            u = points[i, 0] * x + points[i, 1] * y
            low, high = min(low, u), max(high, u)
        sensor = origin[0] * x + origin[1] * y
        facing = -1.0 if sensor < low else (1.0 if sensor > high else 0.0)
        sides[k] = low, high, facing, _face(outline, x, y, facing), sensor
    total = 0.0
    for i in range(len(outline)):
        off = _off_faces(outline[i], yaw, sides)
        total += min(off[0], off[1]) ** 2
    for end in range(2):
        if hidden[end]:
            # On a face across axis 0 the body goes on along axis 1, and the other way round.
            off = _off_faces(outline[-end], yaw, sides)
            along = 1 if off[0] <= off[1] else 0
            is_open[along, 1 if off[2 + along] > sides[along, :2].sum() / 2 else 0] = True
    return sides, is_open, np.sqrt(total / len(outline))


@compiled()
def _off_faces(
    point: np.ndarray, yaw: float, sides: np.ndarray
) -> tuple[float, float, float, float]:
    """Distances of a (2,) point from the faces along both axes, inf without; its coordinates."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    u, v = point[0] * cos + point[1] * sin, point[1] * cos - point[0] * sin
    off_u = abs(u - sides[0, 3]) if sides[0, 2] != 0.0 else np.inf
    off_v = abs(v - sides[1, 3]) if sides[1, 2] != 0.0 else np.inf
    return off_u, off_v, u, v


@compiled()
def _face(outline: np.ndarray, x: float, y: float, facing: float) -> float:
    """Mean coordinate of the outline's points on the side that faces the sensor."""
    edge = np.inf
    for i in range(len(outline)):
        edge = min(edge, -facing * (outline[i, 0] * x + outline[i, 1] * y))
    count, total = 0, 0.0
    for i in range(len(outline)):
        u = -facing * (outline[i, 0] * x + outline[i, 1] * y)
        if u <= edge + FACE_M:
            count, total = count + 1, total + u
    return -facing * total / count


@compiled()
def whole_body(
    sides: np.ndarray,
    is_open: np.ndarray,
    step: float,
    tall: tuple[float, float],
    bodies: np.ndarray,
) -> tuple[int, int, float, np.ndarray]:
    """Choose the kind of body and which axis is its length; complete both extents.

    tall: highest return and how far above it the body may end; a negative second: any height
    above. bodies: (K, 7), `body_table`.
    Returns row of the body, axis of its length, log likelihood and (2,) extents along the axes.
    """
    best, row, axis = -np.inf, -1, 0
    for b in range(len(bodies)):
        high = _height_fits(tall, bodies[b, 5], bodies[b, 6])
        for length_axis in range(2):
            total = bodies[b, 0] + high
            for k in range(2):
                column = 1 if k == length_axis else 3
                size = bodies[b, column], bodies[b, column + 1]
                total += _side_fits(k, sides, is_open, step, size)[0]
            if total > best:
                best, row, axis = total, b, length_axis
    extents = np.empty(2)
    for k in range(2):
        column = 1 if k == axis else 3
        size = bodies[row, column], bodies[row, column + 1]
        extents[k] = _side_fits(k, sides, is_open, step, size)[1]
    return row, axis, best, extents


@compiled()
def centre_along(side: np.ndarray, is_open: np.ndarray, extent: float) -> float:
    """Middle of a body of this extent along one axis."""
    low, high, facing, face = side[0], side[1], side[2], side[3]
    middle: float = 0.5 * (low + high)
    if is_open[0] and not is_open[1]:
        middle = (face if facing > 0.0 else high) - 0.5 * extent
    elif is_open[1] and not is_open[0]:
        middle = (face if facing < 0.0 else low) + 0.5 * extent
    elif facing != 0.0 and not is_open[0]:
        middle = face - facing * 0.5 * extent
    return middle


@compiled()
def _side_fits(
    k: int, sides: np.ndarray, is_open: np.ndarray, step: float, size: tuple[float, float]
) -> tuple[float, float]:
    """Log likelihood of what is seen along axis k for a known extent, and the expected extent.

    What is seen is either the whole, less up to a spacing of returns, or any part of it. size:
    mean and standard deviation of the extent, metres.
    """
    mean, spread = size
    low, high, facing, face, sensor = sides[k]
    other = sides[1 - k]
    across = abs(other[3] - other[4]) if other[2] != 0.0 else 0.0
    if facing == 0.0:
        seen, far = high - low, max(abs(high - sensor), abs(low - sensor))
    else:
        seen = high - face if facing < 0 else face - low
        far = abs(face - sensor) + seen
    reach = np.sqrt(far * far + across * across)
    hidden = is_open[k, 0] or is_open[k, 1]
    part, spacing = 1.0, 0.0
    # Something in front cuts a side anywhere; grazing light leaves nothing of it.
    cut = 1.0 / max(mean, 0.5) if hidden else UNSEEN
    if not hidden and across > 0.0:
        cosine = across / reach
        spacing = min(reach * step / max(cosine, 1e-3), 5.0)
        part = LOST + (1.0 - LOST) * np.exp(-cosine / GRAZING)
        if facing != 0.0 and seen < CORNER_M:
            part = max(part, NO_FACE)
    ends = 2.0 if facing == 0.0 else 1.0
    whole = seen + 0.5 * ends * spacing
    error = 0.3 * ends * spacing + SLACK_M
    variance = error * error + spread * spread
    closed = (1.0 - part) * np.exp(-0.5 * (whole - mean) ** 2 / variance) / np.sqrt(variance)
    closed *= 0.39894228
    slack = np.sqrt(spread * spread + SLACK_M * SLACK_M)
    z = (seen - mean) / slack
    beyond = 0.5 * math.erfc(z * 0.70710678)
    started = part * beyond * cut
    from_whole = (whole * spread * spread + mean * error * error) / variance
    # Mean of a normal that is known to lie above what is seen.
    tail = 0.39894228 * np.exp(-0.5 * z * z) / max(beyond, 1e-12)
    from_part = max(mean + slack * tail, seen) if z < 6.0 else seen
    weight = closed / max(closed + started, 1e-300)
    extent = weight * from_whole + (1.0 - weight) * from_part
    return np.log(max(closed + started, 1e-300)), max(extent, 0.9 * seen)


@compiled()
def _height_fits(tall: tuple[float, float], mean: float, spread: float) -> float:
    """Log likelihood of the highest return on a body of a known height."""
    top, gap = tall
    slack = np.sqrt(spread * spread + SLACK_M * SLACK_M)
    fits: float = 0.0
    if gap < 0.0:
        fits = np.log(max(0.5 * math.erfc((top - mean) / slack * 0.70710678), 1e-300))
    else:
        variance = slack * slack + gap * gap / 12.0
        off = top + 0.5 * gap - mean
        fits = -0.5 * off * off / variance - 0.5 * np.log(variance)
    return fits


# --------------------------------------------------------------------------------------------------
# The whole of a body of which a rectangle's heading and the faces turned to the sensor are known.

MIN_POINTS = 3
LEAST_M = 0.25
"""Least diagonal of what is seen: a thin post is nobody."""
FIT_MIN = -18.0
"""Least log likelihood of the best kind of body; far below that of any that was seen."""
Shown = tuple[Seen, tuple[tuple[bool, bool], float]]
"""What kernels ask of a cluster, and of what is hidden about it."""
_table = cache(body_table)


def is_body_sized(cluster: Cluster) -> bool:
    """Whether a cluster has enough returns and may be a road user by its extent."""
    if len(cluster.points) < MIN_POINTS:
        return False
    return bool(LEAST_M <= diagonal(cluster.points) <= LONGEST_M + WIDEST_M)


def completions(cluster: Cluster, yaws: Sequence[float], horizon: Horizon) -> list[Vehicle | None]:
    """Return the road user that shows a cluster for each heading, None where it is too large.

    yaws: radians, along either side of the rectangle.
    """
    return whole_ones(shown(cluster, horizon), yaws)


def least_rectangle(cluster: Cluster, horizon: Horizon) -> Vehicle | None:
    """Return what `completions` does for the heading of a cluster's minimum-area rectangle."""
    return least_one(shown(cluster, horizon))


def whole_ones(seen: Shown, yaws: Sequence[float]) -> list[Vehicle | None]:
    """Return what completes what is shown, for each of several headings."""
    rows = whole_bodies(*seen, np.array(yaws), _table())
    return [_vehicle(row, len(seen[0].outline)) for row in rows.tolist()]


def least_one(seen: Shown) -> Vehicle | None:
    """Return what completes what is shown, for the heading of its minimum-area rectangle."""
    (row,) = least_bodies(*seen, _table()).tolist()
    return _vehicle(row, len(seen[0].outline))


def shown(cluster: Cluster, horizon: Horizon) -> Shown:
    """Return what a cluster shows, and what is hidden about it."""
    seen = Seen(cluster.outline, cluster.points, cluster.ring, cluster.origin)
    return seen, (horizon.hides(cluster.outline), horizon.step)


def _vehicle(row: list[float], points: int) -> Vehicle | None:
    """Return the vehicle that a row of `whole_bodies` describes, None for none that fits."""
    body, x, y, length, width, height, yaw, residual_m, fit = row
    if body < 0 or fit < FIT_MIN:
        return None
    category = BODIES[int(body)].category
    return Vehicle((x, y), (length, width, height), yaw, category, residual_m, points, fit)
