"""What the scores of an unknown detector mean, learned from how long its detections go on.

Right detections go on: the same object is detected again at the expected place. Clutter soon
ends. So the share of detections with a score that go on says how many of them are right. Only the
order of scores counts: no monotone transform of them changes anything.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from roadscope.trackers._traits import SECTION_NUMBER, SECTIONS

# Chosen by hand, and tried on half of the KITTI sequences that were learned from.
FOLLOW_S = 0.5
"""Detections go on if their target is detected in every tick of this time."""
SETTLED_S = 1.0
"""Targets that were detected without a miss for this time are taken to be right."""
SETTLED_SHARE, SETTLED_WEIGHT = 0.8, 10.0
"""Share of detections of such targets that go on before any was counted, and its weight."""
REMEMBERED = 3000
"""Detections of each section that the share rests on at most."""
BLOCK, MOST_BLOCKS = 12, 24
"""Least number of detections of similar score whose share is taken; most of such blocks."""
PRIOR_SHARES, PRIOR_WEIGHT = (0.1, 0.9), 2.0
"""Shares at the lowest and the highest score before any was counted; their weight in a block."""
LIMITS = (0.02, 0.98)
"""Probabilities that scores alone can give."""
TRIAL = (60, 600)
"""Number of detections from which on, and up to which, scores may prove to be no probabilities."""
LEAST_SETTLED, LEAST_OF_BEST = 0.7, 0.9
"""Shares of detections of settled targets that go on, and of right ones in the third of highest
scores, below which nothing is concluded: where a detector often misses, ends say little."""
MOST_WRONG, MOST_WRONG_OF_ONE = 0.15, 1.0
"""Difference, in a third of the detections by score, of mean score and share of right ones; of n
detections the first plus the second over the root of n."""


class PendingDetections(NamedTuple):
    """Detections of one tick of which it is not known yet whether they go on.

    ids: (N,) of their targets. settled: (N,) bool, whether these are taken to be right.
    """

    stamp_s: float
    ids: np.ndarray
    scores: np.ndarray
    sections: np.ndarray
    settled: np.ndarray


class ScoreMeaning:
    """Learns with every tick with which probability a detection of a score is right."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all detections."""
        self._pending: deque[PendingDetections] = deque()
        self._scores = [np.empty(0)] * len(SECTIONS)
        self._went_on = [np.empty(0)] * len(SECTIONS)
        self._settled = SETTLED_WEIGHT * np.array([SETTLED_SHARE, 1.0])
        self.contradicts_scores = False
        """Whether scores proved to be no probabilities that detections are right."""

    @property
    def _settled_share(self) -> float:
        return float(self._settled[0] / self._settled[1])

    def probabilities(self, scores: np.ndarray, categories: np.ndarray) -> np.ndarray:
        """Return (N,) probabilities that the detections of a tick are right."""
        sections, shares = SECTION_NUMBER[categories], np.empty(len(scores))
        for section in np.unique(sections).tolist():
            own = sections == section
            waiting = [each.scores[each.sections == section] for each in self._pending]
            everything = np.sort(np.concatenate([self._scores[section], *waiting, scores[own]]))
            shares[own] = self._shares(section, everything, scores[own])
        right: np.ndarray = np.clip(shares / self._settled_share, *LIMITS)
        return right

    def _shares(self, section: int, everything: np.ndarray, scores: np.ndarray) -> np.ndarray:
        """Return (N,) shares of detections like these that go on.

        everything: sorted scores, whose ranks are used.
        """
        ranks = _middle_ranks(everything, scores)
        order = np.argsort(self._scores[section], kind="stable")
        if not len(order):
            first: np.ndarray = np.interp(ranks, [0, 1], PRIOR_SHARES)
            return first
        blocks = np.array_split(order, np.clip(len(order) // BLOCK, 1, MOST_BLOCKS))
        own_ranks = _middle_ranks(everything, self._scores[section])
        knots = np.array([own_ranks[block].mean() for block in blocks])
        counts = np.array([len(block) for block in blocks]) + PRIOR_WEIGHT
        shares_of_ties = _means_of_ties(self._scores[section], self._went_on[section])
        went_on = np.array([shares_of_ties[block].sum() for block in blocks])
        prior = np.interp(knots, [0, 1], PRIOR_SHARES)
        pooled = rising((went_on + PRIOR_WEIGHT * prior) / counts, counts)
        shares: np.ndarray = np.interp(ranks, knots, pooled)
        return shares

    def count(self, detected: PendingDetections, streaks_s: np.ndarray) -> None:
        """Take the detections of a tick, and (N,) since when their targets were not missed."""
        before = sum(map(len, self._scores))
        while self._pending and detected.stamp_s - self._pending[0].stamp_s > FOLLOW_S - 1e-6:
            self._resolve(self._pending.popleft(), detected, streaks_s)
        self._pending.append(detected)
        if before <= TRIAL[1] and sum(map(len, self._scores)) >= TRIAL[0]:
            self.contradicts_scores |= self._are_wrong()

    def _are_wrong(self) -> bool:
        """Return whether scores, taken for probabilities, are far from the shares of right ones."""
        scores, went_on = np.concatenate(self._scores), np.concatenate(self._went_on)
        thirds = np.array_split(np.argsort(scores, kind="stable"), 3)
        went_on = _means_of_ties(scores, went_on)
        right = np.minimum([went_on[third].mean() / self._settled_share for third in thirds], 1)
        means = [scores[third].mean() for third in thirds]
        limit = MOST_WRONG + MOST_WRONG_OF_ONE / np.sqrt(len(scores) / 3)
        sure = self._settled_share >= LEAST_SETTLED and right[-1] >= LEAST_OF_BEST
        return bool(sure and (np.abs(right - means) > limit).any())

    def _resolve(
        self, old: PendingDetections, now: PendingDetections, streaks_s: np.ndarray
    ) -> None:
        unbroken = now.ids[streaks_s > now.stamp_s - old.stamp_s - 1e-6]
        went_on = np.isin(old.ids, unbroken)
        self._settled += [went_on[old.settled].sum(), old.settled.sum()]
        for section in np.unique(old.sections).tolist():
            own = old.sections == section
            for store, new in ((self._scores, old.scores), (self._went_on, went_on)):
                store[section] = np.append(store[section], new[own])[-REMEMBERED:]


def _middle_ranks(everything: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Return (N,) ranks, 0 to 1, among sorted scores; equal scores have the same."""
    below, upto = (np.searchsorted(everything, scores, side) for side in ("left", "right"))
    ranks: np.ndarray = (below + upto) / (2 * len(everything))
    return ranks


def _means_of_ties(scores: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return (N,) for each value the mean of the values with an equal score.

    So it does not matter which of them are counted in which block.
    """
    _, which, counts = np.unique(scores, return_inverse=True, return_counts=True)
    means: np.ndarray = (np.bincount(which, values) / counts)[which]
    return means


def rising(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the (N,) values that never fall and are nearest to these (pool adjacent violators)."""
    pools: list[tuple[float, float, int]] = []
    for value, weight in zip(values.tolist(), weights.tolist(), strict=True):
        pool = (value, weight, 1)
        while pools and pools[-1][0] > pool[0]:
            last = pools.pop()
            total = last[1] + pool[1]
            pool = ((last[0] * last[1] + pool[0] * pool[1]) / total, total, last[2] + pool[2])
        pools.append(pool)
    return np.repeat([value for value, _, _ in pools], [count for *_, count in pools])
