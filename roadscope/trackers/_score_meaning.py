"""What the scores of an unknown detector mean, learned from the persistence of its detections.

Right detections persist: the same object is detected again at the expected place. Clutter soon
ends. So the share of detections with a score that persist shows how many of them are right. Only
the order of scores counts: no monotone transform of them changes anything.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from roadscope.trackers._traits import SECTION_NUMBER, SECTIONS

# Chosen by hand, and tried on half of the KITTI sequences that were learned from.
PERSISTENCE_S = 0.5
"""Detections persist if their target is detected in every tick of this time."""
SETTLED_S = 1.0
"""Targets that were detected without a miss for this time are settled: they are taken to exist."""
SETTLED_SHARE, SETTLED_WEIGHT = 0.8, 10.0
"""Prior share of detections of settled targets that persist, and its weight in detections."""
MOST_STORED = 3000
"""Most detections of each section from which shares are computed."""
LEAST_IN_BLOCK, MOST_BLOCKS = 12, 24
"""Detections are sorted by score and cut into blocks, each of which has one share: least number of
detections in a block, and most blocks."""
PRIOR_SHARES, PRIOR_WEIGHT = (0.1, 0.9), 2.0
"""Prior shares at the lowest and the highest score, and their weight in detections of a block."""
LIMITS = (0.02, 0.98)
"""Least and greatest probability that a score alone gives."""
TRIAL = (60, 600)
"""Numbers of detections from which on, and up to which, it is tested whether scores are
probabilities."""
LEAST_SETTLED, LEAST_RIGHT_AT_TOP = 0.7, 0.9
"""Shares of detections of settled targets that persist, and of right ones in the third of highest
scores, below which the test concludes nothing: if a detector often misses, right ones end, too."""
MOST_DIFFERENCE, MOST_DIFFERENCE_OF_ONE = 0.15, 1.0
"""Greatest difference, in a third of the detections by score, between the mean score and the share
of right ones, for scores that are probabilities; of n detections it is the first plus the second
divided by the root of n."""


class PendingDetections(NamedTuple):
    """The N detections of one tick of which it is not known yet whether they persist.

    ids: (N,) of their targets. scores: (N,). sections: (N,) numbers of `SECTIONS`. settled: (N,)
    bool, whether their targets are settled, see `SETTLED_S`.
    """

    stamp_s: float
    ids: np.ndarray
    scores: np.ndarray
    sections: np.ndarray
    settled: np.ndarray


class ScoreMeaning:
    """Learns with every tick the probability that a detection of a score is right."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all detections."""
        self._pending: deque[PendingDetections] = deque()
        self._scores = [np.empty(0)] * len(SECTIONS)
        self._persisted = [np.empty(0)] * len(SECTIONS)
        # Of settled targets: number of detections that persisted, and of all.
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
            pending = [each.scores[each.sections == section] for each in self._pending]
            all_scores = np.sort(np.concatenate([self._scores[section], *pending, scores[own]]))
            shares[own] = self._shares(section, all_scores, scores[own])
        right: np.ndarray = np.clip(shares / self._settled_share, *LIMITS)
        return right

    def _shares(self, section: int, all_scores: np.ndarray, scores: np.ndarray) -> np.ndarray:
        """Return for (N,) scores the shares (N,) of such detections that persist.

        all_scores: sorted, those among which ranks are computed.
        """
        ranks = _middle_ranks(all_scores, scores)
        order = np.argsort(self._scores[section], kind="stable")
        if not len(order):
            first: np.ndarray = np.interp(ranks, [0, 1], PRIOR_SHARES)
            return first
        blocks = np.array_split(order, np.clip(len(order) // LEAST_IN_BLOCK, 1, MOST_BLOCKS))
        own_ranks = _middle_ranks(all_scores, self._scores[section])
        knots = np.array([own_ranks[block].mean() for block in blocks])
        counts = np.array([len(block) for block in blocks]) + PRIOR_WEIGHT
        shares_of_ties = _means_of_ties(self._scores[section], self._persisted[section])
        persisted = np.array([shares_of_ties[block].sum() for block in blocks])
        prior = np.interp(knots, [0, 1], PRIOR_SHARES)
        pooled = rising((persisted + PRIOR_WEIGHT * prior) / counts, counts)
        shares: np.ndarray = np.interp(ranks, knots, pooled)
        return shares

    def count(self, detected: PendingDetections, streaks_s: np.ndarray) -> None:
        """Take N detections of a tick; streaks_s: (N,) seconds without a miss of their targets."""
        before = sum(map(len, self._scores))
        while self._pending and detected.stamp_s - self._pending[0].stamp_s > PERSISTENCE_S - 1e-6:
            self._resolve(self._pending.popleft(), detected, streaks_s)
        self._pending.append(detected)
        if before <= TRIAL[1] and sum(map(len, self._scores)) >= TRIAL[0]:
            self.contradicts_scores |= self._are_wrong()

    def _are_wrong(self) -> bool:
        """Return whether scores, taken for probabilities, are far from the shares of right ones."""
        scores, persisted = np.concatenate(self._scores), np.concatenate(self._persisted)
        thirds = np.array_split(np.argsort(scores, kind="stable"), 3)
        persisted = _means_of_ties(scores, persisted)
        right = np.minimum([persisted[third].mean() / self._settled_share for third in thirds], 1)
        means = [scores[third].mean() for third in thirds]
        limit = MOST_DIFFERENCE + MOST_DIFFERENCE_OF_ONE / np.sqrt(len(scores) / 3)
        conclusive = self._settled_share >= LEAST_SETTLED and right[-1] >= LEAST_RIGHT_AT_TOP
        return bool(conclusive and (np.abs(right - means) > limit).any())

    def _resolve(
        self, old: PendingDetections, now: PendingDetections, streaks_s: np.ndarray
    ) -> None:
        """Count which old detections persisted; streaks_s: (N,) of the detections now."""
        unbroken = now.ids[streaks_s > now.stamp_s - old.stamp_s - 1e-6]
        persisted = np.isin(old.ids, unbroken)
        self._settled += [persisted[old.settled].sum(), old.settled.sum()]
        for section in np.unique(old.sections).tolist():
            own = old.sections == section
            for store, new in ((self._scores, old.scores), (self._persisted, persisted)):
                store[section] = np.append(store[section], new[own])[-MOST_STORED:]


def _middle_ranks(all_scores: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Return the ranks (N,), 0 to 1, of (N,) scores among sorted ones; equal scores share one."""
    below, upto = (np.searchsorted(all_scores, scores, side) for side in ("left", "right"))
    ranks: np.ndarray = (below + upto) / (2 * len(all_scores))
    return ranks


def _means_of_ties(scores: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return for each of (N,) values the mean of the values with an equal score.

    With these means it does not matter which block gets which of several equal scores.
    """
    _, which, counts = np.unique(scores, return_inverse=True, return_counts=True)
    means: np.ndarray = (np.bincount(which, values) / counts)[which]
    return means


def rising(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the (N,) values that never fall and fit (N,) values best, by weighted least squares.

    This is isotonic regression by pooling adjacent violators.
    """
    pools: list[tuple[float, float, int]] = []
    for value, weight in zip(values.tolist(), weights.tolist(), strict=True):
        pool = (value, weight, 1)
        while pools and pools[-1][0] > pool[0]:
            last = pools.pop()
            total = last[1] + pool[1]
            pool = ((last[0] * last[1] + pool[0] * pool[1]) / total, total, last[2] + pool[2])
        pools.append(pool)
    return np.repeat([value for value, _, _ in pools], [count for *_, count in pools])
