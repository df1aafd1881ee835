"""The tracker to take, and once more over its tracks when all frames are known."""

from __future__ import annotations

from collections.abc import Sequence

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.existence import ExistenceTracker
from roadscope.trackers.offline import rescored
from roadscope.trackers.offline_noise import MotionNoise


class ExistenceOfflineTracker(ExistenceTracker):
    """`ExistenceTracker` online, to the last bit; `rescored` is not online."""

    offline = True
    weighed = False
    """`rescored` drops weak tracks and leaves none tentative."""

    def reset(self) -> None:
        """Forget all tracks."""
        super().reset()
        self._noises: dict[float, MotionNoise] = {}

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Do as the online tracker, and remember what it takes motion and lasting errors to be."""
        tracks = super().update(detections, ego_pose)
        walks, drifts = self._targets.wandering(self._traits)
        passing = self._targets.beliefs.covariances[:, :2, :2]
        lasting = tracks.covariances[:, :2, :2] - passing
        self._noises[tracks.stamp_s] = MotionNoise(walks, drifts, lasting)
        return tracks

    def rescored(self, history: Sequence[Tracks]) -> list[Tracks]:
        """Smooth, fill, join and weed out, with one score for each whole track.

        history: what `update` returned since the last reset.
        """
        none = MotionNoise.alike(0, 0.0)
        told = [self._noises.get(tracks.stamp_s, none) for tracks in history]
        known = all(len(n) == len(t) for n, t in zip(told, history, strict=True))
        return rescored(history, noises=told if known else None)
