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
    found = amota(*parts)
    reached = np.isfinite(found.least_scores)
    assert reached.any()
    for k in np.flatnonzero(reached):
        counts = [
            clear(without(s, np.flatnonzero(sureness(s) < found.least_scores[k] - 1e-9)))
            for s in parts
        ]
        c = sum(counts[1:], counts[0])
        wrong = c.misses + c.false_alarms + c.id_switches
        recall = (k + 1) / 40
        scaled = 1 - (wrong - (1 - recall) * c.present) / (recall * c.present)
        assert found.mota[k] == pytest.approx(1 - wrong / c.present)
        assert found.smota[k] == pytest.approx(np.clip(scaled, 0, 1))
        assert found.motp[k] == pytest.approx(c.motp)
    for curve in (found.mota, found.smota, found.motp):
        assert (curve[~reached] == 0).all()
    assert found.amota == pytest.approx(found.mota.sum() / 40)
    assert found.samota == pytest.approx(found.smota.sum() / 40)


def reference(scores: np.ndarray, present: int) -> list[float]:
    """AB3DMOT's rule as it is told: a score for each recall, the first for none."""
    found, wanted, ordered = [], 0.0, sorted(scores, reverse=True)
    for k, score in enumerate(ordered):
        here, after = (k + 1) / present, (k + 2) / present
        if k + 1 == len(ordered) or not after - wanted < wanted - here:
            found.append(score)
            wanted += 1 / 40
    return found[1:]


@pytest.mark.parametrize("present", [61, 100, 200, 1001])
@pytest.mark.parametrize("share", [0.03, 0.4, 0.7, 1.0])
def test_thresholds_as_ab3dmot_takes_them(present, share) -> None:
    scores = np.random.default_rng(present).random(int(share * present))
    assert least_scores(scores, present).tolist() == reference(scores, present)


@pytest.mark.parametrize("present", [1, 5, 39, 40, 60])
def test_every_recall_has_a_threshold_where_all_is_matched(present) -> None:
    found = least_scores(np.random.default_rng(present).random(present), present)
    assert len(found) == 40
    assert (np.diff(found) <= 0).all()


def test_scores_that_reach_each_recall() -> None:
    assert least_scores(np.arange(80) / 80, 80) == pytest.approx(np.arange(78, -1, -2) / 80)
    assert least_scores(np.arange(40) / 80, 80) == pytest.approx(np.arange(38, -1, -2) / 80)
    assert len(least_scores(np.empty(0), 80)) == 0
    assert len(RECALLS) == 40


def test_perfect_tracks_that_are_all_sure() -> None:
    s = sequence(*[([1, 2], [7, 8], [1.0, 0.0, 0.0, 1.0])] * 30)
    found = amota(s)
    assert (found.amota, found.samota, found.amotp) == (1.0, 1.0, 1.0)


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
    found = amota(s)
    assert (found.amota, found.samota, found.amotp) == (0.0, 0.0, 0.0)
    assert np.isnan(found.least_scores).all()
