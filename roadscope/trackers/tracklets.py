"""All targets that a tracker follows, as one table."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Detections, Tracks
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.rows import Rows


@dataclass(frozen=True, slots=True, eq=False)
class Tracklets(Rows):
    """N targets; frames and units of the detections they come from.

    ids: (N,) int64.
    beliefs: (N, D) means and their covariances; the first two of D are x and y.
    heights, sizes, yaws: (N,), (N, 3), (N,): z of the centre, the box and its heading.
    categories: (N,) int8, values of `Category`.
    scores: (N,) 0 to 1.
    hits: (N,) detections so far.
    misses: (N,) ticks since the last detection.
    ages: (N,) ticks since the first.
    """

    ids: np.ndarray
    beliefs: Gaussians
    heights: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    categories: np.ndarray
    scores: np.ndarray
    hits: np.ndarray
    misses: np.ndarray
    ages: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    @staticmethod
    def empty(dimensions: int) -> Tracklets:
        """Return no targets whose beliefs have D dimensions."""
        return Tracklets.opened(0, Detections.empty(0.0), Gaussians.empty(dimensions))

    @staticmethod
    def opened(first_id: int, targets: Detections, beliefs: Gaussians) -> Tracklets:
        """Begin to follow N detections, with ids from `first_id` on."""
        n = len(targets)
        none = np.zeros(n, np.int64)
        return Tracklets(
            first_id + np.arange(n), beliefs,
            targets.centres[:, 2], targets.sizes, targets.yaws,
            targets.categories, targets.scores, none + 1, none, none,
        )  # fmt: skip

    @property
    def places(self) -> np.ndarray:
        """(N, 2) x and y, metres."""
        return self.beliefs.means[:, :2]

    @property
    def boxes(self) -> np.ndarray:
        """(N, 7) centre x y z, length width height, yaw, as the kernels of overlap take them."""
        return np.column_stack([self.places, self.heights, self.sizes, self.yaws])

    def moved_on(self, beliefs: Gaussians) -> Tracklets:
        """Come to the next tick, where they are believed to be as given."""
        return replace(self, beliefs=beliefs, misses=self.misses + 1, ages=self.ages + 1)

    def seen(self, rows: np.ndarray, targets: Detections, beliefs: Gaussians) -> Tracklets:
        """Give the rows of an index array one detection and one new belief each."""

        def put(value: np.ndarray, into: np.ndarray | int) -> np.ndarray:
            changed = value.copy()
            changed[rows] = into
            return changed

        return Tracklets(
            self.ids, self.beliefs.replaced(rows, beliefs),
            put(self.heights, targets.centres[:, 2]), put(self.sizes, targets.sizes),
            put(self.yaws, targets.yaws), put(self.categories, targets.categories),
            put(self.scores, targets.scores),
            put(self.hits, self.hits[rows] + 1), put(self.misses, 0), self.ages,
        )  # fmt: skip

    def report(self, planar: Gaussians, states: np.ndarray, frame: str, stamp_s: float) -> Tracks:
        """Return them as tracks; planar: beliefs of x, y, vx, vy; states: `TrackState`."""
        return Tracks(
            self.ids, np.column_stack([planar.means[:, :2], self.heights]), self.sizes, self.yaws,
            planar.means[:, 2:], planar.covariances, self.categories, self.scores, states,
            frame, stamp_s,
        )  # fmt: skip


def boxes_of(detections: Detections) -> np.ndarray:
    """Return (N, 7) centre x y z, length width height, yaw."""
    return np.column_stack([detections.centres, detections.sizes, detections.yaws])
