"""MOTChallenge's rules of what counts (Milan et al. 2016).

Pedestrians count. Tracks that follow what looks like one, people on vehicles, standing or sitting
people, reflections, count neither for nor against.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from roadscope.benchmarks.formats.motchallenge import PEDESTRIAN, MotRows
from roadscope.benchmarks.metrics.matching import image_overlaps
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence

DISTRACTORS = (2, 7, 8, 12)
"""Of MOT16 and MOT17: people on vehicles, static people, distractors, reflections."""
VEHICLES = 6
"""Not on the main road; MOT20 spares them, too."""
THRESHOLD = 0.5
EPSILON = float(np.finfo(float).eps)
JudgedFrame = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""(M,) and (N,) ids of objects and tracks that count, (M, N) similarities, (N,) scores."""
NOTHING: JudgedFrame = (
    np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 0)), np.empty(0),
)  # fmt: skip


def distractors_of(sequence: str) -> tuple[int, ...]:
    """Return the classes that count neither way, by the name of a sequence."""
    return (*DISTRACTORS, VEHICLES) if sequence.startswith("MOT20") else DISTRACTORS


def mot_judged(
    truth: Sequence[MotRows],
    tracked: Sequence[MotRows],
    distractors: Collection[int] = DISTRACTORS,
) -> TrackedSequence:
    """Leave out what does not count, frame by frame; similarity is the IoU of image boxes.

    truth: rows of ground truth; of those of no confidence none counts.
    tracked: a tracker's rows; those without an id or a box are left out.
    distractors: classes as in `CLASSES`, those of `distractors_of` the sequence.
    """
    frames = [
        _frame(objects, rows, distractors) if len(objects) or len(rows) else NOTHING
        for objects, rows in zip(truth, tracked, strict=True)
    ]
    ids, followers, alike, scores = ([frame[k] for frame in frames] for k in range(len(NOTHING)))
    return TrackedSequence.of(ids, followers, alike, scores=scores)


def _frame(objects: MotRows, rows: MotRows, distractors: Collection[int]) -> JudgedFrame:
    boxed = np.all(rows.boxes[:, 2:] > rows.boxes[:, :2], axis=1)
    tracks = rows.select((rows.ids >= 0) & boxed)
    overlaps = image_overlaps(objects.boxes, tracks.boxes)
    kept = ~_on(np.isin(objects.classes, list(distractors)), overlaps)
    counts = (objects.classes == PEDESTRIAN) & (objects.confidences != 0)
    return (
        objects.ids[counts], tracks.ids[kept], overlaps[np.ix_(counts, kept)],
        tracks.confidences[kept],
    )  # fmt: skip


def _on(distracting: np.ndarray, overlaps: np.ndarray) -> np.ndarray:
    """Return (N,) bool, tracks whose partner among all (M,) objects is a distractor."""
    from scipy.optimize import linear_sum_assignment

    possible = np.where(overlaps < THRESHOLD - EPSILON, 0.0, overlaps)
    row, column = linear_sum_assignment(-possible)
    real = possible[row, column] > EPSILON
    on = np.zeros(overlaps.shape[1], bool)
    on[column[real]] = distracting[row[real]]
    return on
