"""What boxes are worth: the chance of being right, from pictures that were not learned from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from roadscope.benchmarks.metrics.image_detection import of_family
from roadscope.benchmarks.metrics.image_labels import FAMILIES, Labels
from roadscope.benchmarks.metrics.image_precision import outcomes
from roadscope.core import ImageDetections
from roadscope.detectors.camera.calibration import TERM_COUNT, BoxCalibration
from roadscope.detectors.camera.decode import TRAITS, Peaks

STEPS = 100
PRIOR = 30.0
"""Weight of the heat as it is, as if so many boxes had been seen for each term."""
LEAST_SPREAD = 0.01
LONGEST_STEP = 0.5
DIGITS = 4
"""That are kept of what is fitted."""


def calibrated(peaks: Sequence[Peaks], labels: Sequence[Labels]) -> BoxCalibration:
    """Fit one logistic curve of traits and their products for each family.

    A box is right if it would count as found with boxes taken by falling heat.
    """
    found = [
        ImageDetections(
            p.boxes, p.categories.astype(np.int8), 1 / (1 + np.exp(-p.log_odds)), float(i)
        )
        for i, p in enumerate(peaks)
    ]
    pairs = list(zip(found, labels, strict=True))
    seen = np.concatenate([np.empty((0, len(TRAITS))), *(p.traits for p in peaks)])
    plain = _standard(seen)
    start = np.zeros(TERM_COUNT)
    start[0], start[1] = plain.middles[0], plain.spreads[0]
    judged = (_judged(peaks, pairs, family) for family in range(len(FAMILIES)))
    each = [logistic(plain.terms(traits), right, start) for traits, right in judged]
    return replace(plain, weights=np.round(each, DIGITS))


def _judged(
    peaks: Sequence[Peaks], pairs: Sequence[tuple[ImageDetections, Labels]], family: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the traits of a family's boxes that count, (N, 9), and which are right, (N,) bool."""
    traits, right = [np.empty((0, len(TRAITS)))], [np.empty(0, bool)]
    for p, image in zip(peaks, of_family(pairs, family), strict=True):
        rows, hits = outcomes(image)
        traits.append(p.traits[np.flatnonzero(p.families == family)[rows]])
        right.append(hits)
    return np.concatenate(traits), np.concatenate(right)


def _standard(traits: np.ndarray) -> BoxCalibration:
    """Return a calibration with middles and spreads of (N, 9) traits."""
    if not len(traits):
        return BoxCalibration()
    spreads = np.maximum(traits.std(axis=0), LEAST_SPREAD)
    return BoxCalibration(traits.mean(axis=0).round(DIGITS), spreads.round(DIGITS))


def logistic(terms: np.ndarray, right: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return weights, (T,), of (N, T) terms in the log odds of being right, (N,) bool.

    start: (T,) to which a prior draws them.
    """
    weights = start.copy()
    for _ in range(STEPS):
        chance = 1 / (1 + np.exp(-np.clip(terms @ weights, -40, 40)))
        slope = terms.T @ (right - chance) - PRIOR * (weights - start)
        bend = (terms * (chance * (1 - chance))[:, None]).T @ terms + PRIOR * np.eye(len(start))
        step = np.linalg.solve(bend, slope)
        weights += step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
    return weights
