"""Scores of groups of objects or detections: one for each of `count`, n = 0 where it is empty."""

from __future__ import annotations

import numpy as np

from roadscope.benchmarks.metrics.score import Score, mean, ratio, rms


def rms_by_group(squares: np.ndarray, groups: np.ndarray, count: int, unit: str) -> list[Score]:
    """Return the root of the mean of (K, D) squares of each group.

    groups: (K,) int, 0 to count - 1.
    """
    totals = np.bincount(groups, squares.sum(axis=1), count)
    numbers = np.bincount(groups, minlength=count) * squares.shape[1]
    pairs = zip(totals.tolist(), numbers.tolist(), strict=True)
    return [rms(total, number, unit) for total, number in pairs]


def rate_by_group(objects: np.ndarray, found: np.ndarray, count: int) -> list[Score]:
    """Return the share that was found of each group; groups of all objects and of those found."""
    of, hits = (np.bincount(groups, minlength=count).tolist() for groups in (objects, found))
    return [ratio(hit, total) for hit, total in zip(hits, of, strict=True)]


def f1_by_group(
    objects: np.ndarray, found: np.ndarray, false_alarms: np.ndarray, count: int
) -> list[Score]:
    """Return found / (found + (missed + false alarms) / 2) of each group.

    objects, found: groups of all objects and of those found, int.
    false_alarms: groups of the false alarms, int.
    """
    of, hits, wrong = (
        np.bincount(groups, minlength=count).tolist() for groups in (objects, found, false_alarms)
    )
    each = zip(of, hits, wrong, strict=True)
    return [ratio(hit, hit + (total - hit + alarm) / 2) for total, hit, alarm in each]


def precision_and_alarms(
    hits: np.ndarray, false_alarms: np.ndarray, count: int, frames: int
) -> dict[str, list[Score]]:
    """Return precision and false alarms per frame of each group, by name.

    hits, false_alarms: groups of the detections that are right and that are not, int.
    """
    right, wrong = (np.bincount(g, minlength=count).tolist() for g in (hits, false_alarms))
    return {
        "precision": [ratio(r, r + w) for r, w in zip(right, wrong, strict=True)],
        "false_alarms_per_frame": [mean(w, frames, "1/frame") for w in wrong],
    }
