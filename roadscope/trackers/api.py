"""The protocol of trackers.

What `update` returns is online: it depends on that tick and those before. A tracker whose class
has `offline = True` is an offline one: when an episode is over, its `rescored` gets all that
`update` returned and returns the tracks of every tick again, now knowing the later ones. Boards
call `rescored` of such classes only and label their figures offline. Online figures never use it.

Tentative tracks do not count, with one exception. A tracker whose class has `weighed = True` also
gives them scores that say how likely they exist. sAMOTA on recorded traffic needs tracks of all
scores: it takes all tracks of such a tracker, but only the tracks of others that are not
tentative. On simulated traffic, and so in `roadscope run`, averages over recall leave out all
tentative tracks.
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

        history: what `update` returned since the reset, tentative tracks included. `rescored` must
            change neither this history nor what `update` returns next.
        """


def is_offline(kind: Any) -> bool:
    """Return whether a tracker is an offline one; kind: its class, or an instance."""
    return bool(getattr(kind, "offline", False))
