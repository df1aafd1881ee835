"""A multi-Bernoulli mixture: global hypotheses, each of which says which targets there are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

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
class Mixture:
    """H hypotheses of T targets with L local hypotheses, in clusters independent of one another.

    cluster: (H,) int64, rising: which targets' hypotheses compete with which.
    members: (H, T) int64, the local hypothesis of each target; -1 where a hypothesis has no such
        target, or where it is in another cluster.
    log_weights: (H,) of probabilities that sum to 1 in each cluster, falling there.
    """

    bernoullis: Bernoullis
    roster: Roster
    cluster: np.ndarray
    members: np.ndarray
    log_weights: np.ndarray

    @staticmethod
    def empty(nobody: Bernoullis) -> Mixture:
        """Begin with no target."""
        none = np.empty(0, np.int64)
        return Mixture(nobody, Roster.new(none), none, np.empty((0, 0), np.int64), np.empty(0))

    @property
    def existence(self) -> np.ndarray:
        """(T,) probability of existence over all hypotheses."""
        there = np.append(self.bernoullis.existence.there, 0.0)
        shares: np.ndarray = np.exp(self.log_weights) @ there[self.members]
        return shares

    @property
    def likeliest(self) -> np.ndarray:
        """(T,) of each target the local hypothesis in the likeliest hypothesis that has it."""
        if not len(self.members):
            return np.empty(0, np.int64)
        first = (self.members >= 0).argmax(axis=0)
        rows: np.ndarray = self.members[first, np.arange(self.members.shape[1])]
        return rows

    @property
    def here(self) -> np.ndarray:
        """(T,) bool, which targets the likeliest hypothesis of their cluster has."""
        best = self.members[_starts(self.cluster)]
        here: np.ndarray = np.any(best >= 0, axis=0)
        return here

    def with_newborn(self, newborn: Bernoullis, free: np.ndarray) -> Mixture:
        """Add targets that exist only in hypotheses where their detections are free, (H, B)."""
        rows = np.where(free, len(self.bernoullis) + np.arange(len(newborn)), -1)
        return replace(
            self,
            bernoullis=self.bernoullis.joined(newborn),
            roster=self.roster.joined(Roster.new(newborn.tracks.ids)),
            members=np.column_stack([self.members, rows]),
        )

    def pruned(self, drop: float, count: int, gap: float) -> Mixture:
        """Keep what matters.

        drop: Bernoullis that exist with less than this probability are left out.
        count, gap: as many hypotheses of a cluster, and none less likely than its likeliest by
            more than this, as a logarithm. Those that now say the same become one.
        """
        weak = np.append(self.bernoullis.existence.there < drop, True)
        members = np.where(weak[self.members], -1, self.members)
        first, same = _alike(self.cluster, members)
        weights = np.full(len(first), -np.inf)
        np.logaddexp.at(weights, same, self.log_weights)
        order = np.lexsort([first, -weights, self.cluster[first]])
        weights, first = weights[order], first[order]
        starts = _starts(self.cluster[first])
        sizes = np.diff(np.append(starts, len(first)))
        rank = np.arange(len(first)) - np.repeat(starts, sizes)
        kept = (rank < count) & (weights >= np.repeat(weights[starts], sizes) - gap)
        weights, first = weights[kept], first[kept]
        cluster = self.cluster[first]
        if len(first):
            starts = _starts(cluster)
            sizes = np.diff(np.append(starts, len(first)))
            weights = weights - np.repeat(np.logaddexp.reduceat(weights, starts), sizes)
        return (
            replace(self, cluster=cluster, members=members[first], log_weights=weights)
            ._split()
            ._compact()
        )

    def _split(self) -> Mixture:
        """Give a target on which all hypotheses of its cluster agree a cluster of its own."""
        if not len(self.members):
            return self
        starts = _starts(self.cluster)
        sizes = np.diff(np.append(starts, len(self.cluster)))
        least = np.minimum.reduceat(self.members, starts, axis=0)
        agreed = (least >= 0) & (least == np.maximum.reduceat(self.members, starts, axis=0))
        members = np.where(np.repeat(agreed, sizes, axis=0), -1, self.members)
        # What is left of a cluster with one hypothesis says nothing any more.
        left = np.repeat(sizes > 1, sizes)
        target = np.nonzero(agreed)[1]
        alone = np.full((len(target), members.shape[1]), -1)
        alone[np.arange(len(target)), target] = least[agreed]
        number = np.concatenate(
            [self.cluster[left], self.cluster.max() + 1 + np.arange(len(target))]
        )
        return replace(
            self,
            cluster=np.unique(number, return_inverse=True)[1],
            members=np.concatenate([members[left], alone]),
            log_weights=np.concatenate([self.log_weights[left], np.zeros(len(target))]),
        )

    def _compact(self) -> Mixture:
        """Forget local hypotheses, and targets, that no hypothesis has."""
        known = np.any(self.members >= 0, axis=0)
        members = self.members[:, known]
        used, index = np.unique(members, return_inverse=True)
        index = index.reshape(members.shape) - int(used.size > 0 and used[0] < 0)
        return replace(
            self, bernoullis=self.bernoullis.select(used[used >= 0]),
            roster=self.roster.select(known), members=index,
        )  # fmt: skip


def free_detections(cluster: np.ndarray, columns: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Return (H, M) bool, which detections of its cluster a hypothesis gives to no target.

    columns: (H, T), -1 for none; owner: (M,) the cluster of each detection.
    """
    taken = np.zeros((len(columns), len(owner) + 1), bool)
    np.put_along_axis(taken, columns, True, axis=1)
    free: np.ndarray = ~taken[:, : len(owner)] & (cluster[:, None] == owner)
    return free


def _starts(cluster: np.ndarray) -> np.ndarray:
    """Return (C,) the first row of each cluster."""
    return np.flatnonzero(np.diff(cluster, prepend=-1))


def _alike(cluster: np.ndarray, members: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first of all rows that say the same, and (H,) which of these each is.

    Rows are told apart by 64-bit sums with weights drawn once: far quicker than row by row.
    """
    weights = np.random.default_rng(0).integers(1, 2**63, members.shape[1] + 1, np.uint64)
    table = np.column_stack([cluster, members]).astype(np.uint64)
    _, first, same = np.unique(table @ weights, return_index=True, return_inverse=True)
    return first, same
