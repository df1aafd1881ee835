"""Who follows whom, frame after frame, compiled."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

KEPT = 2


@compiled()
def follow_on(
    frame: int,
    starts: np.ndarray,
    places: tuple[np.ndarray, np.ndarray],
    memory: tuple[np.ndarray, np.ndarray, np.ndarray],
    matched: np.ndarray,
) -> int:
    """Match frame after frame; return the first in which an assignment has to be sought, or T.

    starts: (T + 1,) where the candidates of each frame begin.
    places: numbers of object and track of each candidate.
    memory: of each object the track that it had in the frame before, otherwise -1; twice room
        for counts, 0 for each object and each track; (T,) bool, frames with objects and tracks.
    matched: (candidates,) bool, written.
    """
    objects, tracks = places
    previous, uses, counted = memory
    shift = len(previous)
    for t in range(frame, len(starts) - 1):
        if not counted[t]:
            continue
        first, last = starts[t], starts[t + 1]
        for p in range(first, last):
            matched[p] = previous[objects[p]] == tracks[p]
            if matched[p]:
                uses[objects[p]] = uses[shift + tracks[p]] = KEPT
        doubtful = False
        for p in range(first, last):
            g, k = objects[p], shift + tracks[p]
            if not matched[p] and uses[g] != KEPT and uses[k] != KEPT:
                doubtful = doubtful or uses[g] > 0 or uses[k] > 0
                uses[g] = uses[k] = 1
                matched[p] = True
        for p in range(first, last):
            uses[objects[p]] = uses[shift + tracks[p]] = 0
        if doubtful:
            return t
        previous[:] = -1
        for p in range(first, last):
            if matched[p]:
                previous[objects[p]] = tracks[p]
    return len(starts) - 1
