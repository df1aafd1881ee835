"""A multi-Bernoulli mixture: global hypotheses, each of which says which targets there are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Detections
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
    """H global hypotheses of T targets with L local hypotheses.

    members: (H, T) int64, the local hypothesis of each target, -1 where there is no such target.
    log_weights: (H,) of probabilities that sum to 1, falling.
    """

    bernoullis: Bernoullis
    roster: Roster
    members: np.ndarray
    log_weights: np.ndarray

    @staticmethod
    def empty(nobody: Bernoullis) -> Mixture:
        """Begin with one hypothesis: that no target is known."""
        roster = Roster.new(np.empty(0, np.int64))
        return Mixture(nobody, roster, np.empty((1, 0), np.int64), np.zeros(1))

    @property
    def existence(self) -> np.ndarray:
        """(T,) probability of existence over all hypotheses."""
        there = np.append(self.bernoullis.existence.there, 0.0)
        shares: np.ndarray = np.exp(self.log_weights) @ there[self.members]
        return shares

    @property
    def likeliest(self) -> np.ndarray:
        """(T,) of each target the local hypothesis in the likeliest hypothesis that has it."""
        first = (self.members >= 0).argmax(axis=0)
        rows: np.ndarray = self.members[first, np.arange(self.members.shape[1])]
        return rows

    def with_newborn(self, newborn: Bernoullis, free: np.ndarray) -> Mixture:
        """Add targets that exist only where their detections are no one else's, (H, B) bool."""
        rows = np.where(free, len(self.bernoullis) + np.arange(len(newborn)), -1)
        return Mixture(
            self.bernoullis.joined(newborn),
            self.roster.joined(Roster.new(newborn.tracks.ids)),
            np.column_stack([self.members, rows]),
            self.log_weights,
        )

    def pruned(self, drop: float, count: int, gap: float) -> Mixture:
        """Keep what matters.

        drop: Bernoullis that exist with less than this probability are left out.
        count, gap: as many hypotheses, and no less likely than the likeliest by more than this,
            as a logarithm. Those that now say the same become one.
        """
        weak = np.append(self.bernoullis.existence.there < drop, True)
        members = np.where(weak[self.members], -1, self.members)
        known = np.any(members >= 0, axis=0)
        members, same = np.unique(members[:, known], axis=0, return_inverse=True)
        weights = np.full(len(members), -np.inf)
        np.logaddexp.at(weights, same.ravel(), self.log_weights)
        order = np.argsort(-weights, kind="stable")[:count]
        order = order[weights[order] >= weights[order[0]] - gap]
        weights = weights[order] - np.logaddexp.reduce(weights[order])
        return replace(
            self, roster=self.roster.select(known), members=members[order], log_weights=weights
        )._compact()

    def _compact(self) -> Mixture:
        """Forget local hypotheses, and targets, that no global one has."""
        known = np.any(self.members >= 0, axis=0)
        members = self.members[:, known]
        used, index = np.unique(members, return_inverse=True)
        index = index.reshape(members.shape) - int(used.size > 0 and used[0] < 0)
        return replace(
            self, bernoullis=self.bernoullis.select(used[used >= 0]),
            roster=self.roster.select(known), members=index,
        )  # fmt: skip


def free_detections(columns: np.ndarray, targets: Detections) -> np.ndarray:
    """Return (H, M) bool, which detections no target has; columns: (H, T), -1 for none."""
    taken = np.zeros((len(columns), len(targets) + 1), bool)
    np.put_along_axis(taken, columns, True, axis=1)
    free: np.ndarray = ~taken[:, : len(targets)]
    return free
