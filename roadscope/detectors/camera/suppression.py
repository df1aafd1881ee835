"""Of boxes that show much the same, the surest."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled


@compiled()
def distinct(boxes: np.ndarray, families: np.ndarray, most_iou: float) -> np.ndarray:
    """Return (K,) rows, of boxes sorted by falling score, that no better one of the family covers.

    boxes: (N, 4) float64. families: (N,) int64. Greedy non-maximum suppression.
    """
    kept = np.empty(len(boxes), np.int64)
    count = 0
    for i in range(len(boxes)):
        free = True
        for other in kept[:count]:
            if families[other] == families[i] and iou(boxes[other], boxes[i]) > most_iou:
                free = False
                break
        if free:
            kept[count] = i
            count += 1
    return kept[:count].copy()


@compiled(borrowing=True)
def iou(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of two boxes, (4,) each, 0 where both are empty."""
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    if width <= 0 or height <= 0:
        return 0.0
    common = width * height
    areas = (one[2] - one[0]) * (one[3] - one[1]) + (other[2] - other[0]) * (other[3] - other[1])
    return float(common / (areas - common))
