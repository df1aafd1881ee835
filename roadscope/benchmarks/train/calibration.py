"""What heat is worth: the chance of being right, from pictures that were not learned from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics.image_detection import hits_of, of_family
from roadscope.benchmarks.metrics.image_labels import FAMILIES, Labels
from roadscope.benchmarks.metrics.image_precision import image_precision
from roadscope.core import ImageDetections
from roadscope.detectors.camera.decode import Peaks
from roadscope.detectors.camera.weight_file import Calibration

STEPS = 100
PRIOR = 3.0
"""Weight of the heat as it is, as if so many detections of each kind had been seen."""
LEAST_SLOPE = 0.05
LONGEST_STEP = 0.5


def calibrated(peaks: Sequence[Peaks], labels: Sequence[Labels]) -> Calibration:
    """Fit one logistic curve for each family (Platt 1999) to peaks of all heights."""
    found = [
        ImageDetections(
            p.boxes, p.categories.astype(np.int8), 1 / (1 + np.exp(-p.log_odds)), float(i)
        )
        for i, p in enumerate(peaks)
    ]
    pairs = list(zip(found, labels, strict=True))
    fits = []
    for family in range(len(FAMILIES)):
        curve = image_precision(of_family(pairs, family))
        odds = np.log(curve.scores) - np.log1p(-np.minimum(curve.scores, 1 - 1e-9))
        fits.append(logistic(odds, hits_of(curve)))
    (a, b, c), (d, e, f) = zip(*fits, strict=True)
    return Calibration((a, b, c), (d, e, f))


def logistic(odds: np.ndarray, right: np.ndarray) -> tuple[float, float]:
    """Return slope and offset of the log odds of being right, drawn to 1 and 0 by a prior."""
    design = np.column_stack([odds, np.ones(len(odds))])
    start = np.array([1.0, 0.0])
    weights = start.copy()
    for _ in range(STEPS):
        chance = 1 / (1 + np.exp(-np.clip(design @ weights, -40, 40)))
        slope = design.T @ (right - chance) - PRIOR * (weights - start)
        bend = (design * (chance * (1 - chance))[:, None]).T @ design + PRIOR * np.eye(2)
        step = np.linalg.solve(bend, slope)
        weights += step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
    return round(max(float(weights[0]), LEAST_SLOPE), 4), round(float(weights[1]), 4)
