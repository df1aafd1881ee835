"""Scores of what moves are fitted on what the detectors of moving vehicles propose."""

import numpy as np
import pytest

from research import detector_scores as scores
from roadscope.benchmarks import Episode
from roadscope.detectors import MOVING_FEATURES, ScoreModel


def test_samples_of_an_episode_are_fitted_and_written():
    samples = scores.moving_samples("zhang2017", [Episode("two-way", 7, "hdl32e", 1.2)])
    assert samples.values.shape == (len(samples.right), len(MOVING_FEATURES))
    assert np.isfinite(samples.values).all()
    assert samples.right.any()
    model = scores.fitted_scores(samples, scores.MOVING)
    written: dict = {}
    exec(scores.source(model, samples, scores.MOVING), written)
    assert ScoreModel(written["CONSTANT"], written["CURVES"], MOVING_FEATURES) == model


def test_two_rigs_of_every_scenario_and_seed_and_all_in_all_weathers():
    episodes = scores.moving_episodes()
    assert len(episodes) == len(scores.cluster_episodes(scores.MOVING.seeds)) / 2
    for rig in scores.RIGS:
        of_rig = [episode for episode in episodes if episode.rig == rig]
        assert {episode.weather for episode in of_rig} == {"clear", "rain", "fog"}
        assert {episode.scenario for episode in of_rig} == set(scores.SCENARIOS)


def test_only_detectors_of_moving_vehicles():
    with pytest.raises(ValueError, match="cluster: these scores are for detectors of moving"):
        scores.moving_samples("cluster", [Episode("two-way", 7, "lux", 0.3)])
