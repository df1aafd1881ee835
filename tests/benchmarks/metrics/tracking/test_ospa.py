"""OSPA and GOSPA by hand, by search over all pairings, and beside Stone Soup's."""

from __future__ import annotations

import itertools
import math
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_sequences import sequence, wandering

from roadscope.benchmarks.metrics import centre_distances
from roadscope.metrics import TrackedSequence, gospa, ospa

START = datetime(2026, 1, 1)
COUNTS = st.integers(0, 4)


def sequence_of(*frames: Any) -> TrackedSequence:
    """Join frames of (objects, tracks) distances."""
    shaped = [np.asarray(f, float) for f in frames]
    alike = [np.zeros_like(f) for f in shaped]
    ids = [(np.arange(f.shape[0]), np.arange(f.shape[1])) for f in shaped]
    return TrackedSequence.of([g for g, _ in ids], [k for _, k in ids], alike, distances_m=shaped)


def places(seed: int, frames: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Objects and tracks of frames, (M, 2) and (N, 2); at least one of either."""
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(frames):
        m, n = rng.integers(0, 7, 2)
        m += m + n == 0
        drawn.append((rng.uniform(0, 9, (m, 2)), rng.uniform(0, 9, (n, 2))))
    return drawn


def stone_soup(metric: Any, frames: list[tuple[np.ndarray, np.ndarray]]) -> list[Any]:
    state = pytest.importorskip("stonesoup.types.state").State
    joined: list[list[Any]] = [[], []]
    for t, frame in enumerate(frames):
        for side, positions in zip(joined, frame, strict=True):
            side += [state(p.reshape(2, 1), timestamp=START + timedelta(t)) for p in positions]
    truths, tracks = joined
    metric_result = metric.compute_over_time(tracks, range(len(tracks)), truths, range(len(truths)))
    return [part.value for part in metric_result.value]


@pytest.mark.parametrize("order", [1, 2, 3.5])
@pytest.mark.parametrize("seed", range(3))
def test_gospa_as_stone_soup_has_it(seed, order) -> None:
    metrics = pytest.importorskip("stonesoup.metricgenerator.ospametric")
    frames = places(seed, 30)
    theirs = stone_soup(metrics.GOSPAMetric(c=4.0, p=order), frames)
    ours = gospa(sequence_of(*(centre_distances(g, t) for g, t in frames)), 4.0, order)
    for name, values in (
        ("distance", ours.distances),
        ("localisation", ours.localisation),
        ("missed", ours.missed),
        ("false", ours.false),
    ):
        assert values == pytest.approx([v[name] for v in theirs], abs=1e-9, rel=1e-12), name


@pytest.mark.parametrize(("order", "pairing"), [(1, None), (2, 1), (3.5, 1)])
@pytest.mark.parametrize("seed", range(3))
def test_ospa_as_stone_soup_has_it(seed, order, pairing) -> None:
    """Stone Soup pairs by plain distances whatever the order: asked to, so do we."""
    metrics = pytest.importorskip("stonesoup.metricgenerator.ospametric")
    frames = places(seed, 30)
    theirs = stone_soup(metrics.OSPAMetric(c=4.0, p=order), frames)
    s = sequence_of(*(centre_distances(g, t) for g, t in frames))
    ours = ospa(s, 4.0, order, pairing_order=pairing)
    assert ours.distances == pytest.approx(theirs, abs=1e-9, rel=1e-12)
    assert (ospa(s, 4.0, order).distances <= ours.distances + 1e-12).all()


@given(COUNTS, COUNTS, st.integers(0, 2**32 - 1), st.sampled_from([1.0, 2.0]))
def test_as_defined(m, n, seed, order) -> None:
    """Least over all ways to pair the smaller set with part of the larger."""
    distances = np.random.default_rng(seed).integers(0, 7, (m, n)).astype(float)
    costs = np.minimum(distances, 4.0) ** order
    costs = costs if m <= n else costs.T
    small, large = costs.shape
    ways = itertools.permutations(range(large), small)
    best = min(sum(costs[i, j] for i, j in enumerate(assignment)) for assignment in ways)
    s = sequence_of(distances)
    penalty = 4.0**order * (large - small)
    expected = ((best + penalty) / large) ** (1 / order) if large else 0.0
    assert ospa(s, 4.0, order).mean == pytest.approx(expected)
    assert gospa(s, 4.0, order).mean == pytest.approx((best + penalty / 2) ** (1 / order))


def test_by_hand() -> None:
    s = sequence_of([[1.0, 9.0], [9.0, 9.0]], [[3.0]], np.empty((0, 2)), np.empty((0, 0)))
    assert ospa(s, 2.0).distances.tolist() == [1.5, 2.0, 2.0, 0.0]
    result = gospa(s, 2.0)
    assert result.distances.tolist() == [3.0, 2.0, 2.0, 0.0]
    assert result.localisation.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert result.missed.tolist() == [1.0, 1.0, 0.0, 0.0]
    assert result.false.tolist() == [1.0, 1.0, 2.0, 0.0]
    assert result.mean == 7 / 4


def test_parts_sum() -> None:
    s = wandering(3)
    one, whole = ospa(s, 2.0, 2.0), gospa(s, 2.0, 2.0)
    assert one.distances**2 == pytest.approx(one.localisation + one.cardinality)
    assert whole.distances**2 == pytest.approx(whole.localisation + whole.missed + whole.false)


def test_what_has_no_distances_or_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match=r"GOSPA is defined on distances: give .* distances_m"):
        gospa(sequence(([1], [2], [0.5])))
    with pytest.raises(ValueError, match="cutoff_m: expected metres above 0, got 0"):
        ospa(sequence_of([[1.0]]), 0.0)
    with pytest.raises(ValueError, match=r"order: expected 1 or more, finite, got 0\.5"):
        gospa(sequence_of([[1.0]]), 2.0, 0.5)


def test_no_frames_no_mean() -> None:
    assert math.isnan(ospa(sequence_of()).mean)
    assert math.isnan(gospa(sequence_of()).mean)
