"""Where an outline is split into straight pieces, and which pieces make a face."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled


class Faces(NamedTuple):
    """When pieces of an outline can be the faces of one body.

    gap_m: neighbours farther apart lie on two bodies. join_m: pieces are one face up to this
    root mean square distance from one line. least_m: of the diagonal of a body's outline.
    points: least number of a body, those that two pieces share counted twice. lines: most.
    """

    gap_m: float
    join_m: float
    least_m: float
    points: int
    lines: int


@compiled()
def split_ends(points: np.ndarray, split_m: float) -> np.ndarray:
    """Return (S, 2) int64 first and last of the points (N, 2) of each piece, in order.

    A piece is split at the point farthest from its chord, which both parts share, where that is
    farther than `split_m`.
    """
    ends, pending = np.empty((len(points), 2), np.int64), np.empty((len(points), 2), np.int64)
    count, left = 0, 0
    if len(points):
        pending[0, 0], pending[0, 1], left = 0, len(points) - 1, 1
    while left:
        left -= 1
        first, last = pending[left]
        at, farthest = _farthest(points, first, last)
        if at < 0 or farthest <= split_m:
            ends[count, 0], ends[count, 1] = first, last
            count += 1
            continue
        pending[left, 0], pending[left, 1] = at, last
        pending[left + 1, 0], pending[left + 1, 1] = first, at
        left += 2
    return ends[:count]


@compiled()
def _farthest(points: np.ndarray, first: int, last: int) -> tuple[int, float]:
    """Return the point between two that is farthest from their line, -1 without any; how far.

    Two equal points have no line: there it is the distance from them.
    """
    x, y = points[first, 0], points[first, 1]
    dx, dy = points[last, 0] - x, points[last, 1] - y
    length, at, farthest = np.hypot(dx, dy), -1, -1.0
    for i in range(first + 1, last):
        u, v = points[i, 0] - x, points[i, 1] - y
        away = abs(dx * v - dy * u) / length if length > 0.0 else np.hypot(u, v)
        if away > farthest:
            at, farthest = i, away
    return at, farthest


@compiled()
def face_ends(points: np.ndarray, ends: np.ndarray, rule: Faces) -> np.ndarray:
    """Return (K, 3) int64 body, first and last point of the lines of each body that may be one.

    points: (N, 2) of an outline. ends: (S, 2) of its pieces. An outline is cut where it jumps;
    then neighbouring pieces on one line are joined.
    """
    cut = _cut(points, ends, rule.gap_m)
    out, count, first = np.empty((len(cut), 3), np.int64), 0, 0
    while first < len(cut):
        end = first + 1
        while end < len(cut) and cut[end, 0] == cut[first, 0]:
            end += 1
        chain = cut[first:end]
        if _wide(points, chain[0, 1], chain[-1, 2]) >= rule.least_m:
            joined = _joined(points, chain, rule.join_m)
            lines = (joined[:, 2] > joined[:, 1]).sum()
            total = (joined[:, 2] - joined[:, 1] + 1).sum()
            if 1 <= lines <= rule.lines and total >= rule.points:
                out[count : count + len(joined)] = joined
                count += len(joined)
        first = end
    return out[:count]


@compiled()
def _cut(points: np.ndarray, ends: np.ndarray, gap_m: float) -> np.ndarray:
    """Return (K, 3) chain, first and last point of pieces, parted where neighbours lie apart."""
    out = np.empty((len(ends) + len(points), 3), np.int64)
    count, chain = 0, 0
    for s in range(len(ends)):
        first, last = ends[s]
        for i in range(first, last):
            if np.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]) > gap_m:
                out[count, 0], out[count, 1], out[count, 2] = chain, first, i
                count, chain, first = count + 1, chain + 1, i + 1
        out[count, 0], out[count, 1], out[count, 2] = chain, first, last
        count += 1
    return out[:count]


@compiled()
def _wide(points: np.ndarray, first: int, last: int) -> float:
    """Diagonal of the upright box around points in a row."""
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in range(first, last + 1):
        x, y = points[i, 0], points[i, 1]
        low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
    return float(np.hypot(high_x - low_x, high_y - low_y))


@compiled()
def _joined(points: np.ndarray, chain: np.ndarray, join_m: float) -> np.ndarray:
    """Join neighbouring pieces of one face: noise at the end of a chord is no corner."""
    out, count = chain.copy(), 1
    for k in range(1, len(chain)):
        if _off_line(points, out[count - 1, 1], chain[k, 2]) <= join_m:
            out[count - 1, 2] = chain[k, 2]
        else:
            out[count] = chain[k]
            count += 1
    return out[:count]


@compiled()
def _off_line(points: np.ndarray, first: int, last: int) -> float:
    """Root mean square distance of points in a row from their line of least squares."""
    count, x, y = last + 1 - first, 0.0, 0.0
    for i in range(first, last + 1):
        x, y = x + points[i, 0], y + points[i, 1]
    x, y = x / count, y / count
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(first, last + 1):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    cos, sin, total = math.cos(angle), math.sin(angle), 0.0
    for i in range(first, last + 1):
        off = cos * (points[i, 1] - y) - sin * (points[i, 0] - x)
        total += off * off
    return math.sqrt(total / count)
