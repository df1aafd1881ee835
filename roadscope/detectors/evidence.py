"""Features of boxes in a scan, from which their scores are computed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.recognition import Vehicle

# --------------------------------------------------------------------------------------------------
# Kernels: counts of the returns and of the rays in and around each box.

CELL_M = 4.0
"""Side of the cells into which returns are sorted; it changes the time only."""
EDGE_M = 0.25
"""Returns up to this far outside a box still belong to it, because of noise. Chosen by hand."""
DEEP_M = 0.5
"""Returns at least this far inside every side of a box are deep within it. Chosen by hand."""
AROUND_M = 1.5
"""Width of the neighbourhood around a box. Chosen by hand."""
FLOOR_M, LOW_M, DECK_M, CEILING_M = 0.12, 0.3, 0.8, 2.5
"""Heights above the road, chosen by hand. Below `FLOOR_M` returns are of the ground. Above `LOW_M`
they are of an object. Below `DECK_M` a closed body has returns at its sides only. Above `CEILING_M`
they are of tree crowns, buildings and lorries."""

COUNTS = (
    "body",
    "ground",
    "deep",
    "low",
    "top",
    "bottom",
    "levels",
    "depth",
    "above",
    "top_level",
    "ends",
    "sides",
    "overhang",
)
"""Columns of `count_returns`."""
BODY, GROUND, DEEP, LOW, TOP, BOTTOM, LEVELS, DEPTH, ABOVE, TOP_LEVEL, ENDS, SIDES, OVERHANG = (
    range(len(COUNTS))
)


class ReturnCells(NamedTuple):
    """Points sorted into square cells seen from above.

    order: (N,) int64 rows, cell by cell. starts: (X * Y + 1,) int64, where each cell begins in it.
    low_x, low_y: least coordinates of the cells, metres. count_x, count_y: numbers of cells.
    """

    order: np.ndarray
    starts: np.ndarray
    low_x: float
    low_y: float
    count_x: int
    count_y: int


class BoxAxes(NamedTuple):
    """Centre of a box, cosine and sine of its yaw, half length and half width; metres."""

    x: float
    y: float
    cos: float
    sin: float
    half_length: float
    half_width: float


@compiled()
def sort_to_cells(points: np.ndarray) -> ReturnCells:
    """Sort (N, 3) points, metres, N at least 1, into square cells seen from above."""
    low_x, low_y = points[:, 0].min(), points[:, 1].min()
    nx = int((points[:, 0].max() - low_x) / CELL_M) + 1
    ny = int((points[:, 1].max() - low_y) / CELL_M) + 1
    starts = np.zeros(nx * ny + 1, np.int64)
    cells = np.empty(len(points), np.int64)
    for i in range(len(points)):
        cell = int((points[i, 0] - low_x) / CELL_M) * ny + int((points[i, 1] - low_y) / CELL_M)
        cells[i] = cell
        starts[cell + 1] += 1
    for c in range(nx * ny):
        starts[c + 1] += starts[c]
    order, filled = np.empty(len(points), np.int64), starts[:-1].copy()
    for i in range(len(points)):
        order[filled[cells[i]]] = i
        filled[cells[i]] += 1
    return ReturnCells(order, starts, low_x, low_y, nx, ny)


@compiled()
def count_returns(
    boxes: np.ndarray, points: np.ndarray, ring: np.ndarray, cells: ReturnCells
) -> np.ndarray:
    """Return (B, 13) `COUNTS` of boxes (B, 5): centre x and y, length, width, yaw.

    body: returns within the box, between floor and ceiling. ground: returns of the ground deep
    within it. low: returns within it below the deck. deep: how many of these lie deep within it.
    depth: mean distance of the low ones from the nearest side, at most `2 * DEEP_M`, metres. top,
    bottom: greatest and least height of the body's returns, metres. levels: number of their beams.
    top_level: the highest of their beams. above: returns within the box above the ceiling. ends,
    sides: returns of objects in the neighbourhood, beyond the ends of the box and beside it.
    overhang: returns above the ceiling in the neighbourhood.

    boxes, points (N, 3): metres and radians, ego frame. ring: (N,) int64, beams, lowest first.
    cells: result of `sort_to_cells` for the points.
    """
    out, has_return = np.zeros((len(boxes), len(COUNTS))), np.empty(int(ring.max()) + 1, np.bool_)
    for b in range(len(boxes)):
        x, y, length, width, yaw = boxes[b]
        reach = np.hypot(0.5 * length, 0.5 * width) + AROUND_M
        box = BoxAxes(x, y, np.cos(yaw), np.sin(yaw), 0.5 * length, 0.5 * width)
        first_x, last_x = _span(x, reach, cells.low_x, cells.count_x)
        first_y, last_y = _span(y, reach, cells.low_y, cells.count_y)
        if last_y < first_y:
            continue
        row, has_return[:] = out[b], False
        row[BOTTOM] = np.inf
        for cell_x in range(first_x, last_x + 1):
            column = cell_x * cells.count_y
            for k in range(cells.starts[column + first_y], cells.starts[column + last_y + 1]):
                i = cells.order[k]
                if _count(points[i, 0], points[i, 1], points[i, 2], box, row):
                    has_return[ring[i]] = True
                    row[TOP_LEVEL] = max(row[TOP_LEVEL], ring[i])
        row[DEPTH] /= max(row[LOW], 1.0)
        row[BOTTOM], row[LEVELS] = min(row[BOTTOM], row[TOP]), has_return.sum()
    return out


@compiled(borrowing=True)
def _count(x: float, y: float, z: float, box: BoxAxes, row: np.ndarray) -> bool:
    """Count a return in the row of a box; return whether it is one of the body's."""
    dx, dy = x - box.x, y - box.y
    u = abs(box.cos * dx + box.sin * dy) - box.half_length
    v = abs(box.cos * dy - box.sin * dx) - box.half_width
    if u > AROUND_M or v > AROUND_M:
        return False
    if not (u < EDGE_M and v < EDGE_M):
        row[OVERHANG] += z > CEILING_M
        row[ENDS] += LOW_M < z <= CEILING_M and v < EDGE_M
        row[SIDES] += LOW_M < z <= CEILING_M and not v < EDGE_M and u < EDGE_M
        return False
    if z < FLOOR_M:
        row[GROUND] += max(u, v) < -DEEP_M
        return False
    if z > CEILING_M:
        row[ABOVE] += 1
        return False
    row[BODY] += 1
    row[TOP], row[BOTTOM] = max(row[TOP], z), min(row[BOTTOM], z)
    if z < DECK_M:
        row[LOW] += 1
        row[DEEP] += max(u, v) < -DEEP_M
        row[DEPTH] += min(abs(max(u, v)), 2 * DEEP_M)
    return True


