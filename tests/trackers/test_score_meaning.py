"""What scores of an unknown detector mean is learned from how long its detections go on."""

from dataclasses import replace

import numpy as np
import pytest
from tracked_scenes import T, both, boxes, run

from roadscope.core import Category, Pose
from roadscope.trackers import TRACKERS, PendingDetections, ScoreMeaning, rising

TICKS, CARS, CLUTTER = 60, 5, 6
TRANSFORMS = {
    "unchanged": lambda s: s,
    "squashed": lambda s: 1 / (1 + np.sqrt((1 - s) / s)),
    "rescaled": lambda s: 0.01 + 0.1 * s,
    "cubed": lambda s: s**3,
}


def tracked(transform, traits="unscaled"):
    """Track cars of high scores, and boxes anywhere for one frame, most of them of low scores."""
    rng, episode = np.random.default_rng(7), []
    for tick in range(TICKS):
        places = np.column_stack([np.linspace(5, 45, CARS) + 5 * T * tick, 8 * np.arange(CARS)])
        places += rng.normal(0, 0.05, (CARS, 2))
        anywhere = rng.uniform([0, -60], [60, -8], (CLUTTER, 2))
        cars = boxes(places, tick, rng.uniform(0.5, 0.95, CARS))
        frame = both(cars, boxes(anywhere, tick, rng.uniform(0.05, 0.6, CLUTTER)))
        episode.append(replace(frame, scores=TRANSFORMS[transform](frame.scores)))
    return run(TRACKERS.make(f"existence?traits={traits}"), episode, [Pose.identity()] * TICKS)


@pytest.mark.parametrize("transform", ["squashed", "rescaled", "cubed"])
def test_a_monotone_transform_of_scores_changes_no_track(transform):
    assert tracked(transform) == tracked("unchanged")


def test_cars_are_shown_and_clutter_is_not_whatever_the_scale():
    """All scores are below 0.11."""
    shown = [tracks.sure.centres[:, 1] for tracks in tracked("rescaled")[20:]]
    assert np.mean([(y > -4).sum() for y in shown]) > CARS - 0.1
    assert np.mean([(y < -4).sum() for y in shown]) < 0.1


@pytest.mark.parametrize(("scale", "contradicted"), [(1.0, False), (0.1, True), (3.0, True)])
def test_scores_that_are_no_probabilities_are_found_out(scale, contradicted):
    """Of as many objects as boxes of one frame; scores are even odds, times a scale."""
    rng, meaning = np.random.default_rng(2), ScoreMeaning()
    for tick in range(40):
        ids = np.append(np.arange(4), 4 + 4 * tick + np.arange(4))
        odds = scale * rng.normal(np.repeat([2.0, -2.0], 4), 2.0)
        streaks_s = np.repeat([tick * T, 0.0], 4)
        sections = np.zeros(8, np.int64)
        scores = 1 / (1 + np.exp(-odds + 2 * (scale > 1)))
        meaning.count(PendingDetections(tick * T, ids, scores, sections, streaks_s >= 1), streaks_s)
    assert meaning.contradicts_scores is contradicted


def test_probabilities_are_those_of_being_right():
    """As many objects as boxes of one frame; from 0.4 to 0.6 scores of both are equally dense."""
    rng, meaning = np.random.default_rng(1), ScoreMeaning()
    for tick in range(400):
        ids = np.append(np.arange(4), 4 + 4 * tick + np.arange(4))
        scores = np.append(rng.uniform(0.4, 1, 4), rng.uniform(0, 0.6, 4))
        streaks_s = np.repeat([tick * T, 0.0], 4)
        detected = PendingDetections(
            tick * T, ids, scores, np.zeros(8, np.int64), settled=streaks_s >= 1
        )
        meaning.count(detected, streaks_s)
    query_scores, cars = np.array([0.2, 0.5, 0.8]), np.full(3, Category.CAR)
    assert meaning.probabilities(query_scores, cars) == pytest.approx([0.02, 0.5, 0.98], abs=0.1)
    meaning.reset()
    assert (np.diff(meaning.probabilities(query_scores, cars)) > 0).all()


def meaning_of_one_score(went_on):
    """Learn from ticks of eight detections of one score; went_on: for each tick, of all eight."""
    meaning = ScoreMeaning()
    for tick, goes_on in enumerate(went_on):
        ids = np.arange(8) if goes_on else 100 + 8 * tick + np.arange(8)
        detected = PendingDetections(
            tick, ids, np.full(8, 0.7), np.zeros(8, np.int64), settled=np.zeros(8, bool)
        )
        meaning.count(detected, np.full(8, 10.0 if goes_on else 0.0))
    return meaning.probabilities(np.array([0.7]), np.array([Category.CAR]))[0]


def test_equal_scores_mean_the_same_in_whatever_order_they_came():
    ended, went_on = [False] * 12, [True] * 12
    first, last = meaning_of_one_score(ended + went_on), meaning_of_one_score(went_on + ended)
    assert first == pytest.approx(last, abs=0.02)
    # Half of them went on, of which 0.8 are taken to be right.
    assert first == pytest.approx(0.5 / 0.8, abs=0.05)


def test_pools_rise_and_keep_the_mean():
    values, weights = np.array([0.1, 0.5, 0.3, 0.2, 0.9]), np.array([1.0, 2.0, 1.0, 1.0, 3.0])
    pooled = rising(values, weights)
    assert pooled == pytest.approx([0.1, 0.375, 0.375, 0.375, 0.9])
    assert pooled @ weights == pytest.approx(values @ weights)
