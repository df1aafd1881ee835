"""What clustering keeps of the roadside, and what a detector takes it for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.papers.lu2018_follow import assigned, returns_of_targets, target_places
from roadscope.benchmarks.papers.lu2018_scene import KINDS, Take
from roadscope.core import Detections
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering import CLUSTERINGS

LEAST_RETURNS = 10
"""Targets with fewer returns are not expected to be found."""
MARGIN_M = 0.3
"""Returns this near to a box are what it was made from."""


def clutter_of_clustering(take: Take, clustering: str) -> dict[str, float]:
    """Measure what one clustering keeps: clusters of foliage a scan, shares of returns kept."""
    foliage, target = KINDS.index("foliage"), KINDS.index("target")
    clusters, kept, seen = 0, np.zeros(len(KINDS)), np.zeros(len(KINDS))
    for cloud, kinds in zip(take.clouds, take.kinds, strict=True):
        labels = CLUSTERINGS[clustering](cloud)
        clusters += int((majority(labels, kinds) == foliage).sum())
        kept += np.bincount(kinds[labels >= 0], minlength=len(KINDS))
        seen += np.bincount(kinds, minlength=len(KINDS))
    share = kept / np.maximum(seen, 1)
    return {
        "clusters of foliage": clusters / len(take.frames),
        "returns of foliage kept": float(share[foliage]),
        "returns of vehicles kept": float(share[target]),
    }


def clutter_of_detector(take: Take, detections: Sequence[Detections]) -> dict[str, float]:
    """Measure what was detected that is no target, by what it was made from, and the recall."""
    places, false = target_places(take), np.zeros(len(KINDS))
    found, expected = 0, 0
    for k, boxes in enumerate(detections):
        pairs = assigned(boxes.centres[:, :2], places[:, k])
        eligible = returns_of_targets(take, k) >= LEAST_RETURNS
        expected += int(eligible.sum())
        found += sum(bool(eligible[target]) for _, target in pairs)
        others = np.setdiff1d(np.arange(len(boxes)), [row for row, _ in pairs])
        for row in others:
            near = beside(boxes.select(np.array([row])), take.clouds[k])
            false[np.bincount(take.kinds[k][near], minlength=len(KINDS)).argmax()] += 1
    rates = dict(zip(KINDS, false / len(detections), strict=True))
    return {
        "detection rate of vehicles in view": found / max(expected, 1),
        "false detections": sum(rates.values()),
        "false detections on foliage": rates["foliage"],
    }


def majority(labels: np.ndarray, kinds: np.ndarray) -> np.ndarray:
    """Return the commonest kind of each cluster, outliers left out, (C,) int64."""
    inside = labels >= 0
    if not inside.any():
        return np.empty(0, np.int64)
    flat = labels[inside] * len(KINDS) + kinds[inside]
    votes = np.bincount(flat, minlength=len(KINDS) * (labels.max() + 1)).reshape(-1, len(KINDS))
    return np.asarray(votes.argmax(axis=1))


def beside(box: Detections, cloud: Cloud) -> np.ndarray:
    """Return the (N,) mask of returns in or beside one box."""
    offsets = cloud.points[:, :2] - box.centres[0, :2]
    c, s = np.cos(box.yaws[0]), np.sin(box.yaws[0])
    local = np.abs(offsets @ np.array([[c, -s], [s, c]]))
    return np.asarray((local <= box.sizes[0, :2] / 2 + MARGIN_M).all(axis=1))
