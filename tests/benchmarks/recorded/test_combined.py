"""Figures of many sequences as one: those that TrackEval combines, and their spread."""

import numpy as np
import pytest

from research.speed_metrics import as_trackeval
from roadscope.benchmarks.metrics import part_name
from roadscope.benchmarks.metrics.tracking import ALPHA_BANDS, BY_ALPHA
from roadscope.benchmarks.recorded import (
    COMBINED,
    alpha_parts,
    combined_band,
    combined_hota,
    combined_mota,
    nees_band,
    sequence_scores,
)
from roadscope.benchmarks.results import pooled_interval
from roadscope.metrics import TrackedSequence, clear, hota


def random_sequence(seed: int, objects: int = 4, frames: int = 20) -> TrackedSequence:
    """Tracks that mostly follow one object each, some frames empty."""
    rng = np.random.default_rng(seed)
    ids, followers, alike = [], [], []
    for _ in range(frames):
        there = np.flatnonzero(rng.random(objects) < 0.8)
        tracks = np.flatnonzero(rng.random(objects + 1) < 0.8)
        similarity = np.where(there[:, None] == tracks, 0.9, 0.1) * rng.random(
            (len(there), len(tracks))
        )
        ids.append(there)
        followers.append(tracks + 10)
        alike.append(similarity)
    return TrackedSequence.of(ids, followers, alike)


SEQUENCES = [random_sequence(s, objects=n) for s, n in enumerate((4, 7, 0, 2, 5, 3))]
EPISODES = [{**sequence_scores(s, 0.5), **alpha_parts(hota(s))} for s in SEQUENCES]


def mean_of(parts) -> float:
    return pooled_interval(parts).mean


@pytest.mark.parametrize("metric", ["hota", "det_a", "ass_a", "loc_a"])
def test_hota_is_that_of_all_sequences_as_one(metric):
    together = sum((hota(s) for s in SEQUENCES[1:]), hota(SEQUENCES[0]))
    expected = getattr(together, metric).mean()
    assert mean_of(combined_hota(EPISODES, metric)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("number", [0, 9, 18])
def test_at_one_alpha_it_is_that_of_all_sequences_as_one(number):
    together = sum((hota(s) for s in SEQUENCES[1:]), hota(SEQUENCES[0]))
    name = part_name("hota", BY_ALPHA, ALPHA_BANDS[number])
    figure = mean_of(COMBINED[name](EPISODES, name))
    assert figure == pytest.approx(together.hota[number], abs=1e-12)


def test_it_is_trackevals_combined_figure():
    metrics = pytest.importorskip("trackeval.metrics")
    theirs = {
        str(i): metrics.HOTA().eval_sequence(as_trackeval(s)) for i, s in enumerate(SEQUENCES)
    }
    combined = metrics.HOTA().combine_sequences(theirs)
    for key, metric in (("HOTA", "hota"), ("DetA", "det_a"), ("AssA", "ass_a"), ("LocA", "loc_a")):
        ours = mean_of(combined_hota(EPISODES, metric))
        assert ours == pytest.approx(combined[key].mean(), abs=1e-9)
    clears = metrics.CLEAR({"PRINT_CONFIG": False})
    theirs = {str(i): clears.eval_sequence(as_trackeval(s)) for i, s in enumerate(SEQUENCES)}
    mota = clears.combine_sequences(theirs)["MOTA"]
    assert mean_of(combined_mota(EPISODES, "mota")) == pytest.approx(mota, abs=1e-9)


def test_false_alarms_of_empty_sequences_count():
    """The third sequence has no object, so no MOTA of its own."""
    assert np.isnan(EPISODES[2]["mota"].value)
    without = [e for i, e in enumerate(EPISODES) if i != 2]
    together = sum((clear(s) for s in SEQUENCES[1:]), clear(SEQUENCES[0]))
    assert mean_of(combined_mota(EPISODES, "mota")) == pytest.approx(together.mota, abs=1e-12)
    assert mean_of(combined_mota(without, "mota")) > together.mota
    assert mean_of(combined_hota(without, "hota")) > mean_of(combined_hota(EPISODES, "hota"))


@pytest.mark.parametrize(("metric", "combine"), [("hota", combined_hota), ("mota", combined_mota)])
def test_their_spread_is_that_of_the_figure(metric, combine):
    """Against leaving one of many sequences out (the jackknife)."""
    many = [random_sequence(100 + s, objects=1 + s % 6) for s in range(40)]
    episodes = [{**sequence_scores(s, 0.5), **alpha_parts(hota(s))} for s in many]
    parts = np.array([score.value for score in combine(episodes, metric)])
    linear = parts.std(ddof=1) / np.sqrt(len(parts))
    left = [
        mean_of(combine([e for j, e in enumerate(episodes) if j != i], metric))
        for i in range(len(episodes))
    ]
    jackknife = np.sqrt((len(left) - 1) / len(left) * ((left - np.mean(left)) ** 2).sum())
    assert linear == pytest.approx(jackknife, rel=0.1)


def test_nothing_to_track_has_no_figure():
    empty = [EPISODES[2]]
    assert np.isnan(mean_of(combined_hota(empty, "hota")))
    assert np.isnan(mean_of(combined_mota(empty, "mota")))


def test_the_band_of_nees_is_that_of_all_objects():
    """Sums of N chi-square values of two degrees of freedom, over 2 N, against drawn ones."""
    objects = [3, 0, 7]
    episodes = [dict(zip(("nees_low", "nees_high"), nees_band(n), strict=True)) for n in objects]
    low, high = (mean_of(combined_band(episodes, end)) for end in ("nees_low", "nees_high"))
    assert [low, high] == pytest.approx([end.value for end in nees_band(10)])
    drawn = np.random.default_rng(0).chisquare(2, (100_000, 10)).mean(axis=1) / 2
    assert np.quantile(drawn, [0.025, 0.975]) == pytest.approx([low, high], abs=0.02)
    assert np.isnan(episodes[1]["nees_low"].value)
