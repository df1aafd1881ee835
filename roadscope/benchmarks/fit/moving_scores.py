"""Fits the scores of the detectors of what moves anew, as `scores` does those of clusters.

    from roadscope.benchmarks.fit import moving_scores
    samples = moving_scores.gather("long-range", moving_scores.episodes())
    model = moving_scores.fit(samples)
    text = moving_scores.source(model, samples)  # what `detectors/long_range_weights.py` holds

Only train seeds are used.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.fit import scores
from roadscope.benchmarks.fit.scores import Samples
from roadscope.benchmarks.metrics.detection import GATE_M
from roadscope.benchmarks.metrics.matching import match
from roadscope.benchmarks.parked import parked_among
from roadscope.detectors import DETECTORS
from roadscope.detectors.long_range import LongRangeDetector, detections
from roadscope.detectors.long_range_scores import FEATURES
from roadscope.detectors.scoring import ScoreModel

SEEDS = range(300, 306)
ELIGIBILITY = Eligibility(range_m=(0.0, 80.0), min_returns=5)
"""As far and as little of an object as on the boards of sensors all round."""
KNOTS = 5
EVERY = 2
"""One frame of so many counts: a vehicle looks much the same in the next."""


def episodes(seeds: Iterable[int] = SEEDS) -> list[Episode]:
    """Return the episodes of `scores` with two of the four rigs each, by turns."""
    given = scores.episodes(seeds)
    rigs, scenarios = scores.RIGS, scores.SCENARIOS
    return [
        episode
        for episode in given
        if (rigs.index(episode.rig) + scenarios.index(episode.scenario) + episode.seed // 4) % 2
    ]


def gather(detector: str, given: Iterable[Episode]) -> Samples:
    """Collect what a detector of moving vehicles proposes in episodes, and what becomes of it."""
    values, right, missed = [np.empty((0, len(FEATURES)))], [np.empty(0, bool)], 0
    for episode in given:
        plugin, frames = _detector(detector), list(sensed(episode))
        parked = parked_among(episode, [truth for _, truth in frames])
        for number, (frame, truth) in enumerate(frames):
            found, stamp_s = plugin.propose(frame)
            if number % EVERY or not found:
                continue
            boxes = detections(found, np.zeros(len(found)), stamp_s)
            moved = boxes.moved(truth.world_from_ego, "world")
            fate = match(ELIGIBILITY.pairing(moved, truth, parked), GATE_M)
            features = np.array([f.features for f in found])
            values += [features[fate.detected], features[fate.false_alarms]]
            right.append(np.repeat([True, False], [len(fate.detected), len(fate.false_alarms)]))
            missed += len(fate.misses)
    return Samples(np.concatenate(values), np.concatenate(right), missed)


def fit(samples: Samples) -> ScoreModel:
    """Fit the curves to samples of `gather`."""
    return scores.fit(samples, FEATURES, knots=KNOTS)


def source(model: ScoreModel, samples: Samples) -> str:
    """Return the text of a module that holds the weights and says what they were fitted on."""
    return scores.source(model, samples, "moving_scores", SEEDS)


def _detector(spec: str) -> LongRangeDetector:
    plugin = DETECTORS.make(spec)
    if not isinstance(plugin, LongRangeDetector):
        raise ValueError(f"{spec}: these scores are for detectors of moving vehicles")
    plugin.reset()
    return plugin
