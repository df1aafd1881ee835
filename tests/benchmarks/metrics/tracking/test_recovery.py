from __future__ import annotations

import numpy as np
from toy_sequences import sequence, wandering

from roadscope.benchmarks.metrics.tracking import NEVER, Recovery, match_tracks, recovery
from roadscope.metrics import TrackedSequence

GONE = ([], [], [])


def visible(track: int | None) -> tuple:
    """Object 1 with a track that follows it, or with none."""
    return ([1], [], []) if track is None else ([1], [track], [1.0])


def of(*frames: tuple) -> Recovery:
    s = sequence(*frames)
    return recovery(s, match_tracks(s))


def rows(gaps: Recovery) -> list[tuple[int, bool, int]]:
    columns = (gaps.hidden_frames.tolist(), gaps.same_track.tolist(), gaps.delays.tolist())
    return list(zip(*columns, strict=True))


def test_the_same_track_at_once() -> None:
    assert rows(of(visible(7), GONE, GONE, visible(7))) == [(2, True, 0)]


def test_another_track_later() -> None:
    assert rows(of(visible(7), GONE, visible(None), visible(None), visible(8), visible(7))) == [
        (1, False, 2)
    ]


def test_the_track_before_may_have_ended_before_the_object_was_hidden() -> None:
    assert rows(of(visible(7), visible(None), GONE, visible(7))) == [(1, True, 0)]


def test_objects_that_had_no_track_are_not_counted() -> None:
    assert rows(of(visible(None), GONE, visible(7))) == []
    assert rows(of(visible(7), visible(8))) == []


def test_hidden_twice() -> None:
    recoveries = of(visible(7), GONE, visible(None), GONE, GONE, GONE, visible(7), visible(7))
    assert rows(recoveries) == [(1, False, NEVER), (3, True, 0)]
    assert recoveries.reassociated.tolist() == [False, True]


def test_frames_in_which_others_are_visible_count_too() -> None:
    assert rows(of(visible(7), ([2], [9], [1.0]), GONE, visible(7))) == [(2, True, 0)]


def test_no_gaps() -> None:
    assert rows(of()) == []
    assert not of(visible(7)).reassociated.any()


def slow(s: TrackedSequence) -> list[tuple[int, bool, int]]:
    """Frame by frame, object by object."""
    f = match_tracks(s)
    at = {(t, g): k for t, g, k in zip(f.frames, f.objects, f.tracks, strict=True)}
    truths = np.split(s.truths, s.truth_starts[1:-1])
    expected_rows = []
    for g in range(s.distinct_objects):
        last, open_, hidden, length, returned = None, False, 0, 0, 0
        for t in range(len(s)):
            if g not in truths[t]:
                hidden += 1
                continue
            if hidden and last is not None:
                if open_:
                    expected_rows.append((length, False, NEVER))
                open_, length, returned = True, hidden, t
            hidden = 0
            track = at.get((t, g))
            if track is not None:
                if open_:
                    expected_rows.append((length, track == last, t - returned))
                    open_ = False
                last = track
        if open_:
            expected_rows.append((length, False, NEVER))
    return expected_rows


def test_as_the_slow_one_has_it() -> None:
    many = [wandering(seed) for seed in range(20)]
    recovery_rows = [rows(recovery(s, match_tracks(s))) for s in many]
    assert recovery_rows == [slow(s) for s in many]
    assert sum(map(len, recovery_rows)) > 100
