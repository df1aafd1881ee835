"""The fit finds what made its samples, and uses nothing but train seeds."""

import numpy as np
import pytest

from research import detector_scores as scores
from roadscope.benchmarks import Episode
from roadscope.detectors import FEATURES, ScoreModel

TRUE = ScoreModel(
    0.3, {"range_m": ((0.0, 30.0, 60.0), (2.0, 0.0, -3.0)), "deep": ((0.0, 1.0), (1.0, -2.0))}
)


def made_up(count, seed=0):
    rng = np.random.default_rng(seed)
    values = np.zeros((count, len(FEATURES)))
    values[:, FEATURES.index("range_m")] = rng.uniform(0, 60, count)
    values[:, FEATURES.index("deep")] = rng.random(count)
    return scores.ScoreSamples(values, rng.random(count) < TRUE.probabilities(values), 0)


def test_the_fit_finds_the_probabilities_that_made_its_samples():
    model = scores.fitted_scores(made_up(20_000), scores.CLUSTERS)
    others = made_up(2_000, 1)
    gap = model.probabilities(others.values) - TRUE.probabilities(others.values)
    assert np.sqrt(np.mean(gap**2)) < 0.03
    error, loss = scores.reliability(model, others)
    assert error < 0.05
    assert loss < 1.03 * scores.reliability(TRUE, others)[1]


def test_the_written_module_holds_the_model():
    samples = made_up(500)
    model = scores.fitted_scores(samples, scores.CLUSTERS)
    written: dict = {}
    exec(scores.source(model, samples, scores.CLUSTERS), written)
    assert ScoreModel(written["CONSTANT"], written["CURVES"]) == model


def test_only_train_seeds():
    with pytest.raises(ValueError, match="scores are fitted on train seeds"):
        scores.cluster_episodes([9_999, 10_000])


def test_only_cluster_detectors():
    with pytest.raises(ValueError, match="zhang2017: scores are fitted for cluster detectors"):
        scores.cluster_samples(["zhang2017"], [])


def test_samples_come_from_an_episode():
    samples = scores.cluster_samples(
        ["cluster?clustering=distance&shape=l-shape"], [Episode("two-way", 7, "lux", 0.6)]
    )
    assert samples.values.shape[1] == len(FEATURES)
    assert samples.right.any()
    assert samples.missed >= 0
