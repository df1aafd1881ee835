"""A multi-Bernoulli mixture: global hypotheses, each of which says which targets there are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core.jit import compiled
from roadscope.trackers.jpda_existence import Existence
from roadscope.trackers.rows import Rows
from roadscope.trackers.tracklets import Tracklets


@dataclass(frozen=True, slots=True, eq=False)
class Bernoullis(Rows):
    """Local hypotheses: where a target is if it is, and whether it is.

    Many may be of one target, for different histories of detections; they share its id.
    """

    tracks: Tracklets
    existence: Existence

    def __len__(self) -> int:
        return len(self.existence)


@dataclass(frozen=True, slots=True, eq=False)
class Roster(Rows):
    """What the tracker has said of T targets.

    ids: (T,) int64.
    shown, confirmed: (T,) bool, whether they were ever reported, and ever believed.
    """

    ids: np.ndarray
    shown: np.ndarray
    confirmed: np.ndarray

    @staticmethod
    def new(ids: np.ndarray) -> Roster:
        """Begin with targets nothing was said of."""
        never = np.zeros(len(ids), bool)
        return Roster(ids, never, never)


@dataclass(frozen=True, slots=True, eq=False)
class Members(Rows):
    """Which targets hypotheses have, E entries by hypothesis; nobody has most of all targets.

    hypothesis, target, local: (E,) int64, the last the local hypothesis of the target.
    """

    hypothesis: np.ndarray
    target: np.ndarray
    local: np.ndarray

    def __len__(self) -> int:
        return len(self.local)

    @staticmethod
    def nobody() -> Members:
        """Begin with no target."""
        none = np.empty(0, np.int64)
        return Members(none, none, none)

    def of(self, hypotheses: np.ndarray, count: int) -> Members:
        """Keep hypotheses of an index array in this order, out of so many."""
        number = np.full(count, -1)
        number[hypotheses] = np.arange(len(hypotheses))
        kept = self.select(number[self.hypothesis] >= 0)
        kept = replace(kept, hypothesis=number[kept.hypothesis])
        return kept.select(np.argsort(kept.hypothesis, kind="stable"))


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """H hypotheses of T targets with L local hypotheses, in clusters independent of one another.

    cluster: (H,) int64, rising: which targets' hypotheses compete with which.
    log_weights: (H,) of probabilities that sum to 1 in each cluster, falling there.
    members: what each hypothesis has.
    """

    bernoullis: Bernoullis
    roster: Roster
    cluster: np.ndarray
    log_weights: np.ndarray
    members: Members

    @staticmethod
    def empty(nobody: Bernoullis) -> Mixture:
        """Begin with no target."""
        none = np.empty(0, np.int64)
        return Mixture(nobody, Roster.new(none), none, np.empty(0), Members.nobody())

    @property
    def existence(self) -> np.ndarray:
        """(T,) probability of existence over all hypotheses."""
        m = self.members
        there = np.exp(self.log_weights)[m.hypothesis] * self.bernoullis.existence.there[m.local]
        return np.bincount(m.target, there, len(self.roster.ids))

    @property
    def likeliest(self) -> np.ndarray:
        """(T,) of each target the local hypothesis in the likeliest hypothesis that has it."""
        rows = np.empty(len(self.roster.ids), np.int64)
        # Of those written to one place the last one stays: that of the first hypothesis.
        rows[self.members.target[::-1]] = self.members.local[::-1]
        return rows

    @property
    def here(self) -> np.ndarray:
        """(T,) bool, which targets the likeliest hypothesis of their cluster has."""
        best = np.zeros(len(self.cluster), bool)
        best[_starts(self.cluster)] = True
        here = np.zeros(len(self.roster.ids), bool)
        here[self.members.target[best[self.members.hypothesis]]] = True
        return here

    def pruned(self, drop: float, count: int, gap: float) -> Mixture:
        """Keep what matters.

        drop: Bernoullis that exist with less than this probability are left out.
        count, gap: as many hypotheses of a cluster, and none less likely than its likeliest by
            more than this, as a logarithm. Those that now say the same become one.
        """
        strong = self.bernoullis.existence.there >= drop
        members = self.members.select(strong[self.members.local])
        codes = _signatures(self.cluster, members.hypothesis, members.local)
        _, first, same = np.unique(codes, return_index=True, return_inverse=True)
        weights = np.full(len(first), -np.inf)
        np.logaddexp.at(weights, same, self.log_weights)
        order = np.lexsort([first, -weights, self.cluster[first]])
        weights, first = weights[order], first[order]
        starts, sizes = _extents(self.cluster[first])
        rank = np.arange(len(first)) - np.repeat(starts, sizes)
        kept = (rank < count) & (weights >= np.repeat(weights[starts], sizes) - gap)
        weights, first = weights[kept], first[kept]
        cluster = self.cluster[first]
        if len(first):
            starts, sizes = _extents(cluster)
            weights = weights - np.repeat(np.logaddexp.reduceat(weights, starts), sizes)
        members = members.of(first, len(self.cluster))
        return Mixture(self.bernoullis, self.roster, cluster, weights, members)._split()._compact()

    def _split(self) -> Mixture:
        """Give a target on which all hypotheses of its cluster agree a cluster of its own."""
        m, T = self.members, len(self.roster.ids)
        if not len(self.cluster):
            return self
        _, sizes = _extents(self.cluster)
        alike = np.repeat(sizes, sizes)
        least, most = np.full(T, len(self.bernoullis)), np.full(T, -1)
        np.minimum.at(least, m.target, m.local)
        np.maximum.at(most, m.target, m.local)
        needed = np.zeros(T, np.int64)
        needed[m.target] = alike[m.hypothesis]
        agreed = (least == most) & (np.bincount(m.target, minlength=T) == needed)
        # What is left of a cluster with one hypothesis says nothing any more.
        left, alone = np.flatnonzero(alike > 1), np.flatnonzero(agreed)
        kept = m.select(~agreed[m.target]).of(left, len(self.cluster))
        settled = Members(len(left) + np.arange(len(alone)), alone, least[alone])
        number = np.cumsum(np.diff(self.cluster[left], prepend=-1) != 0) - 1
        after = number.max(initial=-1) + 1 + np.arange(len(alone))
        return Mixture(
            self.bernoullis, self.roster, np.concatenate([number, after]),
            np.concatenate([self.log_weights[left], np.zeros(len(alone))]), kept.joined(settled),
        )  # fmt: skip

    def _compact(self) -> Mixture:
        """Forget local hypotheses, and targets, that no hypothesis has."""
        m = self.members
        known, used = np.zeros(len(self.roster.ids), bool), np.zeros(len(self.bernoullis), bool)
        known[m.target], used[m.local] = True, True
        members = Members(
            m.hypothesis, (np.cumsum(known) - 1)[m.target], (np.cumsum(used) - 1)[m.local]
        )
        return replace(
            self, bernoullis=self.bernoullis.select(used), roster=self.roster.select(known),
            members=members,
        )  # fmt: skip


def _starts(cluster: np.ndarray) -> np.ndarray:
    """Return (C,) the first row of each cluster."""
    return np.flatnonzero(np.diff(cluster, prepend=-1))


def _extents(cluster: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (C,) the first row of each cluster and its number of rows."""
    starts = _starts(cluster)
    return starts, np.diff(np.append(starts, len(cluster)))


@compiled()
def _signatures(cluster: np.ndarray, hypothesis: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Return (H,) uint64, the same where hypotheses of one cluster have the same members.

    A sum of scattered numbers (SplitMix64, Steele, Lea and Flood 2014), one of each member: by
    chance two of a million hypotheses have the same in one of ten million ticks.
    """
    found = np.empty(len(cluster), np.uint64)
    for h in range(len(cluster)):
        found[h] = _scattered(np.uint64(2 * cluster[h]))
    for k in range(len(local)):
        found[hypothesis[k]] += _scattered(np.uint64(2 * local[k] + 1))
    return found


@compiled()
def _scattered(value: np.uint64) -> np.uint64:
    z = (value + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
