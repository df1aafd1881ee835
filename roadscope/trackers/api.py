"""What a tracker is.

Online is what `update` answers, and nothing else: what it says of a tick rests on that tick and
those before. A tracker whose class says `offline = True` is an offline one: once an episode is
over, its `rescored` is given all that `update` answered and tells every tick anew, with later
ones at hand. Boards run `rescored` of such classes only and call their figures offline; without
that mark it is never called, so that no online figure can contain it.

What counts are tracks that are not tentative. A tracker whose class says `weighed = True` scores
tentative ones, too, by how likely they are there. On recorded traffic sAMOTA, which asks for
tracks of every sureness, takes all of its tracks, of others those that are not tentative. On
simulated traffic, and so in `roadscope run`, averages over recall leave tentative ones out of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol, runtime_checkable

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


@runtime_checkable
class OfflineTracker(Tracker, Protocol):
    """A tracker that goes over its tracks again when all frames are known."""

    offline: ClassVar[bool]

    def rescored(self, history: Sequence[Tracks]) -> Sequence[Tracks]:
        """Tell an episode anew, as many records as there were, of the same stamps.

        history: what `update` answered from the reset on, tentative tracks included; it and
            what `update` would answer next stay as they are.
        """


def is_weighed(kind: Any) -> bool:
    """Say whether a tracker's class says that scores of its tentative tracks mean something."""
    return bool(getattr(kind, "weighed", False))


def is_offline(kind: Any) -> bool:
    """Say whether a tracker's class calls itself offline."""
    return bool(getattr(kind, "offline", False))
