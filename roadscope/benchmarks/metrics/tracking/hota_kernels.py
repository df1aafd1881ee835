"""What HOTA does with every pair, compiled.

starts: where the objects, tracks and pairs of each frame begin; places: the numbers of objects
and tracks.
"""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

NOBODY = -1
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
def assign_on(frame: int, starts: Three, places: Two, worth: Two, found: Two) -> int:
    """Assign frame after frame; return the first in which it has to be sought, or T.

    worth: alignment of (objects, tracks), and the similarities of all pairs.
    found: (P,) the pair of each assigned object, written, otherwise -1; the costs of the
        assignment that has to be sought, written.
    """
    for t in range(frame, len(starts[0]) - 1):
        if not _assign_frame(t, starts, worth[1], found[0]):
            _write_costs(t, starts, places, worth, found[1])
            return t
    return len(starts[0]) - 1


@compiled()
def _assign_frame(t: int, starts: Three, similarities: np.ndarray, match: np.ndarray) -> bool:
    """Take all pairs that have anything in common; return whether no two have one in common."""
    first, columns = starts[0][t], starts[1][t + 1] - starts[1][t]
    taken = np.zeros(columns, np.bool_)
    for i in range(first, starts[0][t + 1]):
        offset = starts[2][t] + (i - first) * columns
        for j in range(columns):
            if similarities[offset + j] > 0:
                if taken[j] or match[i] != NOBODY:
                    return False
                match[i] = offset + j
                taken[j] = True
    return True


@compiled()
def _write_costs(t: int, starts: Three, places: Two, worth: Two, costs: np.ndarray) -> None:
    alignment, similarities = worth
    n, first = 0, starts[2][t]
    for i in range(starts[0][t], starts[0][t + 1]):
        aligned = alignment[places[0][i]]
        for j in range(starts[1][t], starts[1][t + 1]):
            costs[n] = -(aligned[places[1][j]] * similarities[first + n])
            n += 1
