"""A tracked episode reduced to what tracking metrics look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.matching import Pairing, match
from roadscope.core import Tracks, Truth


@dataclass(frozen=True, slots=True, eq=False)
class TrackedFrame:
    """One frame without what does not count.

    truth_ids: (M,) int64, ids of the eligible objects.
    track_ids: (N,) int64, ids of the tracks.
    distances: (N, M) float64, metres between centres, seen from above.
    speed_errors: (N, M) float64, m/s, length of the difference of velocities.
    """

    truth_ids: np.ndarray
    track_ids: np.ndarray
    distances: np.ndarray
    speed_errors: np.ndarray


def counted_frames(
    tracks: Sequence[Tracks], truths: Sequence[Truth], pairings: Sequence[Pairing], gate_m: float
) -> list[TrackedFrame]:
    """Leave out ineligible objects, and tracks that lie on one or outside the range band.

    tracks: in the world frame, like truth; tentative tracks already left out.
    """
    frames = []
    for tracked, truth, pairing in zip(tracks, truths, pairings, strict=True):
        ignored = match(pairing, gate_m).ignored
        rows = np.setdiff1d(np.arange(len(tracked)), ignored)
        columns = np.flatnonzero(pairing.eligible)
        apart = tracked.velocities[rows, None] - truth.velocities[None, columns]
        frames.append(
            TrackedFrame(
                truth_ids=truth.ids[columns],
                track_ids=tracked.ids[rows],
                distances=pairing.distances[np.ix_(rows, columns)],
                speed_errors=np.hypot(apart[..., 0], apart[..., 1]),
            )
        )
    return frames
