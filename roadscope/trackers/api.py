"""The protocol of trackers.

What `update` returns is online: it depends on that tick and those before. A tracker whose class
has `offline = True` is an offline one: when an episode is over, its `rescored` gets all that
`update` returned and returns every tick again, with later ones at hand. Boards call `rescored` of
such classes only and call their figures offline, so no online figure can contain it.

Tentative tracks do not count. But a tracker whose class has `weighed = True` gives them scores,
too, that say how likely they exist: on recorded traffic sAMOTA, which needs tracks of all scores,
takes all tracks of such a tracker, and those that are not tentative of others. On simulated
traffic, and so in `roadscope run`, averages over recall leave out all tentative tracks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol, runtime_checkable

from roadscope.core import Detections, Pose, Tracks


@runtime_checkable
class Tracker(Protocol):
    """Tracks road users from frame to frame.

    Constructor arguments are keyword-only and all have defaults.
    """

    def reset(self) -> None:
        """Forget all tracks."""

    def update(self, detections: Detections, ego_pose: Pose | None) -> Tracks:
        """Return the tracks after the detections of one tick, which are in the ego frame.

        ego_pose: `world_from_ego` at the stamp, or None if it is unknown. Tracks are in the ego
            frame or, if the pose is known, in the world frame, as `Tracks.frame` says.
        """


@runtime_checkable
class OfflineTracker(Tracker, Protocol):
    """A tracker that improves its tracks when all frames are known."""

    offline: ClassVar[bool]

    def rescored(self, history: Sequence[Tracks]) -> Sequence[Tracks]:
        """Return the tracks of a whole episode again: as many records, with the same stamps.

        history: what `update` returned since the reset, tentative tracks included; it must not
            change, nor what `update` would return next.
        """


def is_offline(kind: Any) -> bool:
    """Return whether a tracker's class is an offline one."""
    return bool(getattr(kind, "offline", False))
