"""The tracker to take, and once more over its tracks when all frames are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.existence import ExistenceTracker
from roadscope.trackers.offline import rescored


class ExistenceOfflineTracker(ExistenceTracker):
    """`ExistenceTracker` online, to the last bit; `rescored` is not online."""

    offline = True
    weighed = False
    """`rescored` drops weak tracks and leaves none tentative."""

    def reset(self) -> None:
        """Forget all tracks."""
        super().reset()
        self._offsets: dict[float, np.ndarray] = {}

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Do as the online tracker, and remember which errors last."""
        tracks = super().update(detections, ego_pose)
        passing = self._targets.beliefs.covariances[:, :2, :2]
        self._offsets[tracks.stamp_s] = tracks.covariances[:, :2, :2] - passing
        return tracks

    def rescored(self, history: Sequence[Tracks]) -> list[Tracks]:
        """Smooth, fill, join and weed out, with one score for each whole track.

        history: what `update` returned since the last reset.
        """
        none = np.empty((0, 2, 2))
        told = [self._offsets.get(tracks.stamp_s, none) for tracks in history]
        known = all(len(o) == len(t) for o, t in zip(told, history, strict=True))
        return rescored(history, offsets=told if known else None)
