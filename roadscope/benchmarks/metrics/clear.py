"""CLEAR MOT: matches carried on from frame to frame, and what breaks them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from roadscope.benchmarks.metrics.matching import assign
from roadscope.benchmarks.metrics.tracked import TrackedFrame

MOSTLY_TRACKED = 0.8
MOSTLY_LOST = 0.2


@dataclass(slots=True)
class ClearCounts:
    """What CLEAR MOT counts over an episode.

    matches, misses, false_alarms: object frames and track frames.
    id_switches: an object is followed by another track than when last matched.
    wrong_associations: a track follows another object than when last matched.
    fragmentations: an object is followed again after at least one frame in which it was not,
        be it missed or ineligible.
    mostly_tracked, mostly_lost, objects: objects followed in over 80 %, under 20 % of their
        frames, and all of them.
    distance_m, distance_squares, speed_squares: sums over matches of m, m^2 and (m/s)^2.
    """

    matches: int = 0
    misses: int = 0
    false_alarms: int = 0
    id_switches: int = 0
    wrong_associations: int = 0
    fragmentations: int = 0
    mostly_tracked: int = 0
    mostly_lost: int = 0
    objects: int = 0
    distance_m: float = 0.0
    distance_squares: float = 0.0
    speed_squares: float = 0.0


@dataclass(slots=True)
class _Life:
    """What is known of one object so far."""

    frames: int = 0
    matched: int = 0
    fragments: int = 0
    track: int | None = None


@dataclass(slots=True)
class _State:
    counts: ClearCounts = field(default_factory=ClearCounts)
    lives: dict[int, _Life] = field(default_factory=dict)
    objects_of_tracks: dict[int, int] = field(default_factory=dict)
    current: dict[int, int] = field(default_factory=dict)


def clear_counts(frames: Sequence[TrackedFrame], gate_m: float) -> ClearCounts:
    """Count over an episode (Bernardin and Stiefelhagen 2008, section 2.1).

    A match of the frame before is kept while it lies within the gate; the rest is assigned
    optimally.
    """
    state = _State()
    for frame in frames:
        rows, columns = _match(frame, state.current, gate_m)
        _count(state, frame, rows, columns)
    counts = state.counts
    for life in state.lives.values():
        share = life.matched / life.frames
        counts.mostly_tracked += share > MOSTLY_TRACKED
        counts.mostly_lost += share < MOSTLY_LOST
        counts.fragmentations += max(life.fragments - 1, 0)
    counts.objects = len(state.lives)
    return counts


def _match(
    frame: TrackedFrame, current: dict[int, int], gate_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pair tracks and objects; `current` holds the track of each object one frame ago."""
    before = np.array([current.get(int(t), -1) for t in frame.truth_ids], np.int64)
    known = np.isin(frame.truth_ids, list(current))
    carried = (frame.track_ids[:, None] == before) & known & (frame.distances <= gate_m)
    kept_rows, kept_columns = np.nonzero(carried)
    free_rows = np.setdiff1d(np.arange(len(frame.track_ids)), kept_rows)
    free_columns = np.setdiff1d(np.arange(len(frame.truth_ids)), kept_columns)
    rows, columns = assign(frame.distances[np.ix_(free_rows, free_columns)], gate_m)
    return (
        np.concatenate([kept_rows, free_rows[rows]]),
        np.concatenate([kept_columns, free_columns[columns]]),
    )


def _count(state: _State, frame: TrackedFrame, rows: np.ndarray, columns: np.ndarray) -> None:
    counts = state.counts
    counts.matches += len(rows)
    counts.misses += len(frame.truth_ids) - len(rows)
    counts.false_alarms += len(frame.track_ids) - len(rows)
    distances = frame.distances[rows, columns]
    counts.distance_m += float(distances.sum())
    counts.distance_squares += float((distances**2).sum())
    counts.speed_squares += float((frame.speed_errors[rows, columns] ** 2).sum())
    before = state.current
    pairs = zip(frame.truth_ids[columns], frame.track_ids[rows], strict=True)
    state.current = {int(truth_id): int(track_id) for truth_id, track_id in pairs}
    for truth_id in map(int, frame.truth_ids):
        life = state.lives.setdefault(truth_id, _Life())
        life.frames += 1
        track = state.current.get(truth_id)
        if track is not None:
            life.fragments += truth_id not in before
            _follow(state, life, truth_id, track)


def _follow(state: _State, life: _Life, truth_id: int, track: int) -> None:
    """Note that the track follows the object in this frame."""
    life.matched += 1
    state.counts.id_switches += life.track not in (None, track)
    state.counts.wrong_associations += state.objects_of_tracks.get(track, truth_id) != truth_id
    life.track = track
    state.objects_of_tracks[track] = truth_id