@compiled()
def _span(centre: float, reach: float, low: float, cells: int) -> tuple[int, int]:
    """Return first and last cell within reach of a centre along an axis; last < first if none."""
    first = max(int(np.floor((centre - reach - low) / CELL_M)), 0)
    last = min(int(np.floor((centre + reach - low) / CELL_M)), cells - 1)
    return first, last


@compiled()
def shares_of_rays(
    boxes: np.ndarray, azimuths: np.ndarray, ranges: np.ndarray, origin: np.ndarray, step: float
) -> np.ndarray:
    """Return (B, 4) shares of the columns towards each box, and how many of them hit it.

    In this order: share of columns whose nearest return is nearer than the box, share of those that
    hit it, share of those that pass it or have no return, and number of those that hit it.
    boxes: (B, 5) as in `count_returns`. azimuths, ranges: (C,) radians, increasing, and metres, of
    the nearest return above the ground in each column, seen from the origin. origin: (2,) metres,
    the sensor. step: radians from column to column.
    """
    out = np.zeros((len(boxes), 4))
    for b in range(len(boxes)):
        x, y, length, width, yaw = boxes[b]
        dx, dy = x - origin[0], y - origin[1]
        cos, sin = np.cos(yaw), np.sin(yaw)
        middle = np.arctan2(dy, dx)
        left, right = 0.0, 0.0
        for k in range(4):
            u = (0.5 if k < 2 else -0.5) * length
            v = (0.5 if k % 2 else -0.5) * width
            turn = np.arctan2(dy + sin * u + cos * v, dx + cos * u - sin * v) - middle
            turn -= 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))
            left, right = max(left, turn), min(right, turn)
        columns = max((left - right) / max(step, 1e-6), 1.0)
        for wrap in range(-1, 2):
            start = np.searchsorted(azimuths, middle + right + 2.0 * np.pi * wrap)
            stop = np.searchsorted(azimuths, middle + left + 2.0 * np.pi * wrap)
            for i in range(start, stop):
                near, far = _crossing(boxes[b], origin, azimuths[i])
                if ranges[i] < near - 2 * EDGE_M:
                    out[b, 0] += 1
                elif ranges[i] < far + 2 * EDGE_M:
                    out[b, 1] += 1
        out[b, 3] = out[b, 1]
        out[b, 0] = min(out[b, 0] / columns, 1.0)
        out[b, 1] = min(out[b, 1] / columns, 1.0 - out[b, 0])
        out[b, 2] = 1.0 - out[b, 0] - out[b, 1]
    return out


