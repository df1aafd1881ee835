"""Association in two stages: sure detections first, then unsure ones (ByteTrack, Zhang 2022)."""

from __future__ import annotations

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.assignment import Pairs, assign_in_stages
from roadscope.trackers.gating import candidates_by_overlap, check_overlap
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.management import TrackManager
from roadscope.trackers.motion import ConstantVelocity
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.settings import check_not_negative, check_shares
from roadscope.trackers.tracklets import Tracklets, boxes_of

CONFIRM_HITS = 2


class ByteTracker:
    """Detections of low score keep tracks alive but open none.

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
        """Set the tracker up.

        high_score: detections from here on are sure and go to any track, lost ones too.
        low_score: those from here on go to tracks seen in the last tick that found no sure one.
        new_score: sure ones from here on open tracks if they find none. The authors' scores.
        overlap: `iou` or `giou`, both in space.
        least, least_again: what the overlap of a sure pair must exceed, and of an unsure one;
            the first as in the later code of AB3DMOT's authors, for cars.
        coast_frames, shown_misses: see `LifeCycle`. A track is confirmed by its second sure
            detection, which must follow on the first.
        position_m, speed_m_s: see `PlaceFilter`.
        velocity_walk: m/s per root second, by which velocities wander.
        """
        check_shares(high_score=high_score, low_score=low_score, new_score=new_score)
        if not low_score <= high_score <= new_score:
            given = f"{low_score!r}, {high_score!r}, {new_score!r}"
            raise ValueError(f"low_score, high_score, new_score must not fall, got {given}")
        check_overlap(overlap, least)
        check_overlap(overlap, least_again)
        check_not_negative(velocity_walk=velocity_walk)
        self._high, self._low, self._new = high_score, low_score, new_score
        self._overlap, self._least, self._least_again = overlap, least, least_again
        self._manager = TrackManager(
            PlaceFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk)),
            LifeCycle(CONFIRM_HITS, coast_frames, 0, shown_misses),
        )

    def reset(self) -> None:
        """Forget all tracks."""
        self._manager.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._manager.arrived(detections, ego_pose)
        tracks = self._manager.expected(tick)
        pairs = self._associated(tracks, tick.targets)
        return self._manager.concluded(tick, tracks, tick.targets, pairs, self._new)

    def _associated(self, tracks: Tracklets, targets: Detections) -> Pairs:
        """Pair in the authors' order (algorithm 1; tracks of one detection come last)."""
        near = candidates_by_overlap(
            tracks.boxes, boxes_of(targets),
            overlap=self._overlap, least=min(self._least, self._least_again),
        ).within_families(tracks.categories, targets.categories)  # fmt: skip
        sure = targets.scores >= self._high
        unsure = ~sure & (targets.scores >= self._low)
        confirmed, just_seen = tracks.hits >= CONFIRM_HITS, tracks.misses == 1
        stages = [
            (confirmed, sure, 1 - self._least),
            (confirmed & just_seen, unsure, 1 - self._least_again),
            (~confirmed, sure, 1 - self._least),
        ]
        return assign_in_stages(near, stages)
