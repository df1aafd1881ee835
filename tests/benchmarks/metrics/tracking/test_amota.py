"""AMOTA by hand and as defined: a sequence of its own for every threshold."""

from __future__ import annotations

import numpy as np
import pytest
from test_track_matching import without
from toy_sequences import sequence, wandering

from roadscope.benchmarks.metrics.tracking import RECALLS, least_scores
from roadscope.metrics import TrackedSequence, amota, clear


def sureness(s: TrackedSequence) -> np.ndarray:
    return np.array([s.scores[s.tracks == k].mean() for k in range(s.distinct_tracks)])


@pytest.mark.parametrize("seeds", [(0,), (7,), (1, 2, 3)])
def test_as_defined(seeds) -> None:
    parts = [wandering(seed, frames=30) for seed in seeds]
    figures = amota(*parts)
    reached = np.isfinite(figures.least_scores)
    assert reached.any()
    for k in np.flatnonzero(reached):
        counts = [
            clear(without(s, np.flatnonzero(sureness(s) < figures.least_scores[k] - 1e-9)))
            for s in parts
        ]
        c = sum(counts[1:], counts[0])
        wrong = c.misses + c.false_alarms + c.id_switches
        recall = (k + 1) / 40
        scaled = 1 - (wrong - (1 - recall) * c.present) / (recall * c.present)
        assert figures.mota[k] == pytest.approx(1 - wrong / c.present)
        assert figures.smota[k] == pytest.approx(np.clip(scaled, 0, 1))
        assert figures.motp[k] == pytest.approx(c.motp)
    for curve in (figures.mota, figures.smota, figures.motp):
        assert (curve[~reached] == 0).all()
    assert figures.amota == pytest.approx(figures.mota.sum() / 40)
    assert figures.samota == pytest.approx(figures.smota.sum() / 40)


def reference(scores: np.ndarray, present: int) -> list[float]:
    """AB3DMOT's rule as published: a score for each recall, the first for none."""
    thresholds, wanted, ordered = [], 0.0, sorted(scores, reverse=True)
    for k, score in enumerate(ordered):
        here, after = (k + 1) / present, (k + 2) / present
        if k + 1 == len(ordered) or not after - wanted < wanted - here:
            thresholds.append(score)
            wanted += 1 / 40
    return thresholds[1:]


@pytest.mark.parametrize("present", [61, 100, 200, 1001])
@pytest.mark.parametrize("share", [0.03, 0.4, 0.7, 1.0])
def test_thresholds_as_ab3dmot_takes_them(present, share) -> None:
    scores = np.random.default_rng(present).random(int(share * present))
    assert least_scores(scores, present).tolist() == reference(scores, present)


@pytest.mark.parametrize("present", [1, 5, 39, 40, 60])
def test_every_recall_has_a_threshold_where_all_is_matched(present) -> None:
    thresholds = least_scores(np.random.default_rng(present).random(present), present)
    assert len(thresholds) == 40
    assert (np.diff(thresholds) <= 0).all()


def test_scores_that_reach_each_recall() -> None:
    assert least_scores(np.arange(80) / 80, 80) == pytest.approx(np.arange(78, -1, -2) / 80)
    assert least_scores(np.arange(40) / 80, 80) == pytest.approx(np.arange(38, -1, -2) / 80)
    assert len(least_scores(np.empty(0), 80)) == 0
    assert len(RECALLS) == 40


def test_perfect_tracks_that_are_all_sure() -> None:
    s = sequence(*[([1, 2], [7, 8], [1.0, 0.0, 0.0, 1.0])] * 30)
    figures = amota(s)
    assert (figures.amota, figures.samota, figures.amotp) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    "s",
    [
        sequence(),
        sequence(([], [], [])),
        sequence(([1], [], [])),
        sequence(([], [7], [])),
        sequence(([1], [7], [0.0])),
    ],
)
def test_nothing_matched_is_nothing(s) -> None:
    figures = amota(s)
    assert (figures.amota, figures.samota, figures.amotp) == (0.0, 0.0, 0.0)
    assert np.isnan(figures.least_scores).all()
