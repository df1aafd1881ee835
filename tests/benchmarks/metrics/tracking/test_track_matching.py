"""Who follows whom; the counts themselves are held to TrackEval's in `test_trackeval_parity`."""

from __future__ import annotations

import numpy as np
import pytest
from toy_sequences import sequence, wandering

from roadscope.benchmarks.metrics.tracking import count_matches, match_tracks
from roadscope.metrics import TrackedSequence, clear


def without(s: TrackedSequence, removed: np.ndarray) -> TrackedSequence:
    """The same sequence as if some tracks, by number, had never been."""
    frames = []
    for t, alike in enumerate(s.matrices(s.similarities)):
        columns = np.arange(s.track_starts[t], s.track_starts[t + 1])
        remaining = ~np.isin(s.tracks[columns], removed)
        truth_ids = s.truth_ids[s.truth_starts[t] : s.truth_starts[t + 1]]
        frames.append((truth_ids, s.track_ids[columns[remaining]], alike[:, remaining]))
    return sequence(*frames)


@pytest.mark.parametrize("seed", range(20))
def test_tracks_that_do_not_count_are_as_if_they_had_never_been(seed) -> None:
    s = wandering(seed)
    alive = np.random.default_rng(seed).random(s.distinct_tracks) < 0.6
    one = match_tracks(s, 0.5, alive)
    assert alive[one.tracks].all()
    assert count_matches(s, one, alive) == clear(without(s, np.flatnonzero(~alive)))


def test_places_agree() -> None:
    s = wandering(5)
    f = match_tracks(s, 0.5)
    frames, rows, columns = s.places(f.pairs)
    assert np.array_equal(f.frames, frames)
    assert np.array_equal(s.truths[rows], f.objects)
    assert np.array_equal(s.tracks[columns], f.tracks)
    assert (np.diff(f.frames) >= 0).all()
    assert (s.similarities[f.pairs] >= 0.5).all()
    for of_frame in (rows, columns):
        assert len(np.unique(of_frame)) == len(of_frame)


def test_what_was_matched_stays_matched() -> None:
    s = sequence(([1], [7], [1.0]), ([1, 2], [7, 8], [0.5, 0.9, 0.9, 0.1]))
    assert match_tracks(s).pairs.tolist() == [0, 1]
    # One pair is kept though two pairs would be closer.
    assert match_tracks(s).tracks.tolist() == [0, 0]


@pytest.mark.parametrize("threshold", [0.0, -1.0, 1.5])
def test_thresholds_that_make_no_sense_are_refused(threshold) -> None:
    with pytest.raises(ValueError, match="threshold: expected above 0 and up to 1"):
        match_tracks(wandering(0), threshold)
