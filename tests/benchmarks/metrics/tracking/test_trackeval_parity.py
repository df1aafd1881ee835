"""HOTA, CLEAR and identity beside TrackEval's, to 1e-9, wherever that is installed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from toy_sequences import sequence, wandering

from research.speed_metrics import as_trackeval
from roadscope.metrics import TrackedSequence, clear, hota, identity

theirs = pytest.importorskip("trackeval.metrics")

CURVES = {
    "HOTA": "hota",
    "DetA": "det_a",
    "AssA": "ass_a",
    "LocA": "loc_a",
    "DetRe": "det_re",
    "DetPr": "det_pr",
    "AssRe": "ass_re",
    "AssPr": "ass_pr",
}
COUNTS = {
    "CLR_TP": "matches",
    "CLR_FN": "misses",
    "CLR_FP": "false_alarms",
    "IDSW": "id_switches",
    "Frag": "fragmentations",
    "MT": "mostly_tracked",
    "PT": "partially_tracked",
    "ML": "mostly_lost",
    "MOTA": "mota",
    "MOTP": "motp",
    "CLR_Re": "recall",
    "CLR_Pr": "precision",
}
SHARES = {"IDTP": "hits", "IDF1": "idf1", "IDR": "idr", "IDP": "idp"}

ALIKE = st.sampled_from([0.0, 0.05, 0.25, 0.5 - 2**-53, 0.5, 0.5, 0.75, 0.95, 1.0])
"""Few values, so that ties abound, and those that decide."""


def check(s: TrackedSequence, threshold: float = 0.5) -> None:
    data = as_trackeval(s)
    settings_ = {"PRINT_CONFIG": False, "THRESHOLD": threshold}
    for metric, ours, names in (
        (theirs.HOTA(), hota(s), CURVES),
        (theirs.CLEAR(settings_), clear(s, threshold), COUNTS),
        (theirs.Identity(settings_), identity(s, threshold), SHARES),
    ):
        trackeval_result = metric.eval_sequence(data)
        for name, own in names.items():
            assert getattr(ours, own) == pytest.approx(trackeval_result[name], abs=1e-9, rel=0), (
                name
            )


@st.composite
def adversarial(draw: st.DrawFn) -> TrackedSequence:
    """Few ids in any order, frames without objects or tracks, ties everywhere."""
    frames = []
    for _ in range(draw(st.integers(1, 6))):
        ids = st.lists(st.integers(0, 4), unique=True, max_size=4)
        truth_ids, track_ids = draw(ids), draw(ids)
        size = len(truth_ids) * len(track_ids)
        frames.append((truth_ids, track_ids, draw(st.lists(ALIKE, min_size=size, max_size=size))))
    return sequence(*frames)


@pytest.mark.slow
@given(adversarial(), st.sampled_from([0.05, 0.25, 0.5, 1.0]))
@settings(max_examples=200)
@example(sequence(([], [], []), ([], [], [])), 0.5)
@example(sequence(([1], [], []), ([2], [], [])), 0.5)
@example(sequence(([], [1], []), ([], [2], [])), 0.5)
@example(sequence(([1], [7], [1.0])), 0.5)
@example(sequence(([1, 2], [7, 8], np.zeros(4))), 0.5)
@example(sequence(([1, 2], [7, 8], np.ones(4)), ([2, 1], [7, 8], np.ones(4))), 0.5)
def test_adversarial_sequences(s, threshold) -> None:
    check(s, threshold)


@pytest.mark.parametrize("seed", range(40))
def test_random_sequences(seed) -> None:
    check(wandering(seed))


@pytest.mark.parametrize("seed", range(3))
def test_crowded_sequences(seed) -> None:
    check(wandering(seed, objects=30, frames=40))


def test_several_sequences_add_up() -> None:
    parts = {name: wandering(seed) for seed, name in enumerate("abc")}
    a, b, c = parts.values()
    data = {name: as_trackeval(part) for name, part in parts.items()}
    for metric, ours, names in (
        (theirs.HOTA(), hota(a) + hota(b) + hota(c), CURVES),
        (theirs.CLEAR({"PRINT_CONFIG": False}), clear(a) + clear(b) + clear(c), COUNTS),
        (theirs.Identity({"PRINT_CONFIG": False}), identity(a) + identity(b) + identity(c), SHARES),
    ):
        trackeval_result = metric.combine_sequences(
            {n: metric.eval_sequence(d) for n, d in data.items()}
        )
        for name, own in names.items():
            assert getattr(ours, own) == pytest.approx(trackeval_result[name], abs=1e-9, rel=0), (
                name
            )
