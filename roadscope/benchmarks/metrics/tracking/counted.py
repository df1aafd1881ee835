"""Which tracks and objects of an episode count."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.metrics.matching import Pairing, match
from roadscope.benchmarks.metrics.tracking.following import Following
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.benchmarks.metrics.tracking.similarity import Similarity
from roadscope.core import Tracks, Truth

Rows = tuple[np.ndarray, np.ndarray]
"""Rows of tracks and of objects of a frame."""


def counted_rows(pairings: Sequence[Pairing], gate_m: float) -> list[Rows]:
    """Leave out ineligible objects, and tracks that lie on one or outside the range band."""
    rows = []
    for pairing in pairings:
        ignored = match(pairing, gate_m).ignored
        tracks = np.setdiff1d(np.arange(len(pairing.distances)), ignored)
        rows.append((tracks, np.flatnonzero(pairing.eligible)))
    return rows


def counted_sequence(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    distances_m: Sequence[np.ndarray],
    counted: Sequence[Rows],
    similarity: Similarity | None = None,
) -> TrackedSequence:
    """Compare the rows that count.

    tracks: in the world frame, like truth; tentative ones already left out.
    distances_m: of each frame (tracks, objects), metres, all of them.
    similarity: None: by these distances, 0.5 at `GATE_M`.
    """
    frames = list(zip(tracks, truths, counted, strict=True))
    apart = [
        distances[np.ix_(rows, columns)].T
        for distances, (rows, columns) in zip(distances_m, counted, strict=True)
    ]
    alike = None
    if similarity is not None:
        alike = [similarity(g, t)[np.ix_(columns, rows)] for t, g, (rows, columns) in frames]
    return TrackedSequence.of(
        [truth.ids[columns] for _, truth, (_, columns) in frames],
        [tracked.ids[rows] for tracked, _, (rows, _) in frames],
        alike,
        distances_m=apart,
        scores=[tracked.scores[rows] for tracked, _, (rows, _) in frames],
    )


def matched_rows(
    sequence: TrackedSequence, following: Following, counted: Sequence[Rows]
) -> list[Rows]:
    """Return the rows of tracks and objects, as counted, that follow one another."""
    column = following.columns - sequence.track_starts[following.frames]
    row = following.rows - sequence.truth_starts[following.frames]
    ends = np.searchsorted(following.frames, np.arange(len(sequence) + 1))
    return [
        (tracks[column[a:b]], objects[row[a:b]])
        for (tracks, objects), a, b in zip(counted, ends[:-1], ends[1:], strict=True)
    ]
