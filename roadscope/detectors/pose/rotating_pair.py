"""Search of the rotating pair of perpendicular lines (Zhang 2017, sections 2.1 and 2.3)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.pair_kernels import FIXED, Filter, Views, merge, sweep
from roadscope.detectors.pose.score_kernels import free_scores

COARSE_DEG = 4.0
"""Step of the second round, in which the edges are smoothed by as much as half of it turns them;
the first one's is twice as long."""
FEW, MANY = 30, 100
"""Returns a frame beyond which those in one cell are joined, in the first rounds and after."""
KEPT = 3
"""Angles of the first rounds that are looked at closely."""
WORTH = 0.9
"""Share of a round's greatest score below which an angle is not looked at again: a lower one was
the best after all in 5 of 1300 fits."""

MOVING_M_S = 1.0
"""From this speed on the way that the body went tells its front."""


class Plan(NamedTuple):
    """Angles that are tried: multiples of a step, radians, from the initial one on.

    total: how many. stride: from one of the first round to the next. closed: whether the last is
    next to the first. tied: as in the sweep.
    """

    step: float
    total: int
    stride: int
    closed: bool
    tied: bool


class Frames(NamedTuple):
    """One vehicle's returns in F frames, in one frame of reference that stays put.

    points: (N, 2) float64, metres, frame after frame; starts: (F + 1,) int64, where each begins.
    origins: (F, 2) float64, metres, the sensor. stamps: (F,) float64, seconds. reference: index
    of the frame whose pose is looked for.
    """

    points: np.ndarray
    starts: np.ndarray
    origins: np.ndarray
    stamps: np.ndarray
    reference: int


def planned(step_deg: float, search_deg: float, *, tied: bool = True) -> Plan:
    """Return the plan of a search over an angle in steps, degrees.

    The paper tries all; here two coarse rounds find the best few and only what is near them is
    tried at the full step. The parabola through the best and its neighbours stands for smaller
    steps. A step that leaves a rest is shortened until it leaves none.
    """
    count = math.ceil(search_deg / step_deg - 1e-9)
    step_deg = search_deg / count
    stride = max(1, round(COARSE_DEG / step_deg))
    return Plan(math.radians(step_deg), count, stride, search_deg == 180, tied)


@compiled()
def best_pair(frames: Frames, settings: Filter, plan: Plan) -> tuple[float, float, float, float]:
    """Return x, y, yaw and score of the rectangle that answers best, reference frame's.

    Metres and radians; yaw is that of the long side, the way that it moved or, where it hardly
    did, away from the sensor.
    """
    views, point = settled_views(frames)
    angle, row = _searched(views, settings, plan)
    cos, sin = np.cos(angle), np.sin(angle)
    along, across = row[FIXED + frames.reference], row[2]
    x, y = point[0] + along * cos - across * sin, point[1] + along * sin + across * cos
    sight = views.sights[frames.reference]
    ahead = row[1] if abs(row[1]) >= MOVING_M_S else cos * sight[0] + sin * sight[1]
    return x, y, angle if ahead >= 0.0 else angle + np.pi, row[0]


@compiled()
def settled_views(frames: Frames) -> tuple[Views, np.ndarray]:
    """Return the frames as the sweep takes them, and the (2,) reference point.

    That is the mean of the reference's points, and the reference's stamp counts as 0.
    """
    points, starts = frames.points.copy(), frames.starts
    means = _centred(points, starts)
    point, weights = means[frames.reference].copy(), np.full(len(points), 1.0 / len(points))
    stamps = frames.stamps - frames.stamps[frames.reference]
    return Views(points, weights, starts, means - point, means - frames.origins, stamps), point


