"""SimpleTrack: suppression, generalised overlap and a second stage (Pang 2021)."""

from __future__ import annotations

from dataclasses import replace

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.arguments import check_counts, check_shares
from roadscope.trackers._ab3dmot import (
    DIMENSIONS,
    boxes_predicted,
    boxes_reported,
    boxes_started,
    boxes_updated,
)
from roadscope.trackers._assignment import assign_optimally, unassigned
from roadscope.trackers._gating import (
    CandidatePairs,
    boxes_of,
    check_overlap,
    pairs_by_overlap,
    suppressed,
)
from roadscope.trackers._ticks import TrackerTick
from roadscope.trackers._tracklets import LifeCycle, Tracklets


class SimpleTracker:
    """AB3DMOT with improvements in all its parts.

    From the paper: detections that overlap are suppressed instead of cut off by score, pairs are
    assigned by generalised IoU in space, and a track without a detection of high score is kept
    alive by one of low score. The filter is that of AB3DMOT, as the authors advise for the frame
    rates of a LiDAR.

    Our reading: a detection of low score says that the target is still there, not where; the track
    is reported where the filter expects it. Mahalanobis distances and greedy assignment, which
    the paper compares, are left out.
    """

    def __init__(
        self,
        *,
        most_overlap: float = 0.25,
        high_score: float = 0.7,
        low_score: float = 0.1,
        least: float = -0.5,
        min_hits: int = 3,
        max_age: int = 2,
    ) -> None:
        """Set the tracker up; defaults are what the authors published for Waymo.

        most_overlap: IoU in space above which the detection of lower score is suppressed.
        high_score, low_score: from which on detections update and start tracks, and from which on
            they keep tracks alive.
        least: a pair must have a higher generalised IoU in space, in both stages.
        min_hits: detections of high score after which a track is confirmed.
        max_age: ticks without any detection after which a track is dropped.
        """
        check_shares(most_overlap=most_overlap, high_score=high_score, low_score=low_score)
        if low_score > high_score:
            raise ValueError(
                f"low_score must not exceed high_score, {high_score!r}, got {low_score!r}"
            )
        check_overlap("giou", least)
        check_counts(1, max_age=max_age)
        self._most_overlap, self._least = most_overlap, least
        self._high_score, self._low_score = high_score, low_score
        self._life_cycle = LifeCycle(min_hits, max_age - 1, max_age - 1)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: TrackerTick | None = None
        self._tracks = Tracklets.empty(DIMENSIONS)
        self._next_id = 0

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._tick = TrackerTick.after(self._tick, detections, ego_pose)
        detections = tick.detections.select(tick.detections.scores >= self._low_score)
        detections = suppressed(detections, self._most_overlap)
        high = detections.select(detections.scores >= self._high_score)
        low = detections.select(detections.scores < self._high_score)
        tracks = boxes_predicted(self._tracks, tick.period_s)
        rows, columns = assign_optimally(self._near(tracks, high), 1 - self._least)
        without = unassigned(len(tracks), rows)
        alive, _ = assign_optimally(self._near(tracks.select(without), low), 1 - self._least)
        tracks = boxes_updated(tracks, rows, high.select(columns))
        misses = tracks.misses.copy()
        misses[without[alive]] -= 1
        tracks = self._life_cycle.survivors(replace(tracks, misses=misses))
        new = high.select(unassigned(len(high), columns))
        self._tracks = tracks.joined(boxes_started(self._next_id, new))
        self._next_id += len(new)
        return boxes_reported(self._tracks, self._life_cycle, tick)

    def _near(self, tracks: Tracklets, detections: Detections) -> CandidatePairs:
        near = pairs_by_overlap(
            tracks.boxes, boxes_of(detections), overlap="giou", least=self._least
        )
        return near.within_families(tracks.categories, detections.categories)
