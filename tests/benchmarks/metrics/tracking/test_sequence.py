from __future__ import annotations

import numpy as np
import pytest
from toy_sequences import sequence

from roadscope.core import RecordError
from roadscope.metrics import TrackedSequence


def test_ids_are_numbered_and_frames_found_again() -> None:
    s = sequence(([40, 30], [7], [0.5, 0.25]), ([], [9, 7], []), ([30], [9], [1.0]))
    assert (len(s), s.distinct_objects, s.distinct_tracks) == (3, 2, 2)
    assert s.truths.tolist() == [1, 0, 0]
    assert s.tracks.tolist() == [0, 1, 0, 1]
    assert [m.tolist() for m in s.matrices(s.similarities)] == [[[0.5], [0.25]], [], [[1.0]]]
    frames, rows, columns = s.places(np.arange(3))
    assert (frames.tolist(), rows.tolist(), columns.tolist()) == ([0, 0, 2], [0, 1, 2], [0, 0, 3])
    assert s.scores.tolist() == [1.0] * 4


def test_similarities_by_distances() -> None:
    ids, distances_m = [np.array([1])], [np.array([[0.0, 1.0, 9.0]])]
    s = TrackedSequence.of(ids, [np.array([7, 8, 9])], distances_m=distances_m, gate_m=1.0)
    assert s.similarities.tolist() == [1.0, 0.5, 0.0]
    with pytest.raises(ValueError, match="needs similarities or distances_m, got neither"):
        TrackedSequence.of(ids, ids)


def test_nothing_at_all() -> None:
    s = sequence()
    assert (len(s), s.distinct_objects, s.distinct_tracks, len(s.similarities)) == (0, 0, 0, 0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -0.1, 1.1])
def test_what_is_no_similarity_is_refused_by_name_and_frame(bad) -> None:
    wanted = "be in 0 to 1" if np.isfinite(bad) else "be finite"
    message = f"TrackedSequence.similarities: must {wanted}, got {bad:g} in frame 1"
    with pytest.raises(RecordError, match=message):
        sequence(([1], [7], [0.5]), ([1], [7, 8], [0.5, bad]))


def test_other_values_that_make_no_sense_are_refused() -> None:
    frame = ([1], [7], [0.5])
    with pytest.raises(RecordError, match="distances_m: must be in 0 to inf, got -1 in frame 0"):
        sequence(frame, distances_m=[np.array([[-1.0]])])
    with pytest.raises(RecordError, match="distances_m: must be finite, got nan in frame 0"):
        sequence(frame, distances_m=[np.array([[np.nan]])])
    with pytest.raises(RecordError, match="scores: must be finite, got nan in frame 0"):
        sequence(frame, scores=[np.array([np.nan])])
    with pytest.raises(RecordError, match="track_ids: not an array of int64"):
        TrackedSequence.of([np.array([1])], [np.array([7.5])], [np.array([[0.5]])])


def test_an_id_twice_in_a_frame_is_refused() -> None:
    with pytest.raises(
        RecordError, match=r"track_ids: expected unique ids .* got 7 twice in frame 1"
    ):
        sequence(([1], [7], [0.5]), ([1], [8, 7, 7], [0.5, 0.5, 0.5]))


def test_shapes_that_do_not_fit_are_refused() -> None:
    ids, two = np.array([1, 2]), np.ones((2, 1))
    with pytest.raises(
        RecordError, match=r"similarities: expected \(2, 1\) \(objects, tracks\) in"
    ):
        TrackedSequence.of([ids], [ids[:1]], [two.T])
    with pytest.raises(
        RecordError, match=r"scores: expected \(1,\) \(rows\) in frame 0, got \(2,\)"
    ):
        TrackedSequence.of([ids], [ids[:1]], [two], scores=[np.ones(2)])
    with pytest.raises(RecordError, match="similarities: expected shape"):
        TrackedSequence(np.array([1]), np.array([1]), ids[:1], ids[:1], np.ones(2), np.ones(1))
    with pytest.raises(RecordError, match="truth_counts: expected a sum of 1, got 2"):
        TrackedSequence(np.array([2]), np.array([1]), ids[:1], ids[:1], np.ones(2), np.ones(1))
