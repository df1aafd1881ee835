"""AMOTA: accuracy averaged over recall, as AB3DMOT and as nuScenes define it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.metrics.tracking.clear import Clear, count_matches, switched
from roadscope.benchmarks.metrics.tracking.matching import match_tracks
from roadscope.benchmarks.metrics.tracking.sequence import (
    GATE_M,
    TrackedSequence,
    similarity_by_distance,
)
from roadscope.core.record import Record

RECALL_STEPS = 40
ROUNDING = 1e-9
"""Recalls and scores that differ by less are equal."""


def mean_scores(sequence: TrackedSequence) -> np.ndarray:
    """Return (distinct tracks,) the mean score of each track over its frames."""
    frames = np.bincount(sequence.tracks, minlength=sequence.distinct_tracks)
    sums = np.bincount(sequence.tracks, sequence.scores, minlength=sequence.distinct_tracks)
    mean: np.ndarray = sums / frames
    return mean


# --------------------------------------------------------------------------------------------------
# AB3DMOT (Weng et al. 2020).

RECALLS = np.linspace(0.0, 1.0, RECALL_STEPS + 1)[1:]
"""Recalls r over which AB3DMOT averages."""


@dataclass(frozen=True, slots=True, eq=False)
class Amota(Record):
    """Curves over the 40 `RECALLS`, and their means (Weng et al. 2020, AB3DMOT).

    A recall that no score reaches counts as 0 in all of them.

    least_scores: (40,) the score from which on tracks take part; nan where a recall is not reached.
    mota: (40,) MOTA of these tracks, at most 1, may be negative.
    smota: (40,) max(0, min(1, 1 - (FP + FN + IDS - (1 - r) P) / (r P))), with P object frames.
    motp: (40,) mean similarity of matches, 0 to 1.
    """

    least_scores: np.ndarray
    mota: np.ndarray
    smota: np.ndarray
    motp: np.ndarray

    @property
    def amota(self) -> float:
        """Mean of `mota`; at most the mean recall, about a half, if all scores differ."""
        return float(self.mota.mean())

    @property
    def samota(self) -> float:
        """Mean of `smota`, 0 to 1, eq. 5 of the paper."""
        return float(self.smota.mean())

    @property
    def amotp(self) -> float:
        """Mean of `motp`, 0 to 1."""
        return float(self.motp.mean())


def amota(*sequences: TrackedSequence, threshold: float = 0.5) -> Amota:
    """Return AMOTA and its parts (Weng et al. 2020) of one or several sequences together.

    The score of a track is its mean over frames. For each recall, the least score is computed at
    which the matched tracks reach it, and the tracks from this score on are scored by CLEAR MOT.

    The averages are those of AB3DMOT, matches and ID switches those of `match_tracks`. AB3DMOT's
    evaluator matches each frame anew, counts a switch only if the object was tracked in the
    previous frame too, and lets matches with objects that do not count contribute to a recall.

    threshold: similarity from which on a pair can be matched.
    """
    track_scores = [mean_scores(sequence) for sequence in sequences]
    present = sum(len(sequence.truths) for sequence in sequences)
    matched_scores = [
        scores[match_tracks(sequence, threshold).tracks]
        for sequence, scores in zip(sequences, track_scores, strict=True)
    ]
    reached = least_scores(np.concatenate([np.empty(0), *matched_scores]), present)
    counts: dict[float, Clear] = {}
    for least in np.unique(reached).tolist():
        for sequence, scores in zip(sequences, track_scores, strict=True):
            alive = scores >= least
            part = count_matches(sequence, match_tracks(sequence, threshold, alive), alive)
            counts[least] = counts[least] + part if least in counts else part
    curves = np.zeros((3, RECALL_STEPS))
    for k, least in enumerate(reached.tolist()):
        recall, part = float(RECALLS[k]), counts[least]
        curves[:, k] = part.mota, _scaled_mota(part, recall), part.motp
    missing = np.full(RECALL_STEPS - len(reached), np.nan)
    return Amota(np.concatenate([reached, missing]), *curves)


def least_scores(scores: np.ndarray, present: int) -> np.ndarray:
    """Return the least score for each recall that is reached, (at most 40,), highest first.

    The k-th highest score stands for the recalls that are nearer to k matches than to k + 1, the
    last score for one recall at least. With under 60 object frames a score may stand for several
    recalls, where AB3DMOT leaves some of them out.

    scores: (K,) of matches. present: object frames.
    """
    # One more in the beginning, for a recall of 0, which is left out in the end.
    chosen, recall = [], 0.0
    ordered = np.sort(scores)[::-1].tolist()
    for k, score in enumerate(ordered, start=1):
        before, after = k / present, (k + 1) / present
        is_last = k == len(ordered)
        is_chosen = is_last or after - recall >= recall - before
        while is_chosen:
            chosen.append(score)
            recall += float(RECALLS[0])
            is_chosen = (
                recall <= before + ROUNDING if is_last else after - recall >= recall - before
            )
    return np.array(chosen[1 : RECALL_STEPS + 1])


def _scaled_mota(counts: Clear, recall: float) -> float:
    """Return `Amota.smota` at one recall."""
    wrong = counts.misses + counts.false_alarms + counts.id_switches
    allowed = (1 - recall) * counts.present
    return min(1.0, max(0.0, 1 - (wrong - allowed) / (recall * counts.present)))


# --------------------------------------------------------------------------------------------------
# nuScenes (Caesar et al. 2020).

NUSCENES_RECALLS = np.linspace(0.1, 1.0, RECALL_STEPS)
"""Recalls over which nuScenes averages; it leaves out those below 0.1 as too noisy."""
SCORE_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class NuscenesAmota(Record):
    """Curves over 40 recalls from 0.1 to 1, and their means (Caesar et al. 2020, nuScenes).

    least_scores: (40,) the score from which on tracks take part; nan where a recall is not reached.
    motar: (40,) max(0, 1 - (IDS + FP + FN - (1 - r) P) / (r P)), 0 to 1; 0 where it is not reached.
    motp_m: (40,) mean distance of matches, metres; the gate where the recall is not reached.
    """

    least_scores: np.ndarray
    motar: np.ndarray
    motp_m: np.ndarray

    @property
    def amota(self) -> float:
        """Mean of `motar`, 0 to 1, higher is better."""
        return float(self.motar.mean())

    @property
    def amotp_m(self) -> float:
        """Mean of `motp_m`, 0 to the gate, lower is better."""
        return float(self.motp_m.mean())


def amota_nuscenes(*sequences: TrackedSequence, gate_m: float = GATE_M) -> NuscenesAmota:
    """Return nuScenes' AMOTA (Caesar et al. 2020) of one class in one or several sequences.

    Pairs match up to `gate_m` between centres seen from above, whatever their similarity; the
    score of a track is its mean over frames. As in nuScenes' evaluator, r in the formula of MOTAR
    is the recall that the tracks from a score on have, not the one that the score was chosen for,
    and it counts only the matches that are no ID switch.

    Left to the caller: which ranges and objects count, and nuScenes' interpolation over gaps.
    """
    parts = [_DistanceMatched.of(sequence, gate_m) for sequence in sequences]
    present = sum(len(part.sequence.truths) for part in parts)
    scores = np.concatenate([np.empty(0), *(part.scores_without_switches() for part in parts)])
    least = np.full(RECALL_STEPS, np.nan)
    if len(scores):
        recalls = np.arange(1, len(scores) + 1) / present
        least = np.interp(NUSCENES_RECALLS, recalls, np.sort(scores)[::-1], right=np.nan)
    motar, motp_m = np.zeros(RECALL_STEPS), np.full(RECALL_STEPS, gate_m)
    for score in np.unique(least[np.isfinite(least)]).tolist():
        counts = [part.counts(score) for part in parts]
        total = _NuscenesCounts(*(sum(column) for column in zip(*counts, strict=True)))
        recall = (total.matches - total.switches) / present
        if recall > 0:
            rows = least == score
            motar[rows] = _motar(total, recall, present)
            motp_m[rows] = total.distance_m / total.matches
    return NuscenesAmota(least, motar, motp_m)


class _NuscenesCounts(NamedTuple):
    """Matches, ID switches, track frames, and the sum of the matches' distances."""

    matches: float
    switches: float
    track_frames: float
    distance_m: float


