"""What other libraries' trackers leave to us: frames, families, boxes, identities.

All of them follow points or boxes in a plane that stands still. Here it is the world seen from
above, in metres and seconds (without the ego's pose, the ego frame). Each family of road users has
a tracker of its own, as is the custom where a library knows no classes.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from roadscope.core import Detections, Family, Pose, Tracks
from roadscope.trackers.gating import FAMILIES
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.life_cycle import told_states
from roadscope.trackers.settings import check_counts
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What a library says of its N tracks after a tick, tentative and unseen ones too.

    keys: the library's names for them, never given again.
    beliefs: of x, y, vx, vy.
    rows: (N,) int, the detection that each took, -1 for none; new ones have one.
    confirmed: (N,) bool, which the library answers for when they are seen.
    """

    keys: Sequence[Hashable]
    beliefs: Gaussians
    rows: np.ndarray
    confirmed: np.ndarray

    @staticmethod
    def of(tracks: Sequence[tuple[Hashable, np.ndarray, np.ndarray, int, bool]]) -> Told:
        """Gather key, mean, covariance, row and whether it is confirmed of each."""
        n = len(tracks)
        keys, means, covariances, rows, confirmed = zip(*tracks, strict=True) if n else [()] * 5
        beliefs = Gaussians(np.reshape(means, (n, 4)), np.reshape(covariances, (n, 4, 4)))
        return Told(keys, beliefs, np.array(rows, np.int64), np.array(confirmed, bool))


class Library(Protocol):
    """One tracker of a library, started afresh."""

    def follow(self, targets: Detections, period_s: float) -> Told:
        """Take the detections of a tick, so long after the last one."""


class Adapter:
    """Runs a library's tracker for each family and reports as ours do.

    Between ticks it remembers of each track what the library does not: height, size and heading of
    the last detection, category, score, and how long ago that was.
    """

    def __init__(self, start: Callable[[Family], Library], shown_misses: int) -> None:
        """Take what starts a library's tracker for a family.

        shown_misses: ticks without a detection in which a confirmed track is still answered for.
        """
        check_counts(0, shown_misses=shown_misses)
        self._start, self._shown_misses = start, shown_misses
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._libraries = {family: self._start(family) for family in Family}
        self._tracks = Tracklets.empty(4)
        self._rows: dict[Hashable, int] = {}
        self._next_id = 0

    def update(self, detections: Detections, ego_pose: Pose | None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        told = self._asked(tick)
        old = np.array([i for i, key in enumerate(told.keys) if key in self._rows], np.int64)
        born = np.setdiff1d(np.arange(len(told.keys)), old)
        rows = np.array([self._rows[told.keys[i]] for i in old], np.int64)
        tracks = self._tracks.select(rows).moved_on(told.beliefs.select(old))
        seen = np.flatnonzero(told.rows[old] >= 0)
        found = tick.targets.select(told.rows[old][seen])
        tracks = tracks.seen(seen, found, tracks.beliefs.select(seen))
        new = tick.targets.select(told.rows[born])
        opened = Tracklets.opened(self._next_id, new, told.beliefs.select(born))
        self._tracks = tracks.joined(opened)
        self._next_id += len(born)
        order = np.concatenate([old, born])
        self._rows = {told.keys[i]: row for row, i in enumerate(order)}
        states = told_states(told.confirmed[order], self._tracks.misses, self._shown_misses)
        return self._tracks.report(self._tracks.beliefs, states, tick.frame, tick.stamp_s)

    def _asked(self, tick: Tick) -> Told:
        """Put what all families' trackers say below each other."""
        families = FAMILIES[tick.targets.categories]
        answers = []
        for number, (family, library) in enumerate(self._libraries.items()):
            index = np.flatnonzero(families == number)
            told = library.follow(tick.targets.select(index), tick.period_s)
            rows = np.append(index, -1)[told.rows]
            keys = [(family, key) for key in told.keys]
            answers.append(Told(keys, told.beliefs, rows, told.confirmed))
        beliefs = answers[0].beliefs
        for answer in answers[1:]:
            beliefs = beliefs.joined(answer.beliefs)
        return Told(
            [key for answer in answers for key in answer.keys],
            beliefs,
            np.concatenate([answer.rows for answer in answers]),
            np.concatenate([answer.confirmed for answer in answers]),
        )