@compiled()
def _centred(points: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Take from (N, 2) points, in place, the means (F, 2) of their frames, and return these."""
    means = np.zeros((len(starts) - 1, 2))
    for f in range(len(means)):
        for i in range(starts[f], starts[f + 1]):
            means[f] += points[i]
        means[f] /= starts[f + 1] - starts[f]
        for i in range(starts[f], starts[f + 1]):
            points[i] -= means[f]
    return means


@compiled()
def initial_angle(views: Views) -> float:
    """Return the direction of the line that fits the points best, radians, their frame.

    Reading taken: least squares of the distances from the line, since a slope of y over x has no
    vertical lines. Points without a direction give the line of sight.
    """
    xx = xy = yy = 0.0
    for i in range(len(views.points)):
        x, y, weight = views.points[i, 0], views.points[i, 1], views.weights[i]
        xx, xy, yy = xx + weight * x * x, xy + weight * x * y, yy + weight * y * y
    if np.hypot(xx - yy, 2 * xy) <= 1e-12:
        return float(np.arctan2(views.sights[0, 1], views.sights[0, 0]))
    return float(0.5 * np.arctan2(2 * xy, xx - yy))


@compiled()
def _searched(views: Views, settings: Filter, plan: Plan) -> tuple[float, np.ndarray]:
    """Return the best angle of a plan, between its steps, and its row of the sweep."""
    start, tied = initial_angle(views), plan.tied
    # The score of few returns is ragged: its top may lie well off that of the smoothed one.
    many = len(views.points) > MANY * len(views.stamps)
    reach = plan.stride - 1 if many else 3 * plan.stride // 2
    views = thinned(views, settings.sigma_m, MANY)
    chosen = np.arange(0, plan.total, plan.stride)
    if plan.stride > 1:
        chosen = chosen[_summits(_rough(views, start, settings, plan, chosen))]
    near = np.zeros(plan.total, np.bool_)
    for k in chosen:
        for i in range(k - reach, k + reach + 1):
            near[i % plan.total if plan.closed else min(max(i, 0), plan.total - 1)] = True
    fine = np.flatnonzero(near)
    scores = _scores(views, start + fine * plan.step, settings, tied)
    best = int(scores.argmax())
    angle = start + fine[best] * plan.step
    beside = np.array([angle - plan.step, angle + plan.step])
    if tied and len(views.stamps) > 1:
        before, after = sweep(views, beside, settings, tied)[:, 0]
    else:
        before, after = free_scores(views, beside, settings)
    angle += plan.step * _off(before, scores[best], after)
    return angle, sweep(views, np.array([angle]), settings, tied)[0]


@compiled()
def _rough(
    views: Views, start: float, settings: Filter, plan: Plan, chosen: np.ndarray
) -> np.ndarray:
    """Return smoothed scores of the angles of the second round, -inf of those left in the first.

    chosen: (A,) int64, the angles of the second round, every other one of which is in the first.
    """
    wide = _blurred(settings, 2 * plan.stride * plan.step)
    seen = thinned(views, wide.sigma_m, FEW)
    glance = free_scores(seen, start + chosen[::2] * plan.step, wide)
    likely = np.zeros(len(chosen), np.bool_)
    for k in np.flatnonzero(glance >= _worth(glance)):
        for i in range(2 * k - 1, 2 * k + 2):
            likely[i % len(chosen)] = True
    blurred = _blurred(settings, plan.stride * plan.step)
    seen, scores = thinned(views, blurred.sigma_m, FEW), np.full(len(chosen), -np.inf)
    scores[likely] = free_scores(seen, start + chosen[likely] * plan.step, blurred)
    return scores


@compiled()
def _scores(views: Views, angles: np.ndarray, settings: Filter, tied: bool) -> np.ndarray:
    """Return scores of (A,) angles, -inf of those that are not the best.

    Frames that are moved each by its own shift score no less than frames that are tied.
    """
    bounds = free_scores(views, angles, settings)
    if not tied or len(views.stamps) == 1:
        return bounds
    scores, top = np.full(len(angles), -np.inf), -np.inf
    for _ in range(len(angles)):
        k = int(bounds.argmax())
        # A hair more, for rounding.
        if bounds[k] + 1e-9 < top:
            break
        scores[k] = sweep(views, angles[k : k + 1], settings, tied)[0, 0]
        bounds[k], top = -np.inf, max(top, scores[k])
    return scores


@compiled()
def thinned(views: Views, cell_m: float, many: int) -> Views:
    """Join returns of a frame that share a cell, sides in metres, where there are many."""
    if len(views.points) <= many * len(views.stamps):
        return views
    points, weights = np.empty_like(views.points), np.empty_like(views.weights)
    starts = np.zeros_like(views.starts)
    for f in range(len(views.stamps)):
        first, last = views.starts[f], views.starts[f + 1]
        merged, sums = merge(views.points[first:last], views.weights[first:last], cell_m)
        starts[f + 1] = starts[f] + len(sums)
        points[starts[f] : starts[f + 1]] = merged
        weights[starts[f] : starts[f + 1]] = sums
    count = starts[-1]
    return Views(points[:count], weights[:count], starts, views.means, views.sights, views.stamps)


@compiled()
def _blurred(settings: Filter, step: float) -> Filter:
    """Smooth as widely as the ends of the body move when it is turned by half a step."""
    sigma_m = np.hypot(settings.sigma_m, settings.length / 2 * step / 2)
    bin_m = max(settings.bin_m, sigma_m / 1.5)
    sides = settings.length, settings.width
    return Filter(bin_m, sigma_m, settings.alpha, *sides, settings.power, settings.tie)


@compiled()
def _worth(scores: np.ndarray) -> float:
    """Return the least score that is worth a closer look; all are below 0 of wide-spread points."""
    top = scores.max()
    return float(top - (1.0 - WORTH) * abs(top))


@compiled()
def _summits(scores: np.ndarray) -> np.ndarray:
    """Return the indices of the greatest local maxima round a circle of scores."""
    peaks, least = np.full(len(scores), np.inf), _worth(scores)
    for k in range(len(scores)):
        around = max(scores[k - 1], scores[(k + 1) % len(scores)])
        if scores[k] >= around and scores[k] >= least:
            peaks[k] = -scores[k]
    count = min(KEPT, int(np.isfinite(peaks).sum()))
    return np.argsort(peaks, kind="mergesort")[:count]


@compiled()
def _off(before: float, top: float, after: float) -> float:
    """Return how far the top of the parabola through three scores lies off the middle, steps."""
    bend = before - 2 * top + after
    return min(max(0.5 * (before - after) / bend, -0.5), 0.5) if bend < 0 else 0.0
