"""Track management: what follows on association, alike in all trackers with one filter a track."""

from __future__ import annotations

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.assignment import Pairs, left_over
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets


class TrackManager:
    """Keeps the tracks of a tracker, moves them on, corrects, begins and ends them.

    A tracker asks for the tick, then for the tracks where they are expected, pairs these with
    detections and hands the pairs back.
    """

    def __init__(self, kalman: PlaceFilter, life: LifeCycle) -> None:
        """Take the filter of each track, and when tracks are believed and dropped."""
        self._filter, self._life = kalman, life
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._tracks = Tracklets.empty(self._filter.dimensions)
        self._next_id = 0

    def arrived(self, detections: Detections, ego_pose: Pose | None) -> Tick:
        """Begin a tick."""
        self._tick = Tick.after(self._tick, detections, ego_pose)
        return self._tick

    def expected(self, tick: Tick) -> Tracklets:
        """Return the tracks where they should be by now, as yet unseen."""
        beliefs = self._filter.predicted(self._tracks.beliefs, tick.period_s)
        return self._tracks.moved_on(beliefs)

    def concluded(
        self, tick: Tick, tracks: Tracklets, targets: Detections, pairs: Pairs, least_new: float
    ) -> Tracks:
        """Correct tracks by the detections paired with them and report them.

        least_new: detections without a track that score less open none.
        """
        rows, columns = pairs
        found = targets.select(columns)
        beliefs = self._filter.corrected(tracks.beliefs.select(rows), found.centres[:, :2])
        tracks = self._life.survivors(tracks.seen(rows, found, beliefs))
        free = left_over(len(targets), columns)
        new = targets.select(free[targets.scores[free] >= least_new])
        opened = Tracklets.opened(self._next_id, new, self._filter.started(new))
        self._next_id += len(new)
        self._tracks = tracks = tracks.joined(opened)
        planar, states = self._filter.planar(tracks.beliefs), self._life.states(tracks)
        return tracks.report(planar, states, tick.frame, tick.stamp_s)
