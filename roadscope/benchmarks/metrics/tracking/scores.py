"""How well tracks follow the objects that could be seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from roadscope.benchmarks.metrics.clear import clear_counts
from roadscope.benchmarks.metrics.hota import hota
from roadscope.benchmarks.metrics.identity import idf1
from roadscope.benchmarks.metrics.matching import Pairing
from roadscope.benchmarks.metrics.score import Score, ScoreFamily, mean, ratio, rms
from roadscope.benchmarks.metrics.tracked import counted_frames
from roadscope.core import Tracks, Truth

GATE_M = 2.0


@dataclass(frozen=True, slots=True)
class TrackingScores(ScoreFamily):
    """Scores of a tracker on one episode.

    hota, det_a, ass_a, loc_a: HOTA and its parts (Luiten et al. 2021), similarity 1 at no
        distance, 0.5 at the gate.
    mota: 1 - (misses + false alarms + ID switches) / object frames; may be negative.
    motp_m: mean distance of matched pairs (Bernardin and Stiefelhagen 2008).
    idf1: share of object and track frames explained by one track per object.
    id_switches: an object gets another track than before.
    wrong_associations: a track goes over to another object.
    fragmentations: an object is lost and found again.
    mostly_tracked, mostly_lost: share of objects followed in over 80 %, under 20 % of frames.
    recall, precision: matched over object frames and over track frames.
    position_rmse_m, velocity_rmse_m_s: errors of matched tracks.
    """

    hota: Score
    det_a: Score
    ass_a: Score
    loc_a: Score
    mota: Score
    motp_m: Score
    idf1: Score
    id_switches: Score
    wrong_associations: Score
    fragmentations: Score
    mostly_tracked: Score
    mostly_lost: Score
    recall: Score
    precision: Score
    position_rmse_m: Score
    velocity_rmse_m_s: Score


def score_tracks(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    pairings: Sequence[Pairing],
    *,
    gate_m: float = GATE_M,
) -> TrackingScores:
    """Score an episode, frame by frame; tracks in the world frame, like truth.

    An object that is ineligible for a while (hidden, say) keeps its identity over the gap.
    """
    frames = counted_frames(tracks, truths, pairings, gate_m)
    c = clear_counts(frames, gate_m)
    objects = c.matches + c.misses
    wrong = c.misses + c.false_alarms + c.id_switches
    mota = 1 - wrong / objects if objects else math.nan
    whole = hota(frames, gate_m)
    return TrackingScores(
        hota=whole.hota,
        det_a=whole.det_a,
        ass_a=whole.ass_a,
        loc_a=whole.loc_a,
        mota=Score(mota, "1", "higher", objects, -math.inf, 1.0, weight=objects),
        motp_m=mean(c.distance_m, c.matches, "m"),
        idf1=idf1(frames, gate_m),
        id_switches=Score(float(c.id_switches), "1/episode", "lower", c.matches),
        wrong_associations=Score(float(c.wrong_associations), "1/episode", "lower", c.matches),
        fragmentations=Score(float(c.fragmentations), "1/episode", "lower", c.matches),
        mostly_tracked=ratio(c.mostly_tracked, c.objects),
        mostly_lost=ratio(c.mostly_lost, c.objects, "lower"),
        recall=ratio(c.matches, objects),
        precision=ratio(c.matches, c.matches + c.false_alarms),
        position_rmse_m=rms(c.distance_squares, c.matches, "m"),
        velocity_rmse_m_s=rms(c.speed_squares, c.matches, "m/s"),
    )