def _motar(counts: _NuscenesCounts, recall: float, present: int) -> float:
    false_alarms, misses = counts.track_frames - counts.matches, present - counts.matches
    wrong = counts.switches + false_alarms + misses
    return max(0.0, 1 - (wrong - (1 - recall) * present) / (recall * present))


@dataclass(frozen=True, slots=True)
class _DistanceMatched:
    """A sequence whose similarities are by distance, and its (distinct tracks,) mean scores."""

    sequence: TrackedSequence
    track_scores: np.ndarray

    @staticmethod
    def of(sequence: TrackedSequence, gate_m: float) -> _DistanceMatched:
        similarities = similarity_by_distance(sequence.distances("nuScenes' AMOTA"), gate_m)
        by_distance = replace(sequence, similarities=similarities)
        return _DistanceMatched(by_distance, mean_scores(sequence))

    def scores_without_switches(self) -> np.ndarray:
        """Return the track scores of all matches that are no ID switch."""
        matched = match_tracks(self.sequence)
        steady = ~switched(matched.objects, matched.tracks)
        scores: np.ndarray = self.track_scores[matched.tracks[steady]]
        return scores

    def counts(self, least: float) -> _NuscenesCounts:
        """Return the counts of the tracks from a score on."""
        alive = self.track_scores >= least - SCORE_ROUNDING
        matched = match_tracks(self.sequence, alive=alive)
        return _NuscenesCounts(
            matches=len(matched.pairs),
            switches=float(switched(matched.objects, matched.tracks).sum()),
            track_frames=float(alive[self.sequence.tracks].sum()),
            distance_m=float(self.sequence.distances("AMOTP")[matched.pairs].sum()),
        )
