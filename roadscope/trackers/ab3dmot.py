"""A Kalman filter of boxes in space and their overlap: AB3DMOT (Weng 2020)."""

from __future__ import annotations

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.assignment import assign_optimally, left_over
from roadscope.trackers.box_filter import (
    DIMENSIONS,
    boxes_corrected,
    boxes_moved,
    boxes_started,
    planar,
    shaped,
)
from roadscope.trackers.gating import candidates_by_overlap, check_overlap
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.settings import check_counts, check_not_negative
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets, boxes_of


class Ab3dmotTracker:
    """State x, y, z, yaw, l, w, h, vx, vy, vz; every detection measures the first seven.

    The authors' constants, in a frame that stands still where the ego's pose is known; they
    follow targets in the sensor's. Their R is 1 m and 1 rad, so covariances say little.
    """

    def __init__(
        self,
        *,
        overlap: str = "iou",
        least: float = 0.01,
        min_hits: int = 3,
        max_age: int = 2,
        shown_misses: int = 1,
        least_score: float = 0.0,
    ) -> None:
        """Set the tracker up.

        overlap: `iou` as in the paper or `giou` as in the authors' later code, both in space.
        least: what the overlap of a pair must exceed; the authors' are 0.01 and -0.2.
        min_hits: detections after which a track is confirmed (section 3.5).
        max_age: ticks without a detection after which it is dropped.
        shown_misses: see `LifeCycle`.
        least_score: detections below are not looked at.
        """
        check_overlap(overlap, least)
        check_counts(1, max_age=max_age)
        check_not_negative(least_score=least_score)
        self._overlap, self._least, self._least_score = overlap, least, least_score
        self._life = LifeCycle(min_hits, max_age - 1, max_age - 1, shown_misses)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._tracks = Tracklets.empty(DIMENSIONS)
        self._next_id = 0

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        targets = tick.targets.select(tick.targets.scores >= self._least_score)
        tracks = boxes_moved(self._tracks, tick.period_s)
        near = candidates_by_overlap(
            tracks.boxes, boxes_of(targets), overlap=self._overlap, least=self._least
        ).within_families(tracks.categories, targets.categories)
        rows, columns = assign_optimally(near, 1 - self._least)
        found = targets.select(columns)
        beliefs = boxes_corrected(tracks.beliefs.select(rows), found)
        tracks = self._life.survivors(shaped(tracks.seen(rows, found, beliefs)))
        new = targets.select(left_over(len(targets), columns))
        self._tracks = tracks = tracks.joined(
            Tracklets.opened(self._next_id, new, boxes_started(new))
        )
        self._next_id += len(new)
        states = self._life.states(tracks)
        return tracks.report(planar(tracks.beliefs), states, tick.frame, tick.stamp_s)
