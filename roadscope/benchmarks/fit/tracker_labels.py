"""Which detections and tracks of recorded sequences KITTI's rules hold to be right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.formats.kitti import KittiSequence
from roadscope.benchmarks.formats.kitti_export import kitti_objects
from roadscope.benchmarks.formats.kitti_objects import TYPE_OF
from roadscope.benchmarks.formats.kitti_rules import SIMILARITIES, judged
from roadscope.benchmarks.metrics.tracking.matching import match_tracks
from roadscope.core import Tracks
from roadscope.trackers import score_log_odds

MEASURE = "iou_2d"
"""The benchmark's own."""


def verdicts(tracks: Sequence[Tracks], sequence: KittiSequence) -> dict[tuple[int, int], bool]:
    """Return of each (frame, id) that counts whether it is on an object."""
    view = sequence.calibration.projection, sequence.image_size
    rows = [
        kitti_objects(tracked, t, pose, *view)
        for t, (tracked, pose) in enumerate(zip(tracks, sequence.world_from_ego, strict=True))
    ]
    counted = judged(sequence.labelled, rows, TYPE_OF[sequence.category], MEASURE)
    right = np.zeros(len(counted.tracks), bool)
    right[match_tracks(counted, SIMILARITIES[MEASURE].threshold).track_rows] = True
    frames = np.repeat(np.arange(len(counted)), counted.track_counts).tolist()
    keys = zip(frames, counted.track_ids.tolist(), strict=True)
    return dict(zip(keys, right.tolist(), strict=True))


def graded_detections(sequence: KittiSequence) -> np.ndarray:
    """Return (J, 3) log odds of the score, range in metres, 1 for right and 0 for wrong."""
    shown = [Tracks.of(found, np.arange(len(found))) for found in sequence.detections]
    known = verdicts(shown, sequence)
    rows = [np.empty((0, 3))]
    for t, found in enumerate(sequence.detections):
        counts = [i for i in range(len(found)) if (t, i) in known]
        ranges = np.hypot(found.centres[counts, 0], found.centres[counts, 1])
        right = np.array([known[t, i] for i in counts], float)
        rows.append(np.column_stack([score_log_odds(found.scores[counts]), ranges, right]))
    return np.concatenate(rows)
