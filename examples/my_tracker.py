"""A tracker of your own in one file.

Try it:  roadscope leaderboard tracking --entry examples/my_tracker.py:LastSeen
"""

import numpy as np

from roadscope import Detections, Pose, Tracks, TrackState


class LastSeen:
    """Gives a detection the identity of the closest detection of the last frame."""

    kind = "tracker"

    def __init__(self, *, gate_m: float = 3.0) -> None:
        self.gate_m = gate_m
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.centres = np.empty((0, 3))
        self.ids = np.empty(0, dtype=np.int64)
        self.next_id = 0

    def update(self, detections: Detections, ego_pose: Pose | None) -> Tracks:
        """Match to the last frame, in the world frame when the ego's pose is known."""
        if ego_pose is not None:
            detections = detections.moved(ego_pose, "world")
        ids = np.array([self.identity(centre) for centre in detections.centres], dtype=np.int64)
        ids = self.without_repeats(ids)
        self.centres, self.ids = detections.centres, ids
        n = len(ids)
        return Tracks(
            ids=ids,
            centres=detections.centres,
            sizes=detections.sizes,
            yaws=detections.yaws,
            velocities=np.zeros((n, 2)),
            covariances=np.tile(np.eye(4), (n, 1, 1)),
            categories=detections.categories,
            scores=detections.scores,
            states=np.full(n, TrackState.CONFIRMED),
            frame=detections.frame,
            stamp_s=detections.stamp_s,
        )

    def identity(self, centre: np.ndarray) -> int:
        """Return the id of the nearest detection of the last frame within the gate, or -1."""
        distances = np.linalg.norm(self.centres - centre, axis=1)
        if len(distances) and distances.min() < self.gate_m:
            return int(self.ids[distances.argmin()])
        return -1

    def without_repeats(self, ids: np.ndarray) -> np.ndarray:
        """Give a new id to every detection that has none or shares one with an earlier one."""
        _, first = np.unique(ids, return_index=True)
        new = np.ones(len(ids), dtype=bool)
        new[first] = ids[first] < 0
        ids[new] = self.next_id + np.arange(new.sum())
        self.next_id += int(new.sum())
        return ids
