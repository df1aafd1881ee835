"""Which target belongs to which filter."""

from __future__ import annotations

import numpy as np


def associate_nearest(
    targets: np.ndarray, predictions: np.ndarray, gate_m: float
) -> list[tuple[int, int]]:
    """Pair (N, 2) targets with (M, 2) predictions by least difference (Lu 2018, eq. 5).

    The paper lets each target in turn take its nearest filter below the threshold and bars
    filters already taken, so the result depends on the order of targets. Reading taken: the pair
    with the least difference of all goes first, which is an order the targets themselves give.
    Equal differences go to the earlier filter, then the earlier target.
    """
    differences = np.hypot(*(targets[:, None] - predictions).transpose(2, 0, 1))
    rows, columns = np.nonzero(differences < gate_m)
    order = np.lexsort((rows, columns, differences[rows, columns]))
    pairs: list[tuple[int, int]] = []
    free_rows, free_columns = np.ones(len(targets), bool), np.ones(len(predictions), bool)
    for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if free_rows[row] and free_columns[column]:
            free_rows[row] = free_columns[column] = False
            pairs.append((row, column))
    return pairs
