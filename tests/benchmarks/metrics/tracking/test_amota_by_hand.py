"""AB3DMOT's averages on scenes whose figures were worked out by hand, from the definition alone.

With L = 40 recalls r = 1/L to 1: AMOTA is the mean of 1 - E / P, sAMOTA of
max(0, 1 - (E - (1 - r) P) / (r P)), where P are object frames and E false alarms, misses and ID
switches of the tracks as sure as the match by which r is reached. All scenes have 80 or 160 object
frames, so that recall k / 40 is reached by match 2 k or 4 k.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from roadscope.metrics import TrackedSequence, amota, amota_nuscenes

TrackTable = Mapping[int, tuple[range, int | None, float]]
"""Of each track: when it is there, which object it lies on, if any, and its score."""
SIMILARITY = 0.8
DISTANCE_M = 0.4
FAR_M = 50.0


def scene(frames: int, objects: int, tracks: TrackTable, scores=None) -> TrackedSequence:
    """Objects 0 to n - 1 that are always there; scores: of tracks frame by frame, if not one."""
    ids, alike, distances_m, sure = [], [], [], []
    for t in range(frames):
        here = [k for k, (when, _, _) in tracks.items() if t in when]
        on = np.array([[tracks[k][1] == i for k in here] for i in range(objects)], bool)
        on = on.reshape(objects, len(here))
        ids.append(here)
        alike.append(np.where(on, SIMILARITY, 0.0))
        distances_m.append(np.where(on, DISTANCE_M, FAR_M))
        sure.append([tracks[k][2] if scores is None else scores[k][t] for k in here])
    return TrackedSequence.of(
        [list(range(objects))] * frames, ids, alike, distances_m=distances_m, scores=sure
    )


def figures(*scenes: TrackedSequence) -> list[float]:
    result = amota(*scenes)
    return pytest.approx([result.amota, result.samota, result.amotp], abs=1e-12)


def test_an_object_handed_from_one_track_to_another() -> None:
    """r <= 1/2: 40 misses. Beyond: one switch, which scaling forgives but for r = 1."""
    s = scene(80, 1, {1: (range(40), 0, 0.9), 2: (range(40, 80), 0, 0.5)})
    expected = [(20 * 0.5 + 20 * (1 - 1 / 80)) / 40, (39 + 1 - 1 / 80) / 40, SIMILARITY]
    assert expected == figures(s)


def test_a_false_track_counts_from_its_score_on_and_nuscenes_averages_otherwise() -> None:
    """r > 1/2: 80 false alarms and a switch, so MOTA is -1/80, and scaled 0.

    nuScenes asks for recalls from 0.1 on: 18 of 40 lie at or below 1/2, and it leaves 0 for others.
    """
    tracks = {1: (range(40), 0, 0.9), 2: (range(40, 80), 0, 0.5), 3: (range(80), None, 0.7)}
    s = scene(80, 1, tracks)
    assert figures(s) == [(20 * 0.5 - 20 / 80) / 40, 0.5, SIMILARITY]
    assert amota_nuscenes(s).amota == pytest.approx(18 / 40)


def test_recalls_that_are_never_reached_are_0() -> None:
    """One of two objects has no track: 20 of 40 recalls are reached, with 80 of 160 missed."""
    s = scene(80, 2, {1: (range(80), 0, 0.9)})
    assert figures(s) == [0.5 * 0.5, 0.5, 0.5 * SIMILARITY]
    assert np.isfinite(amota(s).least_scores).sum() == 20


@pytest.mark.parametrize(("false", "accuracy"), [(0.7, 0.0), (0.7 - 1e-6, 1.0)])
def test_a_tie_counts(false, accuracy) -> None:
    """As sure as the right track it counts at every recall, a little less sure at none."""
    s = scene(80, 1, {1: (range(80), 0, 0.7), 2: (range(80), None, false)})
    assert [accuracy, accuracy, SIMILARITY] == figures(s)


@pytest.mark.parametrize(("false", "accuracy"), [(0.65, 0.0), (0.55, 1.0)])
def test_a_track_is_as_sure_as_the_mean_of_its_scores(false, accuracy) -> None:
    """The right one 0.6 by scores of 1 and 0.2: neither its best nor its latest score decides."""
    scores = {1: [1.0] * 40 + [0.2] * 40, 2: [false] * 80}
    s = scene(80, 1, {1: (range(80), 0, 0.0), 2: (range(80), None, 0.0)}, scores)
    assert [accuracy, accuracy, SIMILARITY] == figures(s)


def test_frames_without_a_match_are_part_of_the_mean_and_false() -> None:
    """Half of a track of 160 frames lies on nothing, at 0.2: with 1.0 on the object it is 0.6."""
    scores = {1: [1.0] * 80 + [0.2] * 80, 2: [0.65] * 160}
    tracks = {1: (range(160), 0, 0.0), 2: (range(160), None, 0.0)}
    s = scene(160, 1, tracks, scores)
    there = TrackedSequence.of(
        [[0] if t < 80 else [] for t in range(160)],
        [[1, 2]] * 160,
        [s_ if t < 80 else np.empty((0, 2)) for t, s_ in enumerate(s.matrices(s.similarities))],
        scores=[[scores[1][t], scores[2][t]] for t in range(160)],
    )
    assert figures(there) == [1 - 240 / 80, 0.0, SIMILARITY]


def test_sequences_are_one_population_of_scores_and_ids_are_each_their_own() -> None:
    """r <= 1/2: 40 misses in the second. Beyond: its 40 false alarms; scaled 1 / (2 r)."""
    sure = scene(40, 1, {1: (range(40), 0, 0.9)})
    unsure = scene(40, 1, {1: (range(40), None, 0.7), 2: (range(40), 0, 0.5)})
    scaled = (20 + sum(0.5 / (k / 40) for k in range(21, 41))) / 40
    assert [0.5, scaled, SIMILARITY] == figures(sure, unsure)


def test_a_sequence_without_objects_gives_its_false_alarms() -> None:
    """20 of them at 0.95, beside 80 object frames: MOTA 3/4 at each recall; scaled to each."""
    held = scene(80, 1, {1: (range(80), 0, 0.9)})
    bare = scene(20, 0, {1: (range(20), None, 0.95)})
    scaled = sum(max(0.0, min(1.0, 1 - (20 - 80 * (1 - k / 40)) / (2 * k))) for k in range(1, 41))
    assert [0.75, scaled / 40, SIMILARITY] == figures(held, bare)
    result = amota(bare)
    assert (result.amota, result.samota, result.amotp) == (0.0, 0.0, 0.0)


def drawn(rng: np.random.Generator) -> tuple[int, int, dict[int, tuple[range, int | None, float]]]:
    """Stretches of objects, each under a track of its own, and false tracks."""
    frames, objects, tracks = 80, 3, {}
    for i in range(objects):
        cuts = np.sort(rng.choice(np.arange(5, frames), 3, replace=False))
        for a, b in zip([0, *cuts], [*cuts, frames], strict=True):
            if rng.random() < 0.8:
                tracks[len(tracks)] = (range(a, b), i, float(rng.random()))
    for _ in range(3):
        a = int(rng.integers(60))
        tracks[len(tracks)] = (range(a, a + 15), None, float(rng.random()))
    return frames, objects, tracks


@pytest.mark.parametrize("seed", range(20))
def test_scenes_of_chance_counted_in_words(seed) -> None:
    """Recall k / 40 of 240 object frames is reached by match 6 k.

    No track lies on two objects, so matches, false alarms and switches can be counted by hand.
    """
    frames, objects, tracks = drawn(np.random.default_rng(seed))
    present = frames * objects
    scores = sorted(
        (s for when, i, s in tracks.values() if i is not None for _ in when), reverse=True
    )
    accuracies, scaled = [], []
    for k in range(1, 41):
        r, match = k / 40, 6 * k
        if match > len(scores):
            break
        alive = {n: v for n, v in tracks.items() if v[2] >= scores[match - 1]}
        hits = sum(len(when) for when, i, _ in alive.values() if i is not None)
        false = sum(len(when) for when, i, _ in alive.values() if i is None)
        switches = sum(
            max(0, sum(i == j for _, j, _ in alive.values()) - 1) for i in range(objects)
        )
        wrong = present - hits + false + switches
        accuracies.append(1 - wrong / present)
        scaled.append(min(1.0, max(0.0, 1 - (wrong - (1 - r) * present) / (r * present))))
    result = amota(scene(frames, objects, tracks))
    n = len(accuracies)
    # The last match stands for one recall more where that is nearer to it than to nothing.
    reached = np.isfinite(result.least_scores).sum()
    assert n <= reached <= n + 1
    np.testing.assert_allclose(result.mota[:n], accuracies, atol=1e-12)
    np.testing.assert_allclose(result.smota[:n], scaled, atol=1e-12)
