"""Scores of a tracker on a recorded sequence, under KITTI's rules."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from roadscope.benchmarks.formats.kitti import KittiSequence
from roadscope.benchmarks.formats.kitti_export import kitti_objects
from roadscope.benchmarks.formats.kitti_objects import TYPE_OF, KittiObjects
from roadscope.benchmarks.formats.kitti_rules import SIMILARITIES, judged
from roadscope.benchmarks.metrics.score import Score, ratio
from roadscope.benchmarks.metrics.tracking.amota import amota
from roadscope.benchmarks.metrics.tracking.clear import clear
from roadscope.benchmarks.metrics.tracking.hota import hota
from roadscope.benchmarks.metrics.tracking.identity import identity
from roadscope.benchmarks.metrics.tracking.matching import match_tracks
from roadscope.benchmarks.metrics.tracking.scores import consistency_scores, state_scores
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.benchmarks.metrics.tracking.state_errors import FrameRows, state_errors
from roadscope.benchmarks.recorded.combined import NEES_BAND, SUFFIXES, alpha_parts, nees_band
from roadscope.core import Tracks, Truth

STATES = (
    *("position_rmse_m", "heading_rmse_deg", "heading_reversed"),
    *("nees_position", "nees_in_band", "inside_position"),
)
"""Scores of states; labels say nothing of velocities, whose differences are as rough as they."""


def kitti_scores(tracks: Sequence[Tracks], sequence: KittiSequence) -> dict[str, Score]:
    """Return scores by image boxes, by 3-D boxes and by centres, each over KITTI's rules.

    Errors of states are those of tracks and objects that follow one another by centres, seen from
    above, gate 2 m. Averages over recall take tentative tracks, too, the others do not.

    tracks: one record a frame, of the sequence's class, world frame; tentative ones where their
        scores mean something.
    """
    every = _image_rows(tracks, sequence)
    tracks = [tracked.sure for tracked in tracks]
    rows = _image_rows(tracks, sequence)
    kind, scores = TYPE_OF[sequence.category], dict[str, Score]()
    for name, suffix in SUFFIXES.items():
        counted = judged(sequence.labelled, rows, kind, name)
        swept = judged(sequence.labelled, every, kind, name)
        threshold = SIMILARITIES[name].threshold
        named = sequence_scores(counted, threshold, swept)
        scores |= {f"{metric}{suffix}": score for metric, score in named.items()}
        scores |= alpha_parts(hota(counted), suffix)
        if name == "centre":
            scores |= label_errors(tracks, sequence.truths, counted, threshold)
    return scores


def _image_rows(tracks: Sequence[Tracks], sequence: KittiSequence) -> list[KittiObjects]:
    view = sequence.calibration.projection, sequence.image_size
    return [
        kitti_objects(tracked, t, pose, *view)
        for t, (tracked, pose) in enumerate(zip(tracks, sequence.world_from_ego, strict=True))
    ]


def label_errors(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    counted: TrackedSequence,
    threshold: float,
) -> dict[str, Score]:
    """Return how far tracks are off the labels, in the world frame, and whether they know it."""
    matched = match_tracks(counted, threshold)
    track_ids = counted.track_ids[matched.track_rows]
    objects = counted.truth_ids[matched.truth_rows]
    ends = np.searchsorted(matched.frames, np.arange(len(counted) + 1))
    pairs = [
        FrameRows(_rows_of(track_ids[a:b], frame.ids), _rows_of(objects[a:b], truth.ids))
        for frame, truth, a, b in zip(tracks, truths, ends[:-1], ends[1:], strict=True)
    ]
    errors = state_errors(tracks, truths, pairs)
    followed = len(np.unique(objects))
    every = state_scores(errors) | consistency_scores(errors, followed)
    known = followed if every["nees_position"].n else 0
    band = dict(zip(NEES_BAND, nees_band(known), strict=True))
    return {name: every[name] for name in STATES} | band


def _rows_of(wanted: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Return (K,) int64, where each wanted id is among unique ids."""
    order = np.argsort(ids)
    rows: np.ndarray = order[np.searchsorted(ids, wanted, sorter=order)]
    return rows


def sequence_scores(
    sequence: TrackedSequence, threshold: float, swept: TrackedSequence | None = None
) -> dict[str, Score]:
    """Return HOTA, CLEAR MOT, identity and averages over recall of one sequence.

    swept: the same with tentative tracks, for averages over recall; None: there are none.
    """
    swept = sequence if swept is None else swept
    curves, objects = hota(sequence), len(sequence.truths)
    c, same = clear(sequence, threshold), identity(sequence, threshold)

    def averaged(value: float, least: float = 0.0) -> Score:
        known = value if objects else math.nan
        return Score(known, "1", "higher", objects, least, 1.0, weight=objects)

    def events(value: int) -> Score:
        return Score(float(value), "1/sequence", "lower", c.matches)

    wrong = c.misses + c.false_alarms + c.id_switches
    return {
        **{n: averaged(float(getattr(curves, n).mean())) for n in ("hota", "det_a", "ass_a")},
        "loc_a": averaged(float(curves.loc_a.mean())),
        "mota": averaged(1 - wrong / max(objects, 1), -math.inf),
        "errors": Score(float(wrong), "1/sequence", "lower", len(sequence)),
        "false_alarms": Score(float(c.false_alarms), "1/sequence", "lower", len(sequence)),
        "motp": Score(c.motp, "1", "higher", c.matches, 0.0, 1.0, weight=c.matches),
        "idf1": ratio(same.hits, (same.present + same.tracked) / 2),
        "samota": averaged(amota(swept, threshold=threshold).samota if objects else math.nan),
        "id_switches": events(c.id_switches),
        "wrong_associations": events(c.wrong_associations),
        "fragmentations": events(c.fragmentations),
        "mostly_tracked": ratio(c.mostly_tracked, c.objects),
        "partially_tracked": ratio(c.partially_tracked, c.objects),
        "mostly_lost": ratio(c.mostly_lost, c.objects, "lower"),
        "recall": ratio(c.matches, c.present),
        "precision": ratio(c.matches, c.matches + c.false_alarms),
    }
