"""Suppression, generalised overlap and a second stage: SimpleTrack (Pang 2021)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

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
from roadscope.trackers.gating import Candidates, candidates_by_overlap, check_overlap
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.settings import check_counts, check_shares
from roadscope.trackers.suppression import suppressed
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets, boxes_of


class SimpleTracker:
    """AB3DMOT with each of its four parts mended.

    From the paper: detections that overlap are thinned out rather than cut off by score, tracks
    and detections are matched by generalised IoU in space, and a track that no sure detection
    continues lives on by an unsure one. The filter is that of AB3DMOT, which the authors keep
    for frame rates such as a LiDAR's.

    Our reading: an unsure detection says that the target is still there, not where; the track is
    told where the filter expects it. Mahalanobis distances and greedy matching, which the paper
    looks at too, are left out.
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

        most_overlap: IoU in space beyond which the less sure of two detections is dropped.
        high_score, low_score: from which on detections continue and open tracks, and from which
            on they keep tracks alive.
        least: generalised IoU in space that a pair must exceed, in both stages.
        min_hits: sure detections after which a track is confirmed.
        max_age: ticks without any detection after which it is dropped.
        """
        check_shares(most_overlap=most_overlap, high_score=high_score, low_score=low_score)
        if low_score > high_score:
            raise ValueError(f"low_score must not exceed high_score, {high_score!r}, "
                             f"got {low_score!r}")  # fmt: skip
        check_overlap("giou", least)
        check_counts(1, max_age=max_age)
        self._most_overlap, self._least = most_overlap, least
        self._high, self._low = high_score, low_score
        self._life = LifeCycle(min_hits, max_age - 1, max_age - 1)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._tracks = Tracklets.empty(DIMENSIONS)
        self._next_id = 0

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        heard = tick.targets.select(tick.targets.scores >= self._low)
        targets = suppressed(heard, self._most_overlap)
        sure = targets.select(targets.scores >= self._high)
        tracks = boxes_moved(self._tracks, tick.period_s)
        rows, columns = assign_optimally(self._near(tracks, sure), 1 - self._least)
        alone, spare = left_over(len(tracks), rows), left_over(len(sure), columns)
        found = sure.select(columns)
        beliefs = boxes_corrected(tracks.beliefs.select(rows), found)
        kept = alone[self._still_there(tracks.select(alone), targets)]
        tracks = shaped(tracks.seen(rows, found, beliefs))
        # What an unsure detection keeps alive has grown no older.
        lasting = tracks.misses - np.isin(np.arange(len(tracks)), kept)
        tracks = self._life.survivors(replace(tracks, misses=lasting))
        new = sure.select(spare)
        self._tracks = tracks = tracks.joined(
            Tracklets.opened(self._next_id, new, boxes_started(new))
        )
        self._next_id += len(new)
        states = self._life.states(tracks)
        return tracks.report(planar(tracks.beliefs), states, tick.frame, tick.stamp_s)

    def _near(self, tracks: Tracklets, targets: Detections) -> Candidates:
        near = candidates_by_overlap(
            tracks.boxes, boxes_of(targets), overlap="giou", least=self._least
        )
        return near.within_families(tracks.categories, targets.categories)

    def _still_there(self, tracks: Tracklets, targets: Detections) -> np.ndarray:
        """Return rows of tracks that an unsure detection continues."""
        unsure = targets.select(targets.scores < self._high)
        rows, _ = assign_optimally(self._near(tracks, unsure), 1 - self._least)
        return rows
