"""ByteTrack: detections of high score first, then those of low score (Zhang 2022)."""

from __future__ import annotations

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.arguments import check_not_negative, check_shares
from roadscope.trackers._assignment import AssignmentStage, Pairs, assign_in_stages
from roadscope.trackers._gating import boxes_of, check_overlap, pairs_by_overlap
from roadscope.trackers._motion import ConstantVelocity, PositionFilter
from roadscope.trackers._tracklets import LifeCycle, Tracklets, TrackManager

CONFIRM_HITS = 2


class ByteTracker:
    """Detections of low score keep tracks alive but start none.

    The authors match boxes in the image by overlap. Here boxes are in space, where those of one
    object in two frames need not touch, so overlaps are generalised ones.
    """

    def __init__(
        self,
        *,
        high_score: float = 0.6,
        low_score: float = 0.1,
        new_score: float = 0.7,
        overlap: str = "giou",
        least: float = -0.2,
        least_again: float = 0.0,
        coast_frames: int = 30,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up; scores are the authors'.

        high_score: detections with at least this score may go to any track, also to a coasting one.
        low_score: other detections with at least this score may go to tracks that had a detection
            in the last tick and have none of high score now.
        new_score: detections with at least this score start a track if they belong to none.
        overlap: `iou` or `giou`, both in space.
        least, least_again: overlap that a pair must exceed, with a detection of high and of low
            score. The first is that of the later code of AB3DMOT's authors, for cars.
        coast_frames, shown_misses: see `LifeCycle`. A track is confirmed by its second detection
            of high score, which must follow in the next tick.
        position_m, speed_m_s: see `PositionFilter`.
        velocity_walk: see `ConstantVelocity`.
        """
        check_shares(high_score=high_score, low_score=low_score, new_score=new_score)
        if not low_score <= high_score <= new_score:
            values = f"{low_score!r}, {high_score!r}, {new_score!r}"
            raise ValueError(f"low_score, high_score, new_score must not fall, got {values}")
        check_overlap(overlap, least)
        check_overlap(overlap, least_again)
        check_not_negative(velocity_walk=velocity_walk)
        self._high_score, self._low_score, self._new_score = high_score, low_score, new_score
        self._overlap, self._least, self._least_again = overlap, least, least_again
        self._manager = TrackManager(
            PositionFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk)),
            LifeCycle(CONFIRM_HITS, coast_frames, 0, shown_misses),
        )

    def reset(self) -> None:
        """Forget all tracks."""
        self._manager.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._manager.start_tick(detections, ego_pose)
        tracks = self._manager.predicted_tracks(tick)
        pairs = self._assigned(tracks, tick.detections)
        return self._manager.finish_tick(
            tick, tracks, tick.detections, pairs, new_score=self._new_score
        )

    def _assigned(self, tracks: Tracklets, detections: Detections) -> Pairs:
        """Return pairs in the authors' order (algorithm 1); tentative tracks come last."""
        near = pairs_by_overlap(
            tracks.boxes,
            boxes_of(detections),
            overlap=self._overlap,
            least=min(self._least, self._least_again),
        ).within_families(tracks.categories, detections.categories)
        high = detections.scores >= self._high_score
        low = ~high & (detections.scores >= self._low_score)
        confirmed, just_detected = tracks.hits >= CONFIRM_HITS, tracks.misses == 1
        stages = [
            AssignmentStage(confirmed, high, 1 - self._least),
            AssignmentStage(confirmed & just_detected, low, 1 - self._least_again),
            AssignmentStage(~confirmed, high, 1 - self._least),
        ]
        return assign_in_stages(near, stages)
