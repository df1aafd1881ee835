"""Figures of many sequences as one: ratios of sums, of which each sequence has its part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from roadscope.benchmarks.metrics.breakdown import part_name, split_name
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking.hota import Hota
from roadscope.benchmarks.metrics.tracking.scores import ALPHA_BANDS, BY_ALPHA, CURVES
from roadscope.benchmarks.metrics.tracking.state_errors import mean_band

SUFFIXES = {"iou_2d": "", "iou_3d": "_3d", "centre": "_centre"}
"""What names of scores by a similarity end in; the first goes without saying."""

NEES_BAND = "nees_low", "nees_high"
FREEDOM = 2
"""Of positions."""


def alpha_parts(curves: Hota, suffix: str = "") -> dict[str, Score]:
    """Return DetA, AssA, LocA and HOTA of one sequence at each alpha, by `part_name`.

    Pooled by weight over sequences the first three are those of all sequences as one; HOTA is by
    `combined_hota`.
    """
    of = curves.hits + curves.misses + curves.false_alarms
    wholes = {"det_a": of, "ass_a": curves.hits, "loc_a": curves.hits, "hota": of}
    parts = {}
    for name, weights in wholes.items():
        values = getattr(curves, name)
        for band, value, weight in zip(ALPHA_BANDS, values, weights, strict=True):
            measured, n = float(value) if weight else np.nan, int(weight)
            score = Score(measured, "1", "higher", n, 0.0, 1.0, weight=float(weight))
            parts[part_name(name + suffix, BY_ALPHA, band)] = score
    return parts


def combined_hota(episodes: Sequence[Mapping[str, Score]], metric: str) -> list[Score]:
    """Return each episode's part in HOTA (or DetA, AssA, LocA) of all episodes as one.

    episodes: scores of each, with `alpha_parts`.
    metric: `hota`, `det_a`, `ass_a` or `loc_a`, with the suffix of the parts; at one alpha, by
        `part_name`, or the mean over all.

    The mean of the parts is the figure of all sequences together (Luiten et al. 2021: the sums
    behind DetA and AssA are added up, at each alpha). It is not linear in the sequences; each
    part is its linearisation (Efron and Tibshirani 1993, ch. 22: the infinitesimal jackknife), so
    the spread of the parts is that of the figure, and what holds for means holds for it.
    """
    whole_name, _, band = split_name(metric)
    curve = next(name for name in ("hota", *CURVES) if whole_name.startswith(name))
    suffix, bands = whole_name.removeprefix(curve), [band] if band else ALPHA_BANDS
    names = ("det_a", "ass_a") if curve == "hota" else (curve,)
    pooled, moved = [], []
    for name in names:
        values, weights = _columns(episodes, name + suffix, bands)
        whole = weights.sum(axis=0)
        total = np.maximum(whole, 1.0)
        # Without any hit there is nothing that could be out of place.
        level = np.where(whole > 0, (weights * values).sum(axis=0) / total, name == "loc_a")
        pooled.append(level)
        moved.append(len(episodes) * weights * (values - level) / total)
    figure, slopes = _figure(pooled)
    parts = figure + sum((slope * m).mean(axis=1) for slope, m in zip(slopes, moved, strict=True))
    n = [scores[metric].n for scores in episodes]
    known = sum(n) > 0
    return [
        Score(float(part) if known else np.nan, "1", "higher", count, 0.0, 1.0)
        for part, count in zip(np.broadcast_to(parts, len(n)), n, strict=True)
    ]


def combined_mota(episodes: Sequence[Mapping[str, Score]], metric: str) -> list[Score]:
    """Return each episode's part in MOTA of all episodes as one.

    A sequence without objects has no MOTA of its own, but its false alarms count.

    episodes: scores of each, with `errors`, and objects as samples of `mota`.
    metric: `mota`, with the suffix of the errors.
    """
    errors = np.array([scores[metric.replace("mota", "errors")].value for scores in episodes])
    objects = np.array([scores[metric].n for scores in episodes], np.float64)
    if not objects.sum():
        return [replace(scores[metric], value=np.nan) for scores in episodes]
    rate = errors.sum() / objects.sum()
    parts = 1 - rate - len(episodes) * (errors - rate * objects) / objects.sum()
    return [
        replace(scores[metric], value=float(part), weight=1.0)
        for scores, part in zip(episodes, parts, strict=True)
    ]


def combined_band(episodes: Sequence[Mapping[str, Score]], metric: str) -> list[Score]:
    """Return for each episode an end of the band of NEES of all episodes as one.

    episodes: scores of each, with the number of objects followed as samples of the metric.
    metric: `nees_low` or `nees_high`.
    """
    objects = sum(scores[metric].n for scores in episodes)
    ends = dict(zip(NEES_BAND, nees_band(objects), strict=True))
    return [replace(ends[metric], n=scores[metric].n) for scores in episodes]


def nees_band(objects: int) -> tuple[Score, Score]:
    """Return between what NEES of positions, over its degrees of freedom, lies in 95 % of cases.

    objects: how many are followed; each one's errors are taken for one value.
    """
    low, high = (end / FREEDOM if objects else np.nan for end in mean_band(objects, FREEDOM))
    return Score(low, "1", "higher", objects), Score(high, "1", "lower", objects)


COMBINED = {
    **{f"{name}{s}": combined_hota for name in ("hota", *CURVES) for s in SUFFIXES.values()},
    **{
        part_name(f"hota{s}", BY_ALPHA, band): combined_hota
        for s in SUFFIXES.values()
        for band in ALPHA_BANDS
    },
    **{f"mota{s}": combined_mota for s in SUFFIXES.values()},
    **dict.fromkeys(NEES_BAND, combined_band),
}
"""What is no mean over sequences, and how it is made one."""


def _columns(
    episodes: Sequence[Mapping[str, Score]], name: str, bands: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return (episodes, alphas) values, 0 where there are none, and weights."""
    names = [part_name(name, BY_ALPHA, band) for band in bands]
    rows = [[scores[part] for part in names] for scores in episodes]
    weights = np.array([[s.weight for s in row] for row in rows])
    values = np.array([[s.value if s.weight else 0.0 for s in row] for row in rows])
    return values, weights


def _figure(pooled: Sequence[np.ndarray]) -> tuple[float, list[np.ndarray]]:
    """Return the mean over alphas, of the geometric mean where there are two, and its slopes."""
    if len(pooled) == 1:
        return float(pooled[0].mean()), [np.ones(len(pooled[0]))]
    det_a, ass_a = pooled
    curve = np.sqrt(det_a * ass_a)
    halves = [
        np.divide(0.5 * curve, level, out=np.zeros_like(level), where=level > 0) for level in pooled
    ]
    return float(curve.mean()), halves
