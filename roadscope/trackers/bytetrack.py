"""Association in two stages: sure detections first, then unsure ones (ByteTrack, Zhang 2022)."""

from __future__ import annotations

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.assignment import Pairs, assign_in_stages
from roadscope.trackers.gating import barred, check_overlap, overlap_costs, same_family
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.motion import ConstantVelocity
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.settings import check_not_negative, check_shares
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets, boxes_of


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
        least: float = -0.5,
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
        least, least_again: what the overlap of a sure pair must exceed, and of an unsure one.
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
        self._life = LifeCycle(2, coast_frames, 0, shown_misses)
        self._filter = PlaceFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._tracks = Tracklets.empty(self._filter.dimensions)
        self._next_id = 0

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        targets, tracks = tick.targets, self._tracks
        tracks = tracks.moved_on(self._filter.predicted(tracks.beliefs, tick.period_s))
        rows, columns = self._associated(tracks, targets)
        found = targets.select(columns)
        beliefs = self._filter.corrected(tracks.beliefs.select(rows), found.centres[:, :2])
        tracks = self._life.survivors(tracks.seen(rows, found, beliefs))
        new = targets.scores >= self._new
        new[columns] = False
        begun = targets.select(new)
        opened = Tracklets.opened(self._next_id, begun, self._filter.started(begun))
        self._tracks = tracks = tracks.joined(opened)
        self._next_id += len(begun)
        planar, states = self._filter.planar(tracks.beliefs), self._life.states(tracks)
        return tracks.report(planar, states, tick.frame, tick.stamp_s)

    def _associated(self, tracks: Tracklets, targets: Detections) -> Pairs:
        """Pair in the authors' order (algorithm 1; tracks of one detection come last)."""
        costs = overlap_costs(
            tracks.boxes, boxes_of(targets),
            overlap=self._overlap, least=min(self._least, self._least_again),
        )  # fmt: skip
        costs = barred(costs, same_family(tracks.categories, targets.categories))
        sure = targets.scores >= self._high
        unsure = ~sure & (targets.scores >= self._low)
        confirmed, just_seen = tracks.hits >= self._life.confirm_hits, tracks.misses == 1
        stages = [
            (confirmed, sure, 1 - self._least),
            (confirmed & just_seen, unsure, 1 - self._least_again),
            (~confirmed, sure, 1 - self._least),
        ]
        return assign_in_stages(costs, stages)