@compiled()
def _crossing(box: np.ndarray, origin: np.ndarray, azimuth: float) -> tuple[float, float]:
    """Return the ranges at which a ray enters and leaves a box; inf and 0 where it misses."""
    cos, sin = np.cos(box[4]), np.sin(box[4])
    x, y = box[0] - origin[0], box[1] - origin[1]
    near, far = 0.0, np.inf
    for k in range(2):
        ax, ay, half = (cos, sin, 0.5 * box[2]) if k == 0 else (-sin, cos, 0.5 * box[3])
        middle, rate = ax * x + ay * y, ax * np.cos(azimuth) + ay * np.sin(azimuth)
        if abs(rate) < 1e-9:
            if abs(middle) > half:
                return np.inf, 0.0
            continue
        one, other = (middle - half) / rate, (middle + half) / rate
        near, far = max(near, min(one, other)), min(far, max(one, other))
    return (near, far) if near <= far else (np.inf, 0.0)


# --------------------------------------------------------------------------------------------------
# Features of a box, for boxes of any method.

FEATURES = (
    "log_returns",
    "log_columns",
    "levels",
    "range_m",
    "passing",
    "top_m",
    "bottom_m",
    "deep",
    "depth_m",
    "ground",
    "ends",
    "sides",
    "above",
    "overhang",
    "log_residual",
    "fit",
    "length_m",
    "width_m",
    "view",
    "top_level",
    "top_share",
    "fill",
    "small",
    "weighed",
)
"""Names of the columns of `features`.

log_returns, log_columns: logarithms of the number of the body's returns, and of one plus the number
    of columns that hit the box.
levels: number of beams with a return from the body.
range_m: horizontal distance of the centre from the sensor.
passing: share of the columns towards the box that pass it or have no return.
top_m, bottom_m: greatest and least height of the body's returns.
deep: share of the low returns that lie deep within the box; depth_m: their mean distance from the
    nearest side.
ground, ends, sides, above, overhang: counts of `count_returns`, as log(1 + 10 * count / body).
log_residual: logarithm of the root mean square distance of the outline from the faces, metres.
fit, weighed: the shape's log likelihood, and whether it has one (0 or 1).
length_m, width_m: of the box.
view: absolute sine of the angle between heading and line of sight; 1 for a body across it.
top_level: whether the highest beam of the scan has a return from the body (0 or 1).
top_share: greatest height over the height of the highest beam at the body's range.
fill: number of returns over the product of beams and columns that hit the body.
small: whether the category is a two-wheeler or a pedestrian (0 or 1).
"""


