"""Scores of a tracker on an episode, of all objects and at each threshold of similarity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.metrics.breakdown import part_name
from roadscope.benchmarks.metrics.matching import Pairing, match, other_rows
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, averaged, mean, ratio, rms
from roadscope.benchmarks.metrics.tracking.amota import amota, amota_nuscenes
from roadscope.benchmarks.metrics.tracking.clear import count_matches
from roadscope.benchmarks.metrics.tracking.hota import ALPHAS, hota
from roadscope.benchmarks.metrics.tracking.identity import identity
from roadscope.benchmarks.metrics.tracking.matching import TrackPairs, match_tracks
from roadscope.benchmarks.metrics.tracking.ospa import gospa, ospa
from roadscope.benchmarks.metrics.tracking.sequence import (
    GATE_M,
    Similarity,
    TrackedSequence,
    similarity_named,
)
from roadscope.benchmarks.metrics.tracking.state_accuracy import (
    FrameRows,
    StateErrors,
    nees,
    state_errors,
)
from roadscope.core import Tracks, Truth
from roadscope.core.record import Record

THRESHOLD = 0.5
"""Similarity from which on an object and a track can match."""


@dataclass(frozen=True, slots=True)
class TrackingScores(ScoreFamily):
    """Scores of a tracker on one episode; nan where there is nothing to divide by.

    hota, det_a, ass_a, loc_a, det_re, det_pr, ass_re, ass_pr: means over alphas of the curves of
        `Hota` (Luiten et al. 2021), 0 to 1.
    mota, motp: as `Clear` has them (Bernardin and Stiefelhagen 2008); motp_m: mean distance of
        matched pairs, metres.
    idf1, idp, idr: as `Identity` has them (Ristani et al. 2016), 0 to 1.
    id_switches, wrong_associations, fragmentations: per episode, as `Clear` has them.
    mostly_tracked, partially_tracked, mostly_lost: share of objects that are matched in over 80 %
        of their frames, in between, in under 20 %.
    recall, precision: matches over object frames and over track frames, 0 to 1.
    samota, amota, amotp: averages over recall of AB3DMOT, as `Amota` has them (Weng et al. 2020).
    amota_nuscenes, amotp_nuscenes_m: of nuScenes, as `NuscenesAmota` has them (Caesar et al.
        2020), by centres, whatever the similarity.
    ospa_m, gospa_m: `ospa` and `gospa` of order 1 with the gate as cut-off, mean over frames,
        metres (Schuhmacher et al. 2008; Rahmathullah et al. 2017).
    kept_through_occlusion: share of the gaps of `Recovery` after which an object has the same
        track as before.
    reassociation_frames: mean frames from an object's return until any track is matched with it.
    position_rmse_m, velocity_rmse_m_s, heading_rmse_deg: root mean square errors of matched tracks;
        headings of objects that stand (below 1 m/s) modulo half a turn, see `StateErrors`.
    heading_reversed: share of matches with a moving object whose heading is off by more than a
        right angle.
    nees_position, nees_state: mean `Nees` over its degrees of freedom, of position, and of
        position and velocity: 1 if consistent, more if covariances are too small.
    nees_in_band: 1 if the mean NEES of position lies in its 95 % band, with one independent value
        an object; else 0.
    inside_position, inside_state: share of matches whose object lies within the track's 95 %
        ellipse: 0.95 if consistent.
    """

    hota: Score
    det_a: Score
    ass_a: Score
    loc_a: Score
    det_re: Score
    det_pr: Score
    ass_re: Score
    ass_pr: Score
    mota: Score
    motp: Score
    motp_m: Score
    idf1: Score
    idp: Score
    idr: Score
    id_switches: Score
    wrong_associations: Score
    fragmentations: Score
    mostly_tracked: Score
    partially_tracked: Score
    mostly_lost: Score
    recall: Score
    precision: Score
    samota: Score
    amota: Score
    amotp: Score
    amota_nuscenes: Score
    amotp_nuscenes_m: Score
    ospa_m: Score
    gospa_m: Score
    kept_through_occlusion: Score
    reassociation_frames: Score
    position_rmse_m: Score
    velocity_rmse_m_s: Score
    heading_rmse_deg: Score
    heading_reversed: Score
    nees_position: Score
    nees_state: Score
    nees_in_band: Score
    inside_position: Score
    inside_state: Score


def score_tracks(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    *,
    similarity: Similarity | str = "centre",
    threshold: float = THRESHOLD,
) -> TrackingScores:
    """Return the scores of an episode.

    An object that is not eligible for some frames (hidden, say) keeps its identity over the gap.

    tracks, truths: of each frame, in the world frame; tentative tracks already left out.
    pairings: of each frame, of its tracks and objects.
    similarity: a name of `SIMILARITIES` or such a function.
    threshold: similarity from which on a pair can match.
    """
    counted = counted_rows(pairings)
    sequence = counted_sequence(tracks, truths, pairings, counted, similarity=similarity)
    return _scores(tracks, truths, counted, sequence, threshold)


def _scores(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    counted: Sequence[FrameRows],
    sequence: TrackedSequence,
    threshold: float,
) -> TrackingScores:
    matched = match_tracks(sequence, threshold)
    errors = state_errors(tracks, truths, matched_rows(sequence, matched, counted))
    return TrackingScores(
        **_hota_scores(sequence),
        **_clear_scores(sequence, matched),
        **_identity_scores(sequence, threshold),
        **_amota_scores(sequence, threshold),
        **_ospa_scores(sequence),
        **_recovery_scores(sequence, matched),
        **state_scores(errors),
        **consistency_scores(errors, len(np.unique(matched.objects))),
    )


# --------------------------------------------------------------------------------------------------
# What counts.


def counted_rows(pairings: Sequence[Pairing]) -> list[FrameRows]:
    """Return the rows of each frame that count.

    Objects count if they are eligible. Tracks do not count if they are matched with an ineligible
    object or lie outside the range band.
    """
    return [
        FrameRows(
            tracks=other_rows(len(p.distances), match(p, GATE_M).ignored),
            objects=np.flatnonzero(p.eligible),
        )
        for p in pairings
    ]


def counted_sequence(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    counted: Sequence[FrameRows],
    *,
    similarity: Similarity | str = "centre",
) -> TrackedSequence:
    """Return the sequence of the tracks and objects that count."""
    frames = list(zip(tracks, truths, counted, strict=True))
    distances_m = [
        pairing.distances[np.ix_(rows.tracks, rows.objects)].T
        for pairing, rows in zip(pairings, counted, strict=True)
    ]
    similarities = None
    if similarity != "centre":
        similarity_of = similarity_named(similarity)
        similarities = [
            similarity_of(truth, tracked)[np.ix_(rows.objects, rows.tracks)]
            for tracked, truth, rows in frames
        ]
    return TrackedSequence.of(
        [truth.ids[rows.objects] for _, truth, rows in frames],
        [tracked.ids[rows.tracks] for tracked, _, rows in frames],
        similarities,
        distances_m=distances_m,
        scores=[tracked.scores[rows.tracks] for tracked, _, rows in frames],
    )


def matched_rows(
    sequence: TrackedSequence, matched: TrackPairs, counted: Sequence[FrameRows]
) -> list[FrameRows]:
    """Return the matched pairs of each frame as rows of its tracks and objects."""
    columns = matched.track_rows - sequence.track_starts[matched.frames]
    rows = matched.truth_rows - sequence.truth_starts[matched.frames]
    ends = np.searchsorted(matched.frames, np.arange(len(sequence) + 1))
    return [
        FrameRows(frame.tracks[columns[a:b]], frame.objects[rows[a:b]])
        for frame, a, b in zip(counted, ends[:-1], ends[1:], strict=True)
    ]


# --------------------------------------------------------------------------------------------------
# Families of scores.


def _hota_scores(sequence: TrackedSequence) -> dict[str, Score]:
    curves, objects = hota(sequence), len(sequence.truths)
    names = ("hota", "det_a", "ass_a", "loc_a", "det_re", "det_pr", "ass_re", "ass_pr")
    return {name: averaged(float(getattr(curves, name).mean()), objects) for name in names}


def _clear_scores(sequence: TrackedSequence, matched: TrackPairs) -> dict[str, Score]:
    counts = count_matches(sequence, matched)
    distance_m = float(sequence.distances("MOTP in metres")[matched.pairs].sum())

    def events(number: int) -> Score:
        return Score(float(number), "1/episode", "lower", counts.matches)

    return {
        "mota": averaged(counts.mota, counts.present, -math.inf),
        "motp": ratio(counts.closeness, counts.matches),
        "motp_m": mean(distance_m, counts.matches, "m"),
        "id_switches": events(counts.id_switches),
        "wrong_associations": events(counts.wrong_associations),
        "fragmentations": events(counts.fragmentations),
        "mostly_tracked": ratio(counts.mostly_tracked, counts.objects),
        "partially_tracked": ratio(counts.partially_tracked, counts.objects),
        "mostly_lost": ratio(counts.mostly_lost, counts.objects, "lower"),
        "recall": ratio(counts.matches, counts.present),
        "precision": ratio(counts.matches, counts.matches + counts.false_alarms),
    }


def _identity_scores(sequence: TrackedSequence, threshold: float) -> dict[str, Score]:
    counts = identity(sequence, threshold)
    return {
        "idf1": ratio(counts.hits, (counts.present + counts.tracked) / 2),
        "idp": ratio(counts.hits, counts.tracked),
        "idr": ratio(counts.hits, counts.present),
    }


def _amota_scores(sequence: TrackedSequence, threshold: float) -> dict[str, Score]:
    averages, objects = amota(sequence, threshold=threshold), len(sequence.truths)
    nuscenes = amota_nuscenes(sequence)
    amotp_m = nuscenes.amotp_m if objects else math.nan
    return {
        "samota": averaged(averages.samota, objects),
        "amota": averaged(averages.amota, objects, -math.inf),
        "amotp": averaged(averages.amotp, objects),
        "amota_nuscenes": averaged(nuscenes.amota, objects),
        "amotp_nuscenes_m": Score(amotp_m, "m", "lower", objects, 0.0, GATE_M, weight=objects),
    }


def _ospa_scores(sequence: TrackedSequence) -> dict[str, Score]:
    frames = len(sequence)
    return {
        "ospa_m": mean(float(ospa(sequence, GATE_M).distances.sum()), frames, "m"),
        "gospa_m": mean(float(gospa(sequence, GATE_M).distances.sum()), frames, "m"),
    }


def _recovery_scores(sequence: TrackedSequence, matched: TrackPairs) -> dict[str, Score]:
    gaps = recovery(sequence, matched)
    delays = gaps.delays[gaps.reassociated]
    return {
        "kept_through_occlusion": ratio(float(gaps.same_track.sum()), len(gaps)),
        "reassociation_frames": mean(float(delays.sum()), len(delays), "frames"),
    }


def state_scores(errors: StateErrors) -> dict[str, Score]:
    """Return errors of position, velocity and heading of matched tracks."""
    n, moving = len(errors), int(errors.moving.sum())
    squares = float((np.degrees(errors.headings) ** 2).sum())
    return {
        "position_rmse_m": rms(float((errors.positions**2).sum()), n, "m"),
        "velocity_rmse_m_s": rms(float((errors.velocities**2).sum()), n, "m/s"),
        "heading_rmse_deg": rms(squares, n, "deg"),
        "heading_reversed": ratio(float(errors.reversed.sum()), moving, "lower"),
    }


def consistency_scores(errors: StateErrors, objects: int) -> dict[str, Score]:
    """Return NEES, and how often objects lie within the tracks' 95 % ellipses.

    objects: number of different objects among the matched pairs.
    """
    scores: dict[str, Score] = {}
    for name, velocity in (("position", False), ("state", True)):
        values = nees(errors, velocity=velocity)
        total = float(values.values.sum()) / values.freedom
        scores[f"nees_{name}"] = mean(total, len(values), "1")
        scores[f"inside_{name}"] = ratio(values.inside * len(values), len(values))
        if not velocity:
            in_band = float(values.in_band(objects)) if len(values) else math.nan
            scores["nees_in_band"] = Score(in_band, "1", "higher", len(values), 0.0, 1.0)
    return scores


# --------------------------------------------------------------------------------------------------
# Recovery after occlusion: whether an object keeps its track while it is hidden.

NEVER = -1
NO_TRACK = -1


@dataclass(frozen=True, slots=True, eq=False)
class Recovery(Record):
    """What followed on G gaps: times in which an object that had a track was hidden.

    hidden_frames: (G,) int64, length of the gap.
    same_track: (G,) bool, the first track that is matched with the object again is the last one
        from before the gap.
    delays: (G,) int64, frames from the object's return until it is matched with any track: 0 at
        once, `NEVER` if it is not before it is hidden again.
    """

    hidden_frames: np.ndarray
    same_track: np.ndarray
    delays: np.ndarray

    def __len__(self) -> int:
        return len(self.hidden_frames)

    @property
    def reassociated(self) -> np.ndarray:
        """(G,) bool, gaps after which the object was matched again."""
        reassociated: np.ndarray = self.delays != NEVER
        return reassociated


def recovery(sequence: TrackedSequence, matched: TrackPairs) -> Recovery:
    """Return all gaps of all objects that were matched before.

    The sequence holds the visible objects: one that leaves it and comes back was hidden, or out
    of range.
    """
    frames = np.repeat(np.arange(len(sequence)), sequence.truth_counts)
    tracks = np.full(len(frames), NO_TRACK)
    tracks[matched.truth_rows] = matched.tracks
    by_object = np.argsort(sequence.truths, kind="stable")
    lives = np.split(by_object, np.flatnonzero(np.diff(sequence.truths[by_object])) + 1)
    gaps = [gap for rows in lives if len(rows) for gap in _gaps(frames[rows], tracks[rows])]
    return Recovery(
        np.array([gap.hidden_frames for gap in gaps], np.int64),
        np.array([gap.same_track for gap in gaps], bool),
        np.array([gap.delay for gap in gaps], np.int64),
    )


class _Gap(NamedTuple):
    hidden_frames: int
    same_track: bool
    delay: int


def _gaps(frames: np.ndarray, tracks: np.ndarray) -> list[_Gap]:
    """Return the gaps of one object; (F,) its frames and its track in each, or `NO_TRACK`."""
    gaps = []
    returns = [*(np.flatnonzero(np.diff(frames) > 1) + 1).tolist(), len(frames)]
    for start, end in pairwise(returns):
        before = tracks[:start][tracks[:start] != NO_TRACK]
        if not len(before):
            continue
        hidden_frames = int(frames[start] - frames[start - 1]) - 1
        after = np.flatnonzero(tracks[start:end] != NO_TRACK)
        if not len(after):
            gaps.append(_Gap(hidden_frames, False, NEVER))
            continue
        row = start + after[0]
        delay = int(frames[row] - frames[start])
        gaps.append(_Gap(hidden_frames, bool(tracks[row] == before[-1]), delay))
    return gaps


# --------------------------------------------------------------------------------------------------
# HOTA at each threshold of similarity.

BY_ALPHA = "alpha"
ALPHA_BANDS = tuple(f"{alpha:.2f}" for alpha in ALPHAS)
CURVES = ("det_a", "ass_a", "loc_a")


def score_each_alpha(
    tracks: Sequence[Tracks], truths: Sequence[Truth], pairings: Sequence[Pairing]
) -> dict[str, Score]:
    """Return what `score_tracks` returns, and HOTA, DetA, AssA and LocA at each alpha.

    The latter are named by `part_name` and weighted by the episode's objects: of pooled episodes,
    too, the mean over alphas is the figure that `score_tracks` returns.
    """
    counted = counted_rows(pairings)
    sequence = counted_sequence(tracks, truths, pairings, counted)
    curves, objects = hota(sequence), len(sequence.truths)
    return _scores(tracks, truths, counted, sequence, THRESHOLD).named() | {
        part_name(name, BY_ALPHA, band): averaged(float(value), objects)
        for name in ("hota", *CURVES)
        for band, value in zip(ALPHA_BANDS, getattr(curves, name), strict=True)
    }
