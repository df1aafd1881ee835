"""What is around a box that tells whether it is right: other boxes, and answers that agree.

Every answer of the network names a box of its own. Those that name much the same one are averaged
(box voting, Gidaris and Komodakis 2015), and how a box lies beside surer ones tells whether it
shows the same object again, as learned suppression does (Hosang 2017).
"""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.camera.suppression import iou

TRAITS = (
    "heat", "overlap", "behind", "other overlap", "other ahead", "height", "width over height",
    "agreeing", "agreement",
)  # fmt: skip
"""The heat's log odds; overlap with the surer box of the family that covers it most, and how much
less sure it is times that; the same of the box of another family, which may be less sure; the
logarithms of height in pixels, of width over height, of one and the chances of all answers that
agree; and their mean overlap with it."""
VOTING_IOU = 0.65
"""Answers whose boxes overlap more are averaged."""
AGREEING_IOU = 0.5
"""Answers whose boxes overlap more agree."""


@compiled()
def looked_around(
    boxes: np.ndarray, families: np.ndarray, log_odds: np.ndarray, kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return averaged boxes, (K, 4), and their traits, (K, 9), of the rows that are kept, (K,).

    boxes: (N, 4) of all answers, pixels, inside the image. families, log_odds: (N,), the surest
    first.
    """
    count = len(kept)
    voted, traits = np.zeros((count, 4)), np.zeros((count, len(TRAITS)))
    for k in range(count):
        _vote((boxes, families, log_odds), kept[k], voted[k], traits[k])
    for k in range(count):
        _compare(voted, (families[kept], log_odds[kept]), k, traits[k])
        width, height = voted[k, 2] - voted[k, 0], voted[k, 3] - voted[k, 1]
        traits[k, 0] = log_odds[kept[k]]
        traits[k, 5], traits[k, 6] = np.log(height), np.log(width / height)
    return voted, traits


@compiled()
def _vote(
    answers: tuple[np.ndarray, np.ndarray, np.ndarray], row: int, box: np.ndarray,
    traits: np.ndarray,
) -> None:  # fmt: skip
    """Write the mean box of the answers about one, and how many agree how well."""
    boxes, families, log_odds = answers
    agreeing, agreement, votes = 0.0, 0.0, 0.0
    for other in range(len(boxes)):
        if families[other] != families[row]:
            continue
        overlap = iou(boxes[row], boxes[other])
        if overlap <= AGREEING_IOU:
            continue
        chance = 1 / (1 + np.exp(-log_odds[other]))
        agreeing += chance
        agreement += chance * overlap
        if overlap > VOTING_IOU:
            votes += chance * overlap
            for side in range(4):
                box[side] += chance * overlap * boxes[other, side]
    for side in range(4):
        box[side] /= votes
    traits[7], traits[8] = np.log1p(agreeing), agreement / agreeing


@compiled()
def _compare(
    boxes: np.ndarray, told: tuple[np.ndarray, np.ndarray], k: int, traits: np.ndarray
) -> None:
    """Write how a box lies beside a surer one of its family, and beside one of another."""
    families, log_odds = told
    for other in range(len(boxes)):
        same = families[other] == families[k]
        if other == k or (same and other > k):
            continue
        at = 1 if same else 3
        overlap = iou(boxes[k], boxes[other])
        if overlap > traits[at]:
            traits[at] = overlap
            traits[at + 1] = overlap * (log_odds[other] - log_odds[k])