def boxes_of(vehicles: Sequence[Vehicle]) -> np.ndarray:
    """Return (B, 5) centre x and y, length, width in metres, yaw in radians."""
    return np.array([(*v.centre, v.size[0], v.size[1], v.yaw) for v in vehicles]).reshape(-1, 5)


def features(
    vehicles: Sequence[Vehicle], cloud: Cloud, horizon: Horizon, height_m: float
) -> np.ndarray:
    """Return (B, F) `FEATURES` of the boxes of vehicles.

    cloud: the whole scan with its ground. height_m: height of the sensor above the ground. Counts
    are divided by the number of the body's returns, so that they depend little on range and on
    the number of beams. Logarithms are natural.
    """
    boxes = boxes_of(vehicles)
    if not len(boxes) or not len(cloud):
        return np.zeros((len(boxes), len(FEATURES)))
    cloud = _without_copies(cloud)
    order = np.argsort(horizon.azimuths, kind="stable")
    azimuths, ranges = horizon.azimuths[order], horizon.ranges[order]
    rays = shares_of_rays(boxes, azimuths, ranges, horizon.origin, horizon.step)
    counted = count_returns(boxes, cloud.points, cloud.ring, sort_to_cells(cloud.points))
    count = dict(zip(COUNTS, counted.T, strict=True))
    body = np.maximum(count["body"], 1.0)
    offsets = boxes[:, :2] - cloud.origin
    slope = _steepest(cloud, height_m)
    range_m = np.hypot(offsets[:, 0], offsets[:, 1])
    bearing = np.arctan2(offsets[:, 1], offsets[:, 0])
    values = {
        "log_returns": np.log(body),
        "log_columns": np.log1p(rays[:, 3]),
        "levels": count["levels"],
        "range_m": range_m,
        "passing": rays[:, 2],
        "top_m": count["top"],
        "bottom_m": count["bottom"],
        "deep": count["deep"] / np.maximum(count["low"], 1.0),
        "depth_m": count["depth"],
        "ground": np.log1p(10 * count["ground"] / body),
        "ends": np.log1p(10 * count["ends"] / body),
        "sides": np.log1p(10 * count["sides"] / body),
        "above": np.log1p(10 * count["above"] / body),
        "overhang": np.log1p(10 * count["overhang"] / body),
        "log_residual": np.log([max(v.residual_m, 0.005) for v in vehicles]),
        "fit": np.array([v.fit for v in vehicles]),
        "length_m": boxes[:, 2],
        "width_m": boxes[:, 3],
        "view": np.abs(np.sin(boxes[:, 4] - bearing)),
        "top_level": (count["top_level"] >= int(cloud.ring.max())).astype(float),
        "top_share": count["top"] / np.clip(height_m + slope * range_m, 0.3, CEILING_M),
        "fill": body / np.maximum(count["levels"] * rays[:, 3], 1.0),
        "small": np.array([v.category >= Category.MOTORCYCLE for v in vehicles], float),
        "weighed": np.array([v.fit != 0 for v in vehicles], float),
    }
    return np.column_stack([values[name] for name in FEATURES])


def _steepest(cloud: Cloud, height_m: float) -> float:
    """Return the slope, rise per metre, of the highest beam with a return."""
    top = cloud.select(cloud.ring == cloud.ring.max())
    return float(np.median((top.points[:, 2] - height_m) / np.maximum(top.ranges, 0.1)))


def _without_copies(cloud: Cloud) -> Cloud:
    """Return the cloud without copies of returns; it is sorted, so equal returns are neighbours."""
    column, ring = cloud.column, cloud.ring
    same = (column[1:] == column[:-1]) & (ring[1:] == ring[:-1])
    rows = np.flatnonzero(same)
    copies = rows[(cloud.points[rows + 1] == cloud.points[rows]).all(axis=1)] + 1
    return cloud.select(np.delete(np.arange(len(cloud)), copies)) if len(copies) else cloud
