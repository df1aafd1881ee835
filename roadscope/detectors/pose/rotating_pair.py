"""Search of the rotating pair of perpendicular lines (Zhang 2017, sections 2.1 and 2.3)."""

from __future__ import annotations

import numpy as np

from roadscope.detectors.pose.pair_kernels import FIXED, Filter, Views, merge, sweep

COARSE_DEG = 4.0
"""Step of the first round, in which the edges are smoothed by as much as half of it turns them."""
MANY = 100
"""Returns a frame beyond which those in one cell are joined."""
KEPT = 3
"""Angles of the first round that are looked at closely."""


def settled_views(
    frames: list[np.ndarray], origins: list[np.ndarray], stamps_s: np.ndarray, reference: int
) -> tuple[Views, np.ndarray]:
    """Gather checked frames; return them and the (2,) reference point, the reference's mean."""
    means = np.array([points.mean(axis=0) for points in frames])
    point = means[reference]
    starts = np.cumsum([0] + [len(points) for points in frames])
    centred = np.concatenate([points - mean for points, mean in zip(frames, means, strict=True)])
    sights = means - np.array(origins)
    weights = np.full(len(centred), 1.0 / len(centred))
    stamps = np.asarray(stamps_s - stamps_s[reference], np.float64)
    return Views(centred, weights, starts, means - point, sights, stamps), point


def initial_angle(views: Views) -> float:
    """Direction of the line that fits the points best, radians.

    Reading taken: least squares of the distances from the line, since a slope of y over x has no
    vertical lines. Points without a direction give the line of sight.
    """
    (xx, xy), (_, yy) = (views.points.T * views.weights) @ views.points
    if np.hypot(xx - yy, 2 * xy) <= 1e-12:
        return float(np.arctan2(views.sights[0, 1], views.sights[0, 0]))
    return float(0.5 * np.arctan2(2 * xy, xx - yy))


def best_pair(
    views: Views, settings: Filter, *, step_deg: float, search_deg: float, tied: bool = True
) -> tuple[float, np.ndarray]:
    """Return the angle of the long side in radians and its row of `pair_kernels.sweep`.

    Angles are multiples of step_deg from the initial one over search_deg. The paper tries all;
    here a coarse round finds the best few and only what is near them is tried at the full step.
    The parabola through the best and its neighbours stands for smaller steps.
    """
    count, stride = round(search_deg / step_deg), max(1, round(COARSE_DEG / step_deg))
    start, step = initial_angle(views), np.radians(step_deg)
    coarse = np.arange(0, count, stride)
    # The score of few returns is ragged: its top may lie well off that of the smoothed one.
    reach = stride - 1 if _are_many(views) else 3 * stride // 2
    views = thinned(views, settings.sigma_m)
    if stride > 1:
        blurred = _blurred(settings, stride * step)
        seen = thinned(views, blurred.sigma_m)
        rough = sweep(seen, start + coarse * step, blurred, False)
        coarse = coarse[_summits(rough[:, 0], KEPT)]
    near = (coarse[:, None] + np.arange(-reach, reach + 1)).ravel()
    fine = np.unique(near % count if search_deg == 180 else np.clip(near, 0, count - 1))
    rows = sweep(views, start + fine * step, settings, tied)
    best = int(rows[:, 0].argmax())
    top = start + fine[best] * step
    return _refined(views, settings, (top, step, tied), rows[best])


def thinned(views: Views, cell_m: float) -> Views:
    """Join returns of a frame that share a cell, where there are many."""
    if not _are_many(views):
        return views
    cuts = views.starts[1:-1]
    split = np.split(views.points, cuts), np.split(views.weights, cuts)
    parts = [merge(points, weights, cell_m) for points, weights in zip(*split, strict=True)]
    points, weights = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    starts = np.cumsum([0] + [len(part[1]) for part in parts])
    return views._replace(points=points, weights=weights, starts=starts)


def _are_many(views: Views) -> bool:
    return len(views.points) > MANY * len(views.stamps)


def _blurred(settings: Filter, step: float) -> Filter:
    """Smooth as widely as the ends of the body move when it is turned by half a step."""
    sigma_m = float(np.hypot(settings.sigma_m, settings.length / 2 * step / 2))
    return settings._replace(sigma_m=sigma_m, bin_m=max(settings.bin_m, sigma_m / 1.5))


def _summits(scores: np.ndarray, count: int) -> np.ndarray:
    """Return the indices of the greatest local maxima round a circle of scores."""
    peaks = (scores >= np.roll(scores, 1)) & (scores >= np.roll(scores, -1))
    ranked: np.ndarray = np.argsort(np.where(peaks, -scores, np.inf), kind="stable")
    return ranked[:count]


def _refined(
    views: Views, settings: Filter, peak: tuple[float, float, bool], row: np.ndarray
) -> tuple[float, np.ndarray]:
    """Move the best angle to the top of the parabola through it and its neighbours."""
    angle, step, tied = peak
    before, after = sweep(views, np.array([angle - step, angle + step]), settings, tied)[:, 0]
    bend = before - 2 * row[0] + after
    if bend >= 0:
        return angle, row
    moved = angle + step * float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5))
    return moved, sweep(views, np.array([moved]), settings, tied)[0]


def placed(angle: float, row: np.ndarray, frame: int, point: np.ndarray) -> tuple[float, float]:
    """Return x, y of the middle in one frame, from a row of the sweep."""
    cos, sin = np.cos(angle), np.sin(angle)
    along, across = row[FIXED + frame], row[2]
    x, y = along * cos - across * sin, along * sin + across * cos
    return float(point[0] + x), float(point[1] + y)
