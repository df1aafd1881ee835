"""nuScenes' AMOTA and AMOTP by hand and as defined, one frame and one recall after another."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from toy_sequences import sequence, wandering

from roadscope.benchmarks.metrics.tracking import NUSCENES_RECALLS
from roadscope.metrics import TrackedSequence, amota_nuscenes

GATE_M = 2.0


def events(s: TrackedSequence, selected_ids: set[int]) -> tuple[list[tuple[int, bool, float]], int]:
    """Matches as (track, switched, metres), and the frames of all tracks that are kept."""
    matches, track_frames = [], 0
    now: dict[int, int] = {}
    ever: dict[int, int] = {}
    for t, distances_m in enumerate(s.matrices(s.distances_m)):
        g = s.truths[s.truth_starts[t] : s.truth_starts[t + 1]].tolist()
        k = s.tracks[s.track_starts[t] : s.track_starts[t + 1]].tolist()
        columns = [j for j, track in enumerate(k) if track in selected_ids]
        track_frames += len(columns)
        if not g or not columns:
            continue
        pairs = [
            (i, j)
            for i, one in enumerate(g)
            for j in columns
            if now.get(one) == k[j] and distances_m[i, j] <= GATE_M
        ]
        rows = [i for i in range(len(g)) if i not in {i for i, _ in pairs}]
        rest = [j for j in columns if j not in {j for _, j in pairs}]
        gain = np.maximum(0, 2 * GATE_M - distances_m[np.ix_(rows, rest)])
        gain[distances_m[np.ix_(rows, rest)] > GATE_M] = 0
        pairs += [
            (rows[i], rest[j])
            for i, j in zip(*linear_sum_assignment(-gain), strict=True)
            if gain[i, j]
        ]
        now = {g[i]: k[j] for i, j in pairs}
        matches += [
            (k[j], ever.get(g[i], k[j]) != k[j], distances_m[i, j]) for i, j in sorted(pairs)
        ]
        ever |= now
    return matches, track_frames


def as_defined(parts: list[TrackedSequence]) -> tuple[list[float], list[float]]:
    """MOTAR and MOTP at each recall."""
    sure = [[s.scores[s.tracks == k].mean() for k in range(s.distinct_tracks)] for s in parts]
    P = sum(len(s.truths) for s in parts)
    scores = [
        own[track]
        for s, own in zip(parts, sure, strict=True)
        for track, switched, _ in events(s, set(range(s.distinct_tracks)))[0]
        if not switched
    ]
    scores.sort(reverse=True)
    motar, motp = [], []
    for r in NUSCENES_RECALLS:
        if r * P > len(scores):
            motar.append(0.0)
            motp.append(GATE_M)
            continue
        k = max(r * P - 1, 0)
        low = int(k)
        high = min(low + 1, len(scores) - 1)
        least = scores[low] + (k - low) * (scores[high] - scores[low])
        matches, track_frames = [], 0
        for s, own in zip(parts, sure, strict=True):
            part_matches, frames = events(s, {i for i, v in enumerate(own) if v >= least - 1e-9})
            matches, track_frames = matches + part_matches, track_frames + frames
        ids = sum(switched for _, switched, _ in matches)
        fn, fp = P - len(matches), track_frames - len(matches)
        recall = (len(matches) - ids) / P
        motar.append(max(0.0, 1 - (ids + fp + fn - (1 - recall) * P) / (recall * P)))
        motp.append(sum(distance_m for *_, distance_m in matches) / len(matches))
    return motar, motp


@pytest.mark.parametrize("seeds", [(0,), (3,), (8,), (1, 2, 3)])
def test_as_defined(seeds) -> None:
    parts = [wandering(seed, frames=30) for seed in seeds]
    figures = amota_nuscenes(*parts)
    motar, motp = as_defined(parts)
    np.testing.assert_allclose(figures.motar, motar, atol=1e-12)
    np.testing.assert_allclose(figures.motp_m, motp, atol=1e-12)
    assert figures.amota == pytest.approx(np.mean(motar))
    assert figures.amotp_m == pytest.approx(np.mean(motp))
    assert 0 < figures.amota < 1
    assert (np.isnan(figures.least_scores) == (figures.motp_m == GATE_M)).all()


def straight(distances_m: list[list[float]], scores: list[float]) -> TrackedSequence:
    """Forty frames of two objects at (2, tracks) distances."""
    n = len(scores)
    frames = 40
    return TrackedSequence.of(
        [np.array([1, 2])] * frames,
        [np.arange(n)] * frames,
        distances_m=[np.array(distances_m)] * frames,
        scores=[np.array(scores)] * frames,
    )


def test_perfect_tracks() -> None:
    figures = amota_nuscenes(straight([[0, 9], [9, 0]], [0.9, 0.8]))
    assert (figures.amota, figures.amotp_m) == (1.0, 0.0)


def test_unreached_recalls_are_as_bad_as_can_be() -> None:
    """Half of the objects are followed, half a metre off: recalls up to a half are reached."""
    figures = amota_nuscenes(straight([[0.5], [9]], [0.9]))
    half = (NUSCENES_RECALLS <= 0.5).mean()
    assert figures.amota == pytest.approx(half)
    assert figures.amotp_m == pytest.approx(0.5 * half + GATE_M * (1 - half))


def test_a_false_track_costs_from_its_score_on() -> None:
    """From a recall of a half on, when the third track counts: one false for every two right."""
    figures = amota_nuscenes(straight([[0, 9, 9], [9, 0, 9]], [0.9, 0.5, 0.7]))
    half = (NUSCENES_RECALLS <= 0.5).mean()
    assert figures.motar[0] == 1.0
    assert figures.motar[-1] == pytest.approx(0.5)
    assert figures.amota <= half + 0.5 * (1 - half)


def test_beyond_two_metres_nothing_matches() -> None:
    figures = amota_nuscenes(straight([[2.1, 9], [9, 2.1]], [0.9, 0.8]))
    assert (figures.amota, figures.amotp_m) == (0.0, GATE_M)
    wider = amota_nuscenes(straight([[2.1, 9], [9, 2.1]], [0.9, 0.8]), gate_m=4.0)
    assert (wider.amota, wider.amotp_m) == (1.0, pytest.approx(2.1))


def test_nothing_at_all_is_nothing() -> None:
    none = TrackedSequence.of([np.array([1])], [np.empty(0)], distances_m=[np.empty((1, 0))])
    for figures in (amota_nuscenes(none), amota_nuscenes()):
        assert (figures.amota, figures.amotp_m) == (0.0, GATE_M)
        assert np.isnan(figures.least_scores).all()


def test_distances_are_needed() -> None:
    with pytest.raises(ValueError, match="nuScenes' AMOTA is defined on distances"):
        amota_nuscenes(sequence(([1], [7], [1.0])))
