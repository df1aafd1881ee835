"""Scores of a tracker on a recorded sequence, also of a result file in KITTI's format."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.kitti_labels import (
    DETECTED_TYPES,
    KittiObjects,
    read_kitti_labels,
)
from roadscope.benchmarks.formats.kitti_sequence import KittiSequence
from roadscope.benchmarks.metrics.score import Score, averaged, ratio
from roadscope.benchmarks.metrics.tracking.amota import amota
from roadscope.benchmarks.metrics.tracking.clear import clear
from roadscope.benchmarks.metrics.tracking.hota import hota
from roadscope.benchmarks.metrics.tracking.identity import identity
from roadscope.benchmarks.metrics.tracking.matching import match_tracks
from roadscope.benchmarks.metrics.tracking.scores import CURVES, consistency_scores, state_scores
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.benchmarks.metrics.tracking.state_accuracy import FrameRows, state_errors
from roadscope.benchmarks.recorded.combined import NEES_BAND, SUFFIXES, alpha_parts, nees_band
from roadscope.benchmarks.recorded.rules import BOX_SIMILARITIES, apply_kitti_rules
from roadscope.core import Category, Tracks, Truth

STATE_METRICS = (
    *("position_rmse_m", "heading_rmse_deg", "heading_reversed"),
    *("nees_position", "nees_in_band", "inside_position"),
)
"""Scores of states. Labels have no velocities, only differences of centres, which are too rough."""


def score_kitti_results(
    labels: Path | str, results: Path | str, category: Category = Category.CAR
) -> dict[str, Score]:
    """Return the same scores of a KITTI sequence, by image boxes and under KITTI's rules.

    labels: `label_02/SEQ.txt`. results: 17 columns, or 18 with a score.
    category: car, pedestrian or cyclist.

    >>> from roadscope.benchmarks import score_kitti_results
    >>> scores = score_kitti_results("label_02/0000.txt", "mine/0000.txt")
    >>> scores["hota"].value
    1.0
    """
    truth, tracks = read_kitti_labels(labels), read_kitti_labels(results, results=True)
    return kitti_result_scores(truth, tracks, category, ["iou_2d"])


def kitti_result_scores(
    labels: KittiObjects, results: KittiObjects, category: Category, similarities: Sequence[str]
) -> dict[str, Score]:
    """Return the scores of a sequence by each similarity, with the suffixes of the boards.

    similarities: keys of `BOX_SIMILARITIES`.
    """
    count = 1 + max(int(rows.frames.max(initial=-1)) for rows in (labels, results))
    truth, tracks, kind = labels.by_frame(count), results.by_frame(count), DETECTED_TYPES[category]
    scores: dict[str, Score] = {}
    for name in similarities:
        counted = apply_kitti_rules(truth, tracks, kind, name)
        by_similarity = sequence_scores(counted, BOX_SIMILARITIES[name].threshold)
        scores |= {f"{metric}{SUFFIXES[name]}": score for metric, score in by_similarity.items()}
        scores |= alpha_parts(hota(counted), SUFFIXES[name])
    return scores


def kitti_scores(tracks: Sequence[Tracks], sequence: KittiSequence) -> dict[str, Score]:
    """Return the scores by image boxes, by 3-D boxes and by centres, under KITTI's rules.

    State errors are those of matched tracks and objects, by centres seen from above, gate 2 m.
    Averages over recall use tentative tracks too; the other scores do not.

    tracks: one record per frame, of the sequence's class, world frame; with tentative tracks if
        their scores mean something.
    """
    sure_tracks = [record.sure for record in tracks]
    all_rows, sure_rows = sequence.result_rows(tracks), sequence.result_rows(sure_tracks)
    labels, kind = sequence.label_rows, DETECTED_TYPES[sequence.category]
    scores: dict[str, Score] = {}
    for name, suffix in SUFFIXES.items():
        counted = apply_kitti_rules(labels, sure_rows, kind, name)
        with_tentative = apply_kitti_rules(labels, all_rows, kind, name)
        threshold = BOX_SIMILARITIES[name].threshold
        by_similarity = sequence_scores(counted, threshold, with_tentative)
        scores |= {f"{metric}{suffix}": score for metric, score in by_similarity.items()}
        scores |= alpha_parts(hota(counted), suffix)
        if name == "centre":
            scores |= label_errors(sure_tracks, sequence.truths, counted, threshold)
    return scores


def label_errors(
    tracks: Sequence[Tracks], truths: Sequence[Truth], counted: TrackedSequence, threshold: float
) -> dict[str, Score]:
    """Return errors of matched tracks against the labels, world frame, and their consistency."""
    matched = match_tracks(counted, threshold)
    track_ids = counted.track_ids[matched.track_rows]
    object_ids = counted.truth_ids[matched.truth_rows]
    ends = np.searchsorted(matched.frames, np.arange(len(counted) + 1))
    pairs = [
        FrameRows(_rows_of(track_ids[a:b], record.ids), _rows_of(object_ids[a:b], truth.ids))
        for record, truth, a, b in zip(tracks, truths, ends[:-1], ends[1:], strict=True)
    ]
    errors = state_errors(tracks, truths, pairs)
    matched_objects = len(np.unique(object_ids))
    scores = state_scores(errors) | consistency_scores(errors, matched_objects)
    objects_with_nees = matched_objects if scores["nees_position"].n else 0
    band = dict(zip(NEES_BAND, nees_band(objects_with_nees), strict=True))
    return {name: scores[name] for name in STATE_METRICS} | band


def _rows_of(chosen_ids: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Return (K,) int64, the row of each chosen id among unique ids."""
    order = np.argsort(ids)
    rows: np.ndarray = order[np.searchsorted(ids, chosen_ids, sorter=order)]
    return rows


def sequence_scores(
    sequence: TrackedSequence, threshold: float, with_tentative: TrackedSequence | None = None
) -> dict[str, Score]:
    """Return HOTA, CLEAR MOT, identity and averages over recall of one sequence.

    threshold: similarity from which on a track can follow an object.
    with_tentative: the same sequence with tentative tracks, for averages over recall; None if
        there are none.
    """
    with_tentative = sequence if with_tentative is None else with_tentative
    curves, objects = hota(sequence), len(sequence.truths)
    events, ids = clear(sequence, threshold), identity(sequence, threshold)
    samota = amota(with_tentative, threshold=threshold).samota if objects else math.nan

    def number(value: int) -> Score:
        return Score(float(value), "1/sequence", "lower", events.matches)

    errors = events.misses + events.false_alarms + events.id_switches
    return {
        **{n: averaged(float(getattr(curves, n).mean()), objects) for n in ("hota", *CURVES)},
        "mota": averaged(1 - errors / max(objects, 1), objects, -math.inf),
        "errors": Score(float(errors), "1/sequence", "lower", len(sequence)),
        "false_alarms": Score(float(events.false_alarms), "1/sequence", "lower", len(sequence)),
        "motp": Score(events.motp, "1", "higher", events.matches, 0.0, 1.0, weight=events.matches),
        "idf1": ratio(ids.hits, (ids.present + ids.tracked) / 2),
        "samota": averaged(samota, objects),
        "id_switches": number(events.id_switches),
        "wrong_associations": number(events.wrong_associations),
        "fragmentations": number(events.fragmentations),
        "mostly_tracked": ratio(events.mostly_tracked, events.objects),
        "partially_tracked": ratio(events.partially_tracked, events.objects),
        "mostly_lost": ratio(events.mostly_lost, events.objects, "lower"),
        "recall": ratio(events.matches, events.present),
        "precision": ratio(events.matches, events.matches + events.false_alarms),
    }
