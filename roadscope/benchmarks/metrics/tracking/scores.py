"""All scores of a tracker on one episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from roadscope.benchmarks.metrics.matching import Pairing
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, mean, ratio, rms
from roadscope.benchmarks.metrics.tracking.amota import amota
from roadscope.benchmarks.metrics.tracking.amota_nuscenes import amota_nuscenes
from roadscope.benchmarks.metrics.tracking.clear import Clear, count
from roadscope.benchmarks.metrics.tracking.counted import (
    counted_rows,
    counted_sequence,
    matched_rows,
)
from roadscope.benchmarks.metrics.tracking.following import Following, follow
from roadscope.benchmarks.metrics.tracking.hota import hota
from roadscope.benchmarks.metrics.tracking.identity import identity
from roadscope.benchmarks.metrics.tracking.nees import nees
from roadscope.benchmarks.metrics.tracking.ospa import gospa, ospa
from roadscope.benchmarks.metrics.tracking.recovery import recovery
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.benchmarks.metrics.tracking.similarity import GATE_M, Similarity, named
from roadscope.benchmarks.metrics.tracking.states import StateErrors, state_errors
from roadscope.core import Tracks, Truth


@dataclass(frozen=True, slots=True)
class TrackingScores(ScoreFamily):
    """Scores of a tracker on one episode.

    hota, det_a, ass_a, loc_a, det_re, det_pr, ass_re, ass_pr: HOTA and its parts (Luiten et al.
        2021), each the mean over all alphas.
    mota: 1 - (misses + false alarms + ID switches) / object frames; may be negative.
    motp, motp_m: mean similarity and mean distance of matched pairs (Bernardin and
        Stiefelhagen 2008).
    idf1, idp, idr: share of frames explained by one track per object (Ristani et al. 2016).
    id_switches: an object gets another track than before.
    wrong_associations: a track goes over to another object.
    fragmentations: an object is lost and found again.
    mostly_tracked, partially_tracked, mostly_lost: share of objects followed in over 80 %, in
        between, under 20 % of frames.
    recall, precision: matched over object frames and over track frames.
    samota, amota, amotp: averages over recall, as AB3DMOT defines them (Weng et al. 2020).
    amota_nuscenes, amotp_nuscenes_m: as nuScenes defines them (Caesar et al. 2020), by centres
        whatever the similarity.
    ospa_m, gospa_m: order 1, cut-off at the gate, mean over frames (Schuhmacher et al. 2008;
        Rahmathullah et al. 2017).
    kept_through_occlusion: share of times in which an object that had a track could not be seen
        after which the same track follows it again.
    reassociation_frames: frames from an object's return until any track follows it.
    position_rmse_m, velocity_rmse_m_s, heading_rmse_deg: errors of matched tracks.
    heading_reversed: share of them whose heading is off by more than a right angle.
    nees_position, nees_state: NEES over its degrees of freedom, of position, and of position and
        velocity: 1 when consistent, more when tracks are too sure of themselves.
    nees_in_band: 1 where the mean NEES of position lies in its 95 % band, each object's errors
        taken for one value, as those of successive frames are alike; else 0.
    inside_position, inside_state: share of matched tracks whose object lies within their 95 %
        ellipse: 0.95 when consistent.
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
    threshold: float = 0.5,
) -> TrackingScores:
    """Score an episode, frame by frame; tracks in the world frame, like truth.

    An object that is ineligible for a while (hidden, say) keeps its identity over the gap.

    similarity: what is compared, `SIMILARITIES`; threshold: from which on a pair can match.
    """
    counted = counted_rows(pairings, GATE_M)
    distances = [pairing.distances for pairing in pairings]
    alike = None if similarity == "centre" else named(similarity)
    sequence = counted_sequence(tracks, truths, distances, counted, alike)
    following = follow(sequence, threshold)
    errors = state_errors(tracks, truths, matched_rows(sequence, following, counted))
    return TrackingScores(
        **_hota_scores(sequence),
        **_clear_scores(sequence, following),
        **_identity_scores(sequence, threshold),
        **_averaged_scores(sequence, threshold),
        **_set_scores(sequence),
        **_recovery_scores(sequence, following),
        **state_scores(errors),
        **consistency_scores(errors, len(np.unique(following.objects))),
    )


def _hota_scores(sequence: TrackedSequence) -> dict[str, Score]:
    curves, objects = hota(sequence), len(sequence.truths)
    parts = ("hota", "det_a", "ass_a", "loc_a", "det_re", "det_pr", "ass_re", "ass_pr")
    return {name: _averaged(float(getattr(curves, name).mean()), objects) for name in parts}


