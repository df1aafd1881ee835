"""AMOTA: accuracy averaged over how sure a track must be to count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.metrics.tracking.clear import Clear, count
from roadscope.benchmarks.metrics.tracking.following import follow
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.core.record import Record

RECALLS = np.linspace(0.0, 1.0, 41)[1:]
"""Those over which is averaged; 0 says nothing."""
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Amota(Record):
    """Averages over recall (Weng et al. 2020, AB3DMOT), with curves over `RECALLS`.

    A recall that no threshold reaches counts as 0 in all of them.

    least_scores: (40,) the score from which on tracks count; nan where a recall is not reached.
    mota: (40,) as CLEAR MOT has it, of the tracks that count.
    smota: (40,) the same scaled to what the recall allows, 0 to 1.
    motp: (40,) mean similarity of matches.
    """

    least_scores: np.ndarray
    mota: np.ndarray
    smota: np.ndarray
    motp: np.ndarray

    @property
    def amota(self) -> float:
        """Mean of `mota`; at most the mean recall, about a half, where all scores differ."""
        return float(self.mota.mean())

    @property
    def samota(self) -> float:
        """Mean of `smota`, eq. 5 of the paper."""
        return float(self.smota.mean())

    @property
    def amotp(self) -> float:
        """Mean of `motp`."""
        return float(self.motp.mean())


def amota(*sequences: TrackedSequence, threshold: float = 0.5) -> Amota:
    """Return AMOTA and its parts (Weng et al. 2020) of one or several sequences together.

    A track is as sure as it is on average over its frames. For every recall the score is
    sought from which on matched tracks reach it, and what is surer is scored by CLEAR MOT.

    The averages are AB3DMOT's, matches and switches are those of `follow`. Its evaluator matches
    every frame anew, counts a switch only where the object was tracked in the frame before, too,
    and takes scores of matches with objects that do not count among those that reach a recall.
    """
    surenesses = [sureness(sequence) for sequence in sequences]
    present = sum(len(sequence.truths) for sequence in sequences)
    matched = [
        sure[follow(sequence, threshold).tracks]
        for sequence, sure in zip(sequences, surenesses, strict=True)
    ]
    wanted = least_scores(np.concatenate([np.empty(0), *matched]), present)
    known: dict[float, Clear] = {}
    for least in np.unique(wanted).tolist():
        for sequence, sure in zip(sequences, surenesses, strict=True):
            alive = sure >= least
            part = count(sequence, follow(sequence, threshold, alive), alive)
            known[least] = known[least] + part if least in known else part
    curves = np.zeros((3, len(RECALLS)))
    for k, (recall, least) in enumerate(zip(RECALLS, wanted.tolist(), strict=False)):
        curves[:, k] = _accuracy(known[least], float(recall))
    missing = np.full(len(RECALLS) - len(wanted), np.nan)
    return Amota(np.concatenate([wanted, missing]), *curves)


def least_scores(scores: np.ndarray, present: int) -> np.ndarray:
    """Return the scores at which the recalls are reached that can be, highest first.

    scores: (K,) of matches; present: object frames. The k-th score stands for the recalls that
    are nearer to k than to k + 1 matches, the last one for at least one. Under 60 object frames
    a score may stand for several recalls, where AB3DMOT leaves some of them out.
    """
    ordered, found = np.sort(scores)[::-1].tolist(), []
    # One more at the beginning: the recall 0, which is left out in the end.
    wanted = 0.0
    for k, score in enumerate(ordered, start=1):
        last = k == len(ordered)
        once = last
        while once or _stands_for(k / present, (k + 1) / present, wanted, last):
            found.append(score)
            wanted += float(RECALLS[0])
            once = False
    return np.array(found[1 : len(RECALLS) + 1])


def _stands_for(here: float, after: float, wanted: float, last: bool) -> bool:
    return wanted <= here + ROUNDING if last else after - wanted >= wanted - here


def _accuracy(counts: Clear, recall: float) -> tuple[float, float, float]:
    """Return MOTA, scaled MOTA and MOTP at a recall."""
    wrong = counts.misses + counts.false_alarms + counts.id_switches
    allowed = (1 - recall) * counts.present
    scaled = 1 - (wrong - allowed) / (recall * counts.present)
    return counts.mota, min(1.0, max(0.0, scaled)), counts.motp


def sureness(sequence: TrackedSequence) -> np.ndarray:
    """Return (tracks,) the mean score of each track over its frames."""
    frames = np.bincount(sequence.tracks, minlength=sequence.followers)
    sums = np.bincount(sequence.tracks, sequence.scores, minlength=sequence.followers)
    mean: np.ndarray = sums / frames
    return mean
