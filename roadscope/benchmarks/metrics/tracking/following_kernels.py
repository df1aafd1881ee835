"""Who follows whom, frame after frame, compiled.

starts: where the objects, tracks and pairs of each frame begin; places: the numbers of objects
and tracks.
"""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

CONTINUED = 1000.0
"""Outweighs all similarities of a frame, so that what was matched stays so."""
NOBODY = -1

Two = tuple[np.ndarray, np.ndarray]
Three = tuple[np.ndarray, np.ndarray, np.ndarray]
Close = tuple[np.ndarray, np.ndarray, float]
Five = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@compiled()
def follow_on(frame: int, starts: Three, places: Two, close: Close, memory: Five) -> int:
    """Match frame after frame; return the first in which an assignment has to be sought, or T.

    close: similarities of all pairs; (Q,) bool, tracks that count; the least similarity.
    memory: (objects,) the track of each in the frame before; (tracks,) room for columns, -1;
        (T,) bool, frames with objects and tracks that count; (P,) pair of each matched object,
        written, otherwise -1; the costs of the assignment that has to be sought, written, row by
        row, of tracks that count.
    """
    previous, _, counted, match, costs = memory
    if frame > 0 and counted[frame - 1]:
        _remember(frame - 1, starts, places, previous, match)
    for t in range(frame, len(counted)):
        if counted[t]:
            if not _match_frame(t, starts, places, close, memory):
                _write_costs(t, starts, places, close, (previous, costs))
                return t
            _remember(t, starts, places, previous, match)
    return len(counted)


@compiled()
def _match_frame(t: int, starts: Three, places: Two, close: Close, memory: Five) -> bool:
    """Match what is without doubt; return whether that is all.

    Pairs of the frame before stay. Of the rest there is no doubt while no object and no track
    has two pairs that could be matched.
    """
    similarities, there, least = close
    previous, column_of, _, match, _ = memory
    first, columns = starts[1][t], starts[1][t + 1] - starts[1][t]
    taken = np.zeros(columns, np.bool_)
    for j in range(columns):
        taken[j] = not there[first + j]
        column_of[places[1][first + j]] = NOBODY if taken[j] else j
    for i in range(starts[0][t], starts[0][t + 1]):
        match[i] = NOBODY
        offset = starts[2][t] + (i - starts[0][t]) * columns
        before = previous[places[0][i]]
        j = column_of[before] if before != NOBODY else NOBODY
        if j != NOBODY and similarities[offset + j] >= least:
            match[i] = offset + j
            taken[j] = True
    for j in range(columns):
        column_of[places[1][first + j]] = NOBODY
    kept = taken.copy()
    for i in range(starts[0][t], starts[0][t + 1]):
        offset = starts[2][t] + (i - starts[0][t]) * columns
        if match[i] != NOBODY:
            continue
        for j in range(columns):
            if similarities[offset + j] >= least and not kept[j]:
                if match[i] != NOBODY or taken[j]:
                    return False
                match[i] = offset + j
                taken[j] = True
    return True


@compiled()
def _remember(t: int, starts: Three, places: Two, previous: np.ndarray, match: np.ndarray) -> None:
    columns = max(starts[1][t + 1] - starts[1][t], 1)
    previous[:] = NOBODY
    for i in range(starts[0][t], starts[0][t + 1]):
        if match[i] != NOBODY:
            column = (match[i] - starts[2][t]) % columns
            previous[places[0][i]] = places[1][starts[1][t] + column]


@compiled()
def _write_costs(t: int, starts: Three, places: Two, close: Close, memory: Two) -> None:
    similarities, there, least = close
    previous, costs = memory
    n, pair = 0, starts[2][t]
    for i in range(starts[0][t], starts[0][t + 1]):
        before = previous[places[0][i]]
        for j in range(starts[1][t], starts[1][t + 1]):
            if there[j]:
                bonus = CONTINUED if places[1][j] == before else 0.0
                far = similarities[pair] < least
                costs[n] = 0.0 if far else -(bonus + similarities[pair])
                n += 1
            pair += 1


@compiled()
def count_covered(
    starts: Three, places: Two, similarities: np.ndarray, threshold: float, together: np.ndarray
) -> None:
    """Add to (objects, tracks) the number of frames in which they reach the threshold."""
    for t in range(len(starts[0]) - 1):
        pair = starts[2][t]
        for i in range(starts[0][t], starts[0][t + 1]):
            for j in range(starts[1][t], starts[1][t + 1]):
                together[places[0][i], places[1][j]] += similarities[pair] >= threshold
                pair += 1
