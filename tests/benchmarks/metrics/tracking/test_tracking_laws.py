"""What every tracking metric owes: the best for perfect tracks, names and order of no account."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_sequences import wandering

from roadscope.benchmarks.metrics.tracking import match_tracks, recovery
from roadscope.metrics import TrackedSequence, amota, clear, gospa, hota, identity, ospa

SEEDS = st.integers(0, 2**32 - 1)
FAMILIES = {
    "hota": hota,
    "clear": clear,
    "identity": identity,
    "amota": amota,
    "ospa": ospa,
    "gospa": gospa,
    "recovery": lambda s: recovery(s, match_tracks(s)),
}


def figures(s: TrackedSequence, family: str) -> list[np.ndarray]:
    """All fields of a family's result; of gaps in no order."""
    result = FAMILIES[family](s)
    values = [np.asarray(getattr(result, name), float) for name in result.__dataclass_fields__]
    return [np.sort(v) for v in values] if family == "recovery" else values


def changed(s: TrackedSequence, seed: int, *, rename: bool, reorder: bool) -> TrackedSequence:
    """The same sequence with other names, with rows in another order."""
    rng = np.random.default_rng(seed)
    names = [np.arange(n) for n in (s.distinct_objects, s.distinct_tracks)]
    if rename:
        names = [
            rng.permutation(10 * n + 1)[:n] - 5 for n in (s.distinct_objects, s.distinct_tracks)
        ]
    frames: list[list[Any]] = [[], [], [], [], []]
    assert s.distances_m is not None
    pairs = zip(s.matrices(s.similarities), s.matrices(s.distances_m), strict=True)
    for t, (alike, distances_m) in enumerate(pairs):
        rows = np.arange(s.truth_starts[t], s.truth_starts[t + 1])
        columns = np.arange(s.track_starts[t], s.track_starts[t + 1])
        orders = [np.arange(len(rows)), np.arange(len(columns))]
        if reorder:
            orders = [rng.permutation(len(rows)), rng.permutation(len(columns))]
        place = np.ix_(*orders)
        rows, columns = rows[orders[0]], columns[orders[1]]
        frame = (
            names[0][s.truths[rows]],
            names[1][s.tracks[columns]],
            alike[place],
            distances_m[place],
            s.scores[columns],
        )
        for column, values in zip(frames, frame, strict=True):
            column.append(values)
    truth_ids, track_ids, close, metres, scores = frames
    return TrackedSequence.of(truth_ids, track_ids, close, distances_m=metres, scores=scores)


@pytest.mark.parametrize("family", FAMILIES)
@given(seed=SEEDS)
def test_names_change_nothing(family, seed) -> None:
    s = wandering(seed)
    renamed = changed(s, seed, rename=True, reorder=False)
    for a, b in zip(figures(s, family), figures(renamed, family), strict=True):
        assert a == pytest.approx(b, abs=1e-12, nan_ok=True)


@pytest.mark.parametrize("family", FAMILIES)
@given(seed=SEEDS)
def test_the_order_of_rows_changes_nothing(family, seed) -> None:
    s = wandering(seed)
    shuffled = changed(s, seed, rename=False, reorder=True)
    for a, b in zip(figures(s, family), figures(shuffled, family), strict=True):
        assert a == pytest.approx(b, abs=1e-12, nan_ok=True)


def compared(seed: int, similarity: float, distance_m: float) -> TrackedSequence:
    """Objects that come and go, each with a track as good as is said."""
    rng = np.random.default_rng(seed)
    ids = [np.flatnonzero(rng.random(5) < 0.7) for _ in range(12)]
    return TrackedSequence.of(
        ids,
        [i + 50 for i in ids],
        [similarity * np.eye(len(i)) for i in ids],
        distances_m=[np.where(np.eye(len(i)), distance_m, 9.0) for i in ids],
    )


@given(SEEDS)
def test_perfect_tracks_get_the_best_of_everything(seed) -> None:
    s = compared(seed, 1.0, 0.0)
    h, c, i, a = hota(s), clear(s), identity(s), amota(s)
    for curve in (h.hota, h.det_a, h.det_re, h.det_pr, h.ass_a, h.ass_re, h.ass_pr, h.loc_a):
        assert curve == pytest.approx(np.ones(19))
    assert [c.mota, c.motp, c.recall, c.precision] == [1.0] * 4
    assert (c.id_switches, c.wrong_associations, c.misses, c.false_alarms) == (0, 0, 0, 0)
    assert (c.mostly_tracked, c.mostly_lost) == (s.distinct_objects, 0)
    assert [i.idf1, i.idp, i.idr] == [1.0] * 3
    assert [a.amota, a.samota, a.amotp] == pytest.approx([1.0] * 3)
    assert ospa(s).mean == gospa(s).mean == 0.0
    recoveries = recovery(s, match_tracks(s))
    assert len(recoveries)
    assert recoveries.same_track.all()
    assert not recoveries.delays.any()


@given(SEEDS)
def test_tracks_far_from_everything_get_the_worst(seed) -> None:
    s = compared(seed, 0.0, 9.0)
    h, c, i, a = hota(s), clear(s), identity(s), amota(s)
    assert not np.concatenate([h.hota, h.det_a, h.ass_a]).any()
    assert c.mota == -1.0
    assert (c.matches, c.mostly_lost) == (0, s.distinct_objects)
    assert i.idf1 == a.amota == a.samota == 0.0
    assert (ospa(s).distances[s.truth_counts > 0] == 2.0).all()
    assert gospa(s).distances.tolist() == (2.0 * s.truth_counts).tolist()
