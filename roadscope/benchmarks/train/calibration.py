"""Calibrates scores as probabilities that boxes are right, on pictures that were not trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.metrics.image_detection import images_of_family, match_image
from roadscope.benchmarks.metrics.image_labels import FAMILIES, Labels
from roadscope.core import ImageDetections
from roadscope.detectors.camera.calibration import TERM_COUNT, BoxCalibration
from roadscope.detectors.camera.decoding import TRAITS, Peaks

NEWTON_STEPS = 100
LONGEST_STEP = 0.5
"""Greatest change of a weight in a Newton step, chosen by hand."""
PRIOR = 30.0
"""Strength of the prior, which draws the weights to scores that are the heat itself: about as
strong as this many boxes for each term. Chosen by hand."""
LEAST_SPREAD = 0.01
"""Least standard deviation of a trait, so that none is divided by 0."""
DIGITS = 4
"""Decimals that fitted values are rounded to."""


def fitted_calibration(peaks: Sequence[Peaks], labels: Sequence[Labels]) -> BoxCalibration:
    """Fit one logistic curve of traits and their products for each family.

    peaks, labels: of the same pictures. A box is right if it matches an object when boxes are
    matched by falling heat.
    """
    detections = [
        ImageDetections(
            p.boxes, p.categories.astype(np.int8), 1 / (1 + np.exp(-p.log_odds)), float(i)
        )
        for i, p in enumerate(peaks)
    ]
    traits = np.concatenate([np.empty((0, len(TRAITS))), *(p.traits for p in peaks)])
    standardised = _standardised(traits)
    # The prior's weights: scores that are the heat, which is the first trait.
    prior = np.zeros(TERM_COUNT)
    prior[0], prior[1] = standardised.middles[0], standardised.spreads[0]
    weights = []
    for family in range(len(FAMILIES)):
        boxes = _judged_boxes(peaks, detections, labels, family)
        weights.append(logistic(standardised.terms(boxes.traits), boxes.right, prior))
    return replace(standardised, weights=np.round(weights, DIGITS))


class _JudgedBoxes(NamedTuple):
    """Boxes that are right or wrong. traits: (N, 9). right: (N,) bool."""

    traits: np.ndarray
    right: np.ndarray


def _judged_boxes(
    peaks: Sequence[Peaks],
    detections: Sequence[ImageDetections],
    labels: Sequence[Labels],
    family: int,
) -> _JudgedBoxes:
    """Return the boxes of a family without those that are neither right nor wrong."""
    traits, right = [np.empty((0, len(TRAITS)))], [np.empty(0, bool)]
    for p, image in zip(peaks, images_of_family(detections, labels, family), strict=True):
        rows, hits = match_image(image)
        traits.append(p.traits[np.flatnonzero(p.families == family)[rows]])
        right.append(hits)
    return _JudgedBoxes(np.concatenate(traits), np.concatenate(right))


def _standardised(traits: np.ndarray) -> BoxCalibration:
    """Return a calibration with the means and standard deviations of (N, 9) traits."""
    if not len(traits):
        return BoxCalibration()
    spreads = np.maximum(traits.std(axis=0), LEAST_SPREAD)
    return BoxCalibration(traits.mean(axis=0).round(DIGITS), spreads.round(DIGITS))


def logistic(terms: np.ndarray, right: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Return (T,) weights of (N, T) terms in the log odds of being right, by Newton's method.

    right: (N,) bool. prior: (T,) mean of a normal prior of the weights.
    """
    weights = prior.copy()
    for _ in range(NEWTON_STEPS):
        chance = 1 / (1 + np.exp(-np.clip(terms @ weights, -40, 40)))
        gradient = terms.T @ (right - chance) - PRIOR * (weights - prior)
        hessian = (terms * (chance * (1 - chance))[:, None]).T @ terms + PRIOR * np.eye(len(prior))
        step = np.linalg.solve(hessian, gradient)
        weights += step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
    return weights
