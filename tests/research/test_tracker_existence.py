import numpy as np
import pytest
from toy_boxes import detections

from research.tracker_existence import (
    PERSISTENCE,
    RecordedTargets,
    RecordingTracker,
    TargetTicks,
    existence_log_odds,
    likeliest_shift,
    log_loss,
    new_target_traits,
    persistence,
)
from roadscope.core import Category
from roadscope.trackers import read_detector

VALUES = np.array(list(PERSISTENCE.values()))


def simulated_ticks(tracks, ticks=20, seed=0):
    """Real ones have good scores and come back, false ones have bad scores and do not."""
    rng = np.random.default_rng(seed)
    n = tracks * ticks
    real = np.repeat(np.arange(tracks) % 2, ticks)
    tick = np.tile(np.arange(ticks), tracks)
    detected = (rng.random(n) < 0.7) | (tick == 0)
    evidence = np.where(detected, rng.normal(real * 3.0 - 1.5, 1.0), 0.0)
    away = np.zeros(n)
    for i in range(1, n):
        away[i] = 0.0 if detected[i] else away[i - 1] + 0.1
    return TargetTicks(
        np.repeat(np.arange(tracks), ticks),
        tick,
        detected,
        evidence,
        np.full(n, 2.0),
        np.full(n, 20.0),
        away,
        np.full(n, 0.1),
        real.astype(np.int8),
    )


def test_what_is_learned_is_likelier_than_the_guess():
    ticks = simulated_ticks(400)
    learned = persistence(ticks)
    assert log_loss(ticks, np.array(list(learned.values()))) < 0.9 * log_loss(ticks, VALUES)
    assert learned["back"] - learned["away_per_s"] * 0.2 > 0, "the real ones come back"


def test_of_too_few_tracks_nothing_is_learned():
    assert persistence(simulated_ticks(20)) == PERSISTENCE


def test_how_far_newcomers_fall_short_of_their_scores_is_learned_of_all_classes():
    """Scores are right of all others, but newcomers are there in 1 of 10 cases, not in half."""
    rng, n = np.random.default_rng(0), 4000
    first, zeros = np.tile([True, False], n), np.zeros(2 * n)
    right = np.where(first, np.repeat(rng.random(n) < 0.1, 2), 1).astype(np.int8)
    many = TargetTicks(
        np.repeat(np.arange(n), 2),
        np.tile([0, 1], n),
        np.ones(2 * n, bool),
        zeros,
        zeros,
        zeros,
        zeros,
        zeros,
        right,
    )
    few = TargetTicks(*(np.empty(0, getattr(many, name).dtype) for name in TargetTicks.__slots__))
    learned = new_target_traits(
        [
            RecordedTargets(many, np.array([[0, 0], [40, 58]])),
            RecordedTargets(few, np.zeros((2, 2))),
        ]
    )
    assert learned["seen_once"] == pytest.approx(-np.log(9), abs=0.2)
    assert learned["born"] == 0.41
    assert likeliest_shift(np.empty(0), np.empty(0)) == 0


def test_belief_is_the_trackers_own():
    """One target that is seen and then missed."""
    name, traits = "unknown", read_detector("unknown").traits
    values = np.array([getattr(traits, trait)[Category.CAR] for trait in PERSISTENCE])
    pattern = [True, True, True, False, False]
    tracker, log_odds = RecordingTracker(traits=name), []
    for t, detected in enumerate(pattern):
        box = detections([[10.0, 0.0, 0.8]], scores=0.8, frame="ego", stamp_s=0.1 * t)
        tracks = tracker.update(box.select(np.full(1, detected)), None)
        tracker.record(np.zeros(2), 0.1)
        log_odds.append(np.log(tracks.scores[0] / (1 - tracks.scores[0])))
    detected = np.array(pattern)
    odds = np.where(detected, np.log(4.0), 0.0)
    away = np.array([0, 0, 0, 0.1, 0.2])
    distances = np.array(tracker.rows)[:, 4]
    columns = np.column_stack([odds, distances, np.full(5, 10.0), away, np.full(5, 0.1)])
    assert existence_log_odds(np.zeros(5, int), detected, columns, values) == pytest.approx(
        log_odds, abs=1e-6
    )
