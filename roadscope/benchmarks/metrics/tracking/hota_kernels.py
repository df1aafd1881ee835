"""What HOTA does with every pair, compiled.

starts: where the objects, tracks and pairs of each frame begin; places: the numbers of objects
and tracks.
"""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

EPSILON = float(np.finfo(float).eps)

Two = tuple[np.ndarray, np.ndarray]
Three = tuple[np.ndarray, np.ndarray, np.ndarray]


@compiled()
def add_potential(
    starts: Three, places: Two, sums: Two, similarities: np.ndarray, potential: np.ndarray
) -> None:
    """Add to (objects, tracks) the share of each pair in what either has in common with any.

    sums: (P,) and (Q,) similarities of each object to all tracks, of each track to all objects.
    """
    for t in range(len(starts[0]) - 1):
        pair = starts[2][t]
        for i in range(starts[0][t], starts[0][t + 1]):
            for j in range(starts[1][t], starts[1][t + 1]):
                if similarities[pair] > 0:
                    either = sums[1][j] + sums[0][i] - similarities[pair]
                    if either > EPSILON:
                        potential[places[0][i], places[1][j]] += similarities[pair] / either
                pair += 1


@compiled()
def weigh(
    starts: Three,
    places: Two,
    alignment: np.ndarray,
    similarities: np.ndarray,
    costs: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (R,) bool, pairs that are surely the best, and (T,) bool, frames without doubt.

    In a frame in which no object and no track has two pairs worth anything, all that are worth
    something are best. In other frames an assignment has to be sought: their (R,) costs are
    written.
    """
    best, sure = np.zeros(len(costs), np.bool_), np.ones(len(starts[0]) - 1, np.bool_)
    taken = np.zeros(len(places[1]), np.bool_)
    for t in range(len(sure)):
        first = starts[1][t]
        columns = starts[1][t + 1] - first
        for i in range(starts[0][t], starts[0][t + 1]):
            offset, worthy = starts[2][t] + (i - starts[0][t]) * columns, 0
            for j in range(columns):
                if similarities[offset + j] > 0:
                    best[offset + j] = True
                    worthy += 1
                    sure[t] = sure[t] and worthy < 2 and not taken[first + j]
                    taken[first + j] = True
        if sure[t]:
            continue
        best[starts[2][t] : starts[2][t + 1]] = False
        for i in range(starts[0][t], starts[0][t + 1]):
            offset = starts[2][t] + (i - starts[0][t]) * columns
            for j in range(columns):
                aligned = alignment[places[0][i], places[1][first + j]]
                costs[offset + j] = -(aligned * similarities[offset + j])
    return best, sure