def _clear_scores(sequence: TrackedSequence, following: Following) -> dict[str, Score]:
    c = count(sequence, following)
    apart = float(sequence.distances("MOTP in metres")[following.pairs].sum())
    return {
        "mota": _averaged(c.mota, c.present, -math.inf),
        "motp": _share_of(c.closeness, c.matches),
        "motp_m": mean(apart, c.matches, "m"),
        **{name: _events(c, name) for name in ("id_switches", "wrong_associations")},
        "fragmentations": _events(c, "fragmentations"),
        "mostly_tracked": ratio(c.mostly_tracked, c.objects),
        "partially_tracked": ratio(c.partially_tracked, c.objects),
        "mostly_lost": ratio(c.mostly_lost, c.objects, "lower"),
        "recall": ratio(c.matches, c.present),
        "precision": ratio(c.matches, c.matches + c.false_alarms),
    }


def _identity_scores(sequence: TrackedSequence, threshold: float) -> dict[str, Score]:
    found = identity(sequence, threshold)
    return {
        "idf1": ratio(found.hits, (found.present + found.tracked) / 2),
        "idp": ratio(found.hits, found.tracked),
        "idr": ratio(found.hits, found.present),
    }


def _averaged_scores(sequence: TrackedSequence, threshold: float) -> dict[str, Score]:
    found, objects = amota(sequence, threshold=threshold), len(sequence.truths)
    by_centres = amota_nuscenes(sequence)
    apart = by_centres.amotp_m if objects else math.nan
    return {
        "samota": _averaged(found.samota, objects),
        "amota": _averaged(found.amota, objects, -math.inf),
        "amotp": _averaged(found.amotp, objects),
        "amota_nuscenes": _averaged(by_centres.amota, objects),
        "amotp_nuscenes_m": Score(apart, "m", "lower", objects, 0.0, GATE_M, weight=objects),
    }


def _set_scores(sequence: TrackedSequence) -> dict[str, Score]:
    frames = len(sequence)
    return {
        "ospa_m": mean(float(ospa(sequence, GATE_M).distances.sum()), frames, "m"),
        "gospa_m": mean(float(gospa(sequence, GATE_M).distances.sum()), frames, "m"),
    }


def _recovery_scores(sequence: TrackedSequence, following: Following) -> dict[str, Score]:
    found = recovery(sequence, following)
    late, again = float(found.delays[found.found].sum()), int(found.found.sum())
    return {
        "kept_through_occlusion": ratio(float(found.kept.sum()), len(found)),
        "reassociation_frames": mean(late, again, "frames"),
    }


def state_scores(errors: StateErrors) -> dict[str, Score]:
    """Return errors of position, velocity and heading of matched tracks."""
    n = len(errors)
    squares = float((np.degrees(errors.headings) ** 2).sum())
    return {
        "position_rmse_m": rms(float((errors.positions**2).sum()), n, "m"),
        "velocity_rmse_m_s": rms(float((errors.velocities**2).sum()), n, "m/s"),
        "heading_rmse_deg": rms(squares, n, "deg"),
        "heading_reversed": ratio(float(errors.reversed.sum()), n, "lower"),
    }


def consistency_scores(errors: StateErrors, objects: int) -> dict[str, Score]:
    """Return NEES, and how often objects lie within ellipses; objects: how many were followed."""
    scores: dict[str, Any] = {}
    for name, velocity in (("position", False), ("state", True)):
        found = nees(errors, velocity=velocity)
        total = float(found.values.sum()) / found.freedom
        scores[f"nees_{name}"] = mean(total, len(found), "1")
        scores[f"inside_{name}"] = _share_of(found.inside * len(found), len(found))
        if not velocity:
            within = float(found.in_band(objects)) if len(found) else math.nan
            scores["nees_in_band"] = Score(within, "1", "higher", len(found), 0.0, 1.0)
    return scores


def _averaged(value: float, objects: int, least: float = 0.0) -> Score:
    """Return what an episode with objects has, nothing otherwise."""
    return Score(value if objects else math.nan, "1", "higher", objects, least, 1.0, weight=objects)


def _share_of(total: float, n: int) -> Score:
    return Score(total / n if n else math.nan, "1", "higher", n, 0.0, 1.0, weight=n)


def _events(counts: Clear, name: str) -> Score:
    return Score(float(getattr(counts, name)), "1/episode", "lower", counts.matches)
