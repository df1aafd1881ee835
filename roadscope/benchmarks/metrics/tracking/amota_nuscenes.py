"""AMOTA and AMOTP as nuScenes defines them: by centres, over recalls from a tenth on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.benchmarks.metrics.tracking.amota import sureness
from roadscope.benchmarks.metrics.tracking.clear import changed
from roadscope.benchmarks.metrics.tracking.following import follow
from roadscope.benchmarks.metrics.tracking.sequence import GATE_M, TrackedSequence, near
from roadscope.core.record import Record

RECALLS = np.linspace(0.1, 1.0, 40)
"""Those over which is averaged; below a tenth figures are too noisy."""
ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class NuscenesAmota(Record):
    """Averages over recall (Caesar et al. 2020, nuScenes' tracking task), curves over `RECALLS`.

    least_scores: (40,) the score from which on tracks count; nan where a recall is not reached.
    motar: (40,) accuracy among what the recall allows, 0 to 1; 0 where it is not reached.
    motp_m: (40,) mean distance of matches, metres; the gate where the recall is not reached.
    """

    least_scores: np.ndarray
    motar: np.ndarray
    motp_m: np.ndarray

    @property
    def amota(self) -> float:
        """Mean of `motar`, 0 to 1."""
        return float(self.motar.mean())

    @property
    def amotp_m(self) -> float:
        """Mean of `motp_m`: 0 is best, the gate worst."""
        return float(self.motp_m.mean())


def amota_nuscenes(*sequences: TrackedSequence, gate_m: float = GATE_M) -> NuscenesAmota:
    """Return nuScenes' AMOTA (Caesar et al. 2020) of one class in one or several sequences.

    Pairs match up to `gate_m` between centres seen from above, whatever their similarity; a
    track is as sure as it is on average over its frames. MOTAR is
    max(0, 1 - (IDS + FP + FN - (1 - r) P) / (r P)), with P object frames. As in the evaluator,
    r is the recall that a score comes to, not the one that was asked for, and counts the matches
    that are no ID switch.

    Left to the caller: which ranges and objects count, and nuScenes' filling of gaps.
    """
    parts = [_Part.of(sequence, gate_m) for sequence in sequences]
    present = sum(len(part.sequence.truths) for part in parts)
    ordered = np.sort(np.concatenate([np.empty(0), *(part.steady_scores() for part in parts)]))[
        ::-1
    ]
    wanted = np.full(len(RECALLS), np.nan)
    if len(ordered):
        reached = np.arange(1, len(ordered) + 1) / present
        wanted = np.interp(RECALLS, reached, ordered, right=np.nan)
    curves = np.tile([0.0, gate_m], (len(RECALLS), 1))
    for least in np.unique(wanted[np.isfinite(wanted)]):
        curves[wanted == least] = _accuracy(parts, float(least), present, gate_m)
    return NuscenesAmota(wanted, curves[:, 0], curves[:, 1])


@dataclass(frozen=True, slots=True)
class _Part:
    """A sequence, compared by centres, with the (tracks,) sureness of each track."""

    sequence: TrackedSequence
    sure: np.ndarray

    @staticmethod
    def of(sequence: TrackedSequence, gate_m: float) -> _Part:
        apart = sequence.distances("nuScenes' AMOTA")
        return _Part(replace(sequence, similarities=near(apart, gate_m)), sureness(sequence))

    def steady_scores(self) -> np.ndarray:
        """Return how sure the tracks of all matches are that are no ID switch."""
        following = follow(self.sequence)
        steady = ~changed(following.objects, following.tracks)
        scores: np.ndarray = self.sure[following.tracks[steady]]
        return scores

    def counts(self, least: float) -> np.ndarray:
        """Return matches, switches, track frames and the sum of distances from a score on."""
        alive = self.sure >= least - ROUNDING
        following = follow(self.sequence, alive=alive)
        switches = changed(following.objects, following.tracks).sum()
        apart = self.sequence.distances("AMOTP")[following.pairs].sum()
        told = alive[self.sequence.tracks].sum()
        return np.array([len(following.pairs), switches, told, apart])


def _accuracy(parts: list[_Part], least: float, present: int, gate_m: float) -> tuple[float, float]:
    """Return MOTAR and MOTP of the tracks from a score on."""
    matches, switches, told, apart = np.sum([part.counts(least) for part in parts], axis=0)
    recall = (matches - switches) / present
    if recall == 0:
        return 0.0, gate_m
    wrong = switches + (told - matches) + (present - matches)
    motar = 1 - (wrong - (1 - recall) * present) / (recall * present)
    return max(0.0, float(motar)), float(apart / matches)
