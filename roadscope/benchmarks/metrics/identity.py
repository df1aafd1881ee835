"""IDF1: how much of every object's life one and the same track covers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics.score import Score, ratio
from roadscope.benchmarks.metrics.tracked import TrackedFrame


def idf1(frames: Sequence[TrackedFrame], gate_m: float) -> Score:
    """Return identity F1 (Ristani et al. 2016): one track per object over the whole episode.

    Objects and tracks are paired once so that most object frames are covered within the gate.
    """
    from scipy.optimize import linear_sum_assignment

    truth_ids, track_ids = _ids(frames)
    shared = np.zeros((len(track_ids), len(truth_ids)))
    for frame in frames:
        rows = np.searchsorted(track_ids, frame.track_ids)
        columns = np.searchsorted(truth_ids, frame.truth_ids)
        shared[np.ix_(rows, columns)] += frame.distances <= gate_m
    covered = shared[linear_sum_assignment(shared, maximize=True)].sum() if shared.size else 0.0
    objects = sum(len(f.truth_ids) for f in frames)
    tracks = sum(len(f.track_ids) for f in frames)
    return ratio(covered, (objects + tracks) / 2)


def _ids(frames: Sequence[TrackedFrame]) -> tuple[np.ndarray, np.ndarray]:
    none = np.empty(0, np.int64)
    return (
        np.unique(np.concatenate([none, *(f.truth_ids for f in frames)])),
        np.unique(np.concatenate([none, *(f.track_ids for f in frames)])),
    )
