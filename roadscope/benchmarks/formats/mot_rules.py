"""MOTChallenge's rules of what counts (Milan et al. 2016).

Pedestrians count. Tracks that follow what looks like one, people on vehicles, standing or sitting
people, reflections, count neither for nor against.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from roadscope.benchmarks.formats.motchallenge import PEDESTRIAN, MotRows
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.benchmarks.metrics.tracking.similarity import image_overlaps

DISTRACTORS = (2, 7, 8, 12)
"""Of MOT16 and MOT17: people on vehicles, static people, distractors, reflections."""
THRESHOLD = 0.5
EPSILON = float(np.finfo(float).eps)


def mot_judged(
    truth: Sequence[MotRows],
    tracked: Sequence[MotRows],
    distractors: Collection[int] = DISTRACTORS,
) -> TrackedSequence:
    """Leave out what does not count, frame by frame; similarity is the IoU of image boxes.

    truth: rows of ground truth; of those of no confidence none counts.
    tracked: a tracker's rows; those without an id or a box are left out.
    distractors: classes as in `CLASSES`; MOT20 has 6, other vehicles, beside these.
    """
    ids, followers, alike, scores = [], [], [], []
    for objects, rows in zip(truth, tracked, strict=True):
        boxed = np.all(rows.boxes[:, 2:] > rows.boxes[:, :2], axis=1)
        tracks = rows.select((rows.ids >= 0) & boxed)
        overlaps = image_overlaps(objects.boxes, tracks.boxes)
        excused = _on(np.isin(objects.classes, list(distractors)), overlaps)
        counts = (objects.classes == PEDESTRIAN) & (objects.confidences != 0)
        ids.append(objects.ids[counts])
        followers.append(tracks.ids[~excused])
        alike.append(overlaps[np.ix_(counts, ~excused)])
        scores.append(tracks.confidences[~excused])
    return TrackedSequence.of(ids, followers, alike, scores=scores)


def _on(distracting: np.ndarray, overlaps: np.ndarray) -> np.ndarray:
    """Return (N,) bool, tracks whose partner among all (M,) objects is a distractor."""
    from scipy.optimize import linear_sum_assignment

    possible = np.where(overlaps < THRESHOLD - EPSILON, 0.0, overlaps)
    row, column = linear_sum_assignment(-possible)
    real = possible[row, column] > EPSILON
    on = np.zeros(overlaps.shape[1], bool)
    on[column[real]] = distracting[row[real]]
    return on
