"""Scores of many sequences as one: ratios of sums, to which each sequence contributes a part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from roadscope.benchmarks.metrics.breakdown import part_name, split_name
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking.hota import Hota
from roadscope.benchmarks.metrics.tracking.scores import ALPHA_BANDS, BY_ALPHA, CURVES
from roadscope.benchmarks.metrics.tracking.state_accuracy import mean_band

SUFFIXES = {"iou_2d": "", "iou_3d": "_3d", "centre": "_centre"}
"""Similarity -> the end of the names of its scores; image boxes are the default."""
NEES_BAND = ("nees_low", "nees_high")
"""Names of the two ends of the band of NEES."""
POSITION_FREEDOM = 2
"""Degrees of freedom of a position."""
ONE_WITHOUT_HITS = ("loc_a",)
"""Scores that are 1, not 0, without any hit, because no hit is in the wrong place."""


def alpha_parts(curves: Hota, suffix: str = "") -> dict[str, Score]:
    """Return DetA, AssA, LocA and HOTA of one sequence at each alpha, named by `part_name`.

    The means of DetA, AssA and LocA over sequences, by weight, are the scores of all sequences as
    one. HOTA needs `combined_hota`.
    """
    detections = curves.hits + curves.misses + curves.false_alarms
    parts = {}
    for name in (*CURVES, "hota"):
        values = getattr(curves, name)
        weights = curves.hits if name in ("ass_a", "loc_a") else detections
        for band, value, weight in zip(ALPHA_BANDS, values, weights, strict=True):
            known, n = float(value) if weight else np.nan, int(weight)
            score = Score(known, "1", "higher", n, 0.0, 1.0, weight=float(weight))
            parts[part_name(name + suffix, BY_ALPHA, band)] = score
    return parts


def combined_hota(episodes: Sequence[Mapping[str, Score]], metric: str) -> list[Score]:
    """Return the part of each episode in HOTA (or DetA, AssA, LocA) of all episodes as one.

    episodes: the scores of each episode, with `alpha_parts`.
    metric: `hota`, `det_a`, `ass_a` or `loc_a`, with the suffix of the parts. A name by
        `part_name` means one alpha; otherwise it is the mean over all alphas.

    The mean of the parts is the score of all sequences together: the sums behind DetA and AssA are
    added at each alpha (Luiten et al. 2021). It is not linear in the sequences. Each part is its
    linearisation (the infinitesimal jackknife, Efron and Tibshirani 1993, ch. 22). So the spread of
    the parts is the spread of the score, and the statistics of means hold for it.
    """
    name, _, band = split_name(metric)
    curve = next(each for each in ("hota", *CURVES) if name.startswith(each))
    suffix, bands = name.removeprefix(curve), [band] if band else ALPHA_BANDS
    factors = ("det_a", "ass_a") if curve == "hota" else (curve,)
    levels, deviations = [], []
    for factor in factors:
        values, weights = _weighted_values(episodes, factor + suffix, bands)
        sums = weights.sum(axis=0)
        total = np.maximum(sums, 1.0)
        mean = (weights * values).sum(axis=0) / total
        level = np.where(sums > 0, mean, factor in ONE_WITHOUT_HITS)
        levels.append(level)
        deviations.append(len(episodes) * weights * (values - level) / total)
    score, slopes = _mean_and_slopes(levels)
    parts = score + sum(
        (slope * deviation).mean(axis=1)
        for slope, deviation in zip(slopes, deviations, strict=True)
    )
    n = [scores[metric].n for scores in episodes]
    known = sum(n) > 0
    return [
        Score(float(part) if known else np.nan, "1", "higher", count, 0.0, 1.0)
        for part, count in zip(np.broadcast_to(parts, len(n)), n, strict=True)
    ]


def combined_mota(episodes: Sequence[Mapping[str, Score]], metric: str) -> list[Score]:
    """Return the part of each episode in MOTA of all episodes as one.

    A sequence without objects has no MOTA of its own, but its false alarms count.

    episodes: the scores of each episode, with `errors`, and with objects as samples of `mota`.
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
    """Return for each episode one end of the NEES band of all episodes as one.

    episodes: the scores of each episode; the samples of the metric are its matched objects.
    metric: `nees_low` or `nees_high`.
    """
    objects = sum(scores[metric].n for scores in episodes)
    ends = dict(zip(NEES_BAND, nees_band(objects), strict=True))
    return [replace(ends[metric], n=scores[metric].n) for scores in episodes]


def nees_band(objects: int) -> tuple[Score, Score]:
    """Return the ends of the band that holds the NEES of positions in 95 % of cases.

    NEES is divided by its degrees of freedom.

    objects: number of matched objects; the errors of each one count as one independent value.
    """
    ends = mean_band(objects, POSITION_FREEDOM)
    low, high = (end / POSITION_FREEDOM if objects else np.nan for end in ends)
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
"""Scores that are no means over sequences -> the function that combines them."""


def _weighted_values(
    episodes: Sequence[Mapping[str, Score]], name: str, bands: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return (episodes, alphas) values and their weights; the value is 0 where the weight is."""
    names = [part_name(name, BY_ALPHA, band) for band in bands]
    rows = [[scores[part] for part in names] for scores in episodes]
    weights = np.array([[s.weight for s in row] for row in rows])
    values = np.array([[s.value if s.weight else 0.0 for s in row] for row in rows])
    return values, weights


def _mean_and_slopes(levels: Sequence[np.ndarray]) -> tuple[float, list[np.ndarray]]:
    """Return the mean over alphas, for two levels of their geometric mean, and its derivatives."""
    if len(levels) == 1:
        return float(levels[0].mean()), [np.ones(len(levels[0]))]
    det_a, ass_a = levels
    curve = np.sqrt(det_a * ass_a)
    slopes = [
        np.divide(0.5 * curve, level, out=np.zeros_like(level), where=level > 0) for level in levels
    ]
    return float(curve.mean()), slopes
