"""Tracks: what a tracker reports at one tick."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.detections import Detections, check_boxes
from roadscope.core.pose import Pose, wrap_angle
from roadscope.core.record import Record


class TrackState(IntEnum):
    """State of a track; records store it as int8.

    Tentative: not yet confirmed by enough detections. Coasting: predicted without a detection.
    """

    TENTATIVE = 0
    CONFIRMED = 1
    COASTING = 2


@dataclass(frozen=True, slots=True, eq=False)
class Tracks(Record):
    """The tracks of one tick.

    ids: (N,) int64, unique within the record, never used again for another track.
    centres: (N, 3) float64, metres.
    sizes: (N, 3) float64, metres, length width height.
    yaws: (N,) float64, radians, direction of the length axis. It points to the front of the object
        if the tracker knows it; of an object that never moved, it may point to the back.
    velocities: (N, 2) float64, m/s, along the axes of `frame`; in frame `ego` relative to
        the moving ego.
    covariances: (N, 4, 4) float64 of (x, y, vx, vy).
    categories: (N,) int8, values of `Category`.
    scores: (N,) float64 in 0 to 1.
    states: (N,) int8, values of `TrackState`.
    frame: the coordinate frame, `ego` or `world`.
    stamp_s: seconds since reset.
    """

    ids: np.ndarray
    centres: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    velocities: np.ndarray
    covariances: np.ndarray
    categories: np.ndarray
    scores: np.ndarray
    states: np.ndarray
    frame: str
    stamp_s: float

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            ids=(np.int64, ("N",)),
            centres=(np.float64, ("N", 3)),
            sizes=(np.float64, ("N", 3)),
            yaws=(np.float64, ("N",)),
            velocities=(np.float64, ("N", 2)),
            covariances=(np.float64, ("N", 4, 4)),
            categories=(np.int8, ("N",)),
            scores=(np.float64, ("N",)),
            states=(np.int8, ("N",)),
        )
        rising = bool((self.ids[1:] > self.ids[:-1]).all())  # The usual case, and a fast check.
        unique = rising or len(np.unique(self.ids)) == len(self.ids)
        require(unique, self, "ids", "unique ids", self.ids.tolist())
        check_boxes(self, self.sizes, self.categories, self.scores)
        valid = (self.states >= 0) & (self.states < len(TrackState))
        require(
            bool(valid.all()),
            self,
            "states",
            f"values of TrackState, 0 to {max(TrackState)}",
            self.states[~valid][:1].tolist(),
        )

    def __len__(self) -> int:
        return len(self.ids)

    @staticmethod
    def empty(stamp_s: float, frame: str = "ego") -> Tracks:
        """Return no tracks."""
        none, three = np.empty(0), np.empty((0, 3))
        return Tracks(
            np.empty(0, np.int64),
            three,
            three,
            none,
            np.empty((0, 2)),
            np.empty((0, 4, 4)),
            np.empty(0, np.int8),
            none,
            np.empty(0, np.int8),
            frame,
            stamp_s,
        )

    @staticmethod
    def of(detections: Detections, ids: np.ndarray) -> Tracks:
        """Return detections as confirmed tracks with velocity 0 and variances of 1.

        For trackers that estimate neither velocities nor covariances. ids: (N,) int64.
        """
        n = len(detections)
        return Tracks(
            ids,
            detections.centres,
            detections.sizes,
            detections.yaws,
            np.zeros((n, 2)),
            np.tile(np.eye(4), (n, 1, 1)),
            detections.categories,
            detections.scores,
            np.full(n, TrackState.CONFIRMED, np.int8),
            detections.frame,
            detections.stamp_s,
        )

    def select(self, index: np.ndarray) -> Tracks:
        """Return the rows that a mask or an index array selects."""
        return self._trusted(
            ids=self.ids[index],
            centres=self.centres[index],
            sizes=self.sizes[index],
            yaws=self.yaws[index],
            velocities=self.velocities[index],
            covariances=self.covariances[index],
            categories=self.categories[index],
            scores=self.scores[index],
            states=self.states[index],
        )

    @property
    def sure(self) -> Tracks:
        """The tracks that are not tentative."""
        sure = self.states != TrackState.TENTATIVE
        return self if sure.all() else self.select(sure)

    def moved(self, a_from_b: Pose, frame: str) -> Tracks:
        """Map the tracks from frame b into frame a; `frame` is the name of frame a.

        Velocities are only rotated: the motion of the frames relative to each other is not added.
        """
        turn = np.kron(np.eye(2), a_from_b.rotation[:2, :2])
        return self._trusted(
            centres=a_from_b.apply(self.centres),
            yaws=wrap_angle(self.yaws + a_from_b.yaw),
            velocities=self.velocities @ a_from_b.rotation[:2, :2].T,
            covariances=turn @ self.covariances @ turn.T,
            frame=frame,
        )
