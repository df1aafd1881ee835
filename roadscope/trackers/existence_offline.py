"""The tracker to take, and once more over its tracks when all frames are known."""

from __future__ import annotations

from collections.abc import Sequence

from roadscope.core import Tracks
from roadscope.trackers.existence import ExistenceTracker
from roadscope.trackers.offline import rescored


class ExistenceOfflineTracker(ExistenceTracker):
    """`ExistenceTracker` online, to the last bit; `rescored` is not online."""

    offline = True

    def rescored(self, history: Sequence[Tracks]) -> list[Tracks]:
        """Smooth, fill, join and weed out, with one score for each whole track."""
        return rescored(history)
