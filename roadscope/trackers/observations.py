"""What tracks remember of their detections, beside what a filter made of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Detections
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.rows import Rows
from roadscope.trackers.tracklets import boxes_of


@dataclass(frozen=True, slots=True, eq=False)
class Observations(Rows):
    """The memory of N tracks.

    boxes: (N, 7) the last detection's.
    places: (N, K, 2) x and y in the last K ticks, the newest last, nan where there was none.
    directions: (N, 2) unit vectors in which they were seen to move, 0 where unknown.
    beliefs: right after the last detection.
    stamps: (N,) of the last detection, seconds.
    """

    boxes: np.ndarray
    places: np.ndarray
    directions: np.ndarray
    beliefs: Gaussians
    stamps: np.ndarray

    @staticmethod
    def opened(targets: Detections, beliefs: Gaussians, ticks: int) -> Observations:
        """Begin with one detection each, to be remembered for K ticks beyond its own."""
        n = len(targets)
        places = np.full((n, ticks + 1, 2), np.nan)
        places[:, -1] = targets.centres[:, :2]
        stamps = np.full(n, targets.stamp_s)
        return Observations(boxes_of(targets), places, np.zeros((n, 2)), beliefs, stamps)

    def moved_on(self) -> Observations:
        """Come to the next tick."""
        unseen = np.full((len(self.boxes), 1, 2), np.nan)
        return replace(self, places=np.concatenate([self.places[:, 1:], unseen], axis=1))

    def seen(
        self, rows: np.ndarray, targets: Detections, beliefs: Gaussians, moving_m: float
    ) -> Observations:
        """Give the rows of an index array one detection each.

        moving_m: the least distance that makes a direction.
        """
        before = self.select(rows)
        places = before.places.copy()
        places[:, -1] = targets.centres[:, :2]
        after = Observations(
            boxes_of(targets), places, units(places[:, -1] - before.anchors, moving_m),
            beliefs, np.full(len(rows), targets.stamp_s),
        )  # fmt: skip
        return self.replaced(rows, after)

    @property
    def anchors(self) -> np.ndarray:
        """(N, 2) the oldest place remembered; where all are forgotten, the last there was."""
        known = ~np.isnan(self.places[..., 0])
        oldest = self.places[np.arange(len(known)), known.argmax(axis=1)]
        anchors: np.ndarray = np.where(known.any(axis=1)[:, None], oldest, self.boxes[:, :2])
        return anchors


def units(vectors: np.ndarray, least: float) -> np.ndarray:
    """Return (..., 2) vectors of length 1, or of 0 where they were shorter than `least`."""
    lengths = np.hypot(vectors[..., 0], vectors[..., 1])[..., None]
    long = lengths >= max(least, 1e-9)
    made: np.ndarray = np.where(long, vectors / np.where(long, lengths, 1.0), 0.0)
    return made


def agreement(directions: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return (P,) how well (P, 2) directions agree, unit vectors or 0.

    1/2 straight on, -1/2 straight back, 0 aside and where either is unknown.
    """
    along = (directions * others).sum(axis=1)
    across = directions[:, 0] * others[:, 1] - directions[:, 1] * others[:, 0]
    known = (along != 0) | (across != 0)
    agreed: np.ndarray = np.where(known, 0.5 - np.arctan2(np.abs(across), along) / np.pi, 0.0)
    return agreed
