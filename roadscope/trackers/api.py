"""What a tracker is."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from roadscope.core import Detections, Pose, Tracks


@runtime_checkable
class Tracker(Protocol):
    """Follows road users from frame to frame.

    Constructor arguments are keyword-only and all have defaults.
    """

    def reset(self) -> None:
        """Forget all tracks."""

    def update(self, detections: Detections, ego_pose: Pose | None) -> Tracks:
        """Take the detections of one tick, ego frame, and return the tracks at their stamp.

        ego_pose: `world_from_ego` at the stamp, or None when unknown. Tracks come back in the
        ego frame or, when the pose is known, in the world frame, as `Tracks.frame` says.
        """
