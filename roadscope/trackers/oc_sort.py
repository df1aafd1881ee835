"""Observations before estimates: OC-SORT (Cao 2023), for boxes in space."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.assignment import Pairs, assign_optimally, left_over
from roadscope.trackers.gating import Candidates, candidates_by_overlap, check_overlap
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.motion import ConstantVelocity
from roadscope.trackers.observations import Observations, agreement, units
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.rows import Rows
from roadscope.trackers.settings import check_counts, check_not_negative, check_shares
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets, boxes_of


@dataclass(frozen=True, slots=True, eq=False)
class Followed(Rows):
    """Tracks, and what they remember."""

    tracks: Tracklets
    observed: Observations


class OcSortTracker:
    """SORT that trusts what was seen over what the filter made of it.

    Momentum (OCM): a detection in the direction in which a track was seen to move is preferred.
    Recovery (OCR): what finds no detection where it is expected is looked for where it was last
    seen. Re-update (ORU): a track found again forgets its drift; the filter goes through the gap
    once more, along a straight line between both detections.
    """

    def __init__(
        self,
        *,
        least_score: float = 0.3,
        overlap: str = "giou",
        least: float = -0.2,
        momentum: float = 0.2,
        momentum_ticks: int = 3,
        moving_m: float = 0.5,
        confirm_hits: int = 3,
        coast_frames: int = 30,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        least_score: detections below are not looked at.
        overlap, least: `iou` or `giou` in space, and what that of a pair must exceed, as in the
            later code of AB3DMOT's authors, for cars.
        momentum: weight of directions beside overlaps, lambda.
        momentum_ticks: how far back the other end of a direction lies, delta t.
        moving_m: nearer together two places have no direction; otherwise that of a parked car
            would be its detector's noise.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`.
        position_m, speed_m_s: see `PlaceFilter`.
        velocity_walk: m/s per root second, by which velocities wander.
        """
        check_shares(least_score=least_score)
        check_overlap(overlap, least)
        check_not_negative(momentum=momentum, moving_m=moving_m, velocity_walk=velocity_walk)
        check_counts(1, momentum_ticks=momentum_ticks)
        self._least_score, self._overlap, self._least = least_score, overlap, least
        self._momentum, self._ticks, self._moving_m = momentum, momentum_ticks, moving_m
        self._life = LifeCycle(confirm_hits, coast_frames, 0, shown_misses)
        self._filter = PlaceFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._next_id = 0
        self._stamps: list[float] = []
        self._followed = self._opened(Detections.empty(0.0))

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        targets = tick.targets.select(tick.targets.scores >= self._least_score)
        tracks, observed = self._followed.tracks, self._followed.observed.moved_on()
        tracks = tracks.moved_on(self._filter.predicted(tracks.beliefs, tick.period_s))
        rows, columns = self._associated(tracks, observed, targets)
        found = targets.select(columns)
        self._stamps = [t for t in self._stamps if t >= observed.stamps.min(initial=np.inf)]
        self._stamps.append(tick.stamp_s)
        beliefs = self._updated_again(observed.select(rows), found.centres[:, :2])
        followed = Followed(
            tracks.seen(rows, found, beliefs),
            observed.seen(rows, found, beliefs, self._moving_m),
        )
        followed = followed.select(self._life.alive(followed.tracks))
        new = targets.select(left_over(len(targets), columns))
        self._followed = followed.joined(self._opened(new))
        tracks = self._followed.tracks
        planar, states = self._filter.planar(tracks.beliefs), self._life.states(tracks)
        return tracks.report(planar, states, tick.frame, tick.stamp_s)

    def _associated(self, tracks: Tracklets, observed: Observations, targets: Detections) -> Pairs:
        """Pair by overlap and momentum (eq. 4), then by overlap with what was last seen (OCR)."""
        alone = 1 - self._least
        near = self._overlapping(tracks.boxes, tracks.categories, targets)
        costs = near.costs - self._momentum * self._consistency(near, observed, targets)
        # More than any pair can cost, so that a contrary direction alone undoes none.
        rows, columns = assign_optimally(near.costing(costs), alone + self._momentum)
        left, free = left_over(len(tracks), rows), left_over(len(targets), columns)
        near = self._overlapping(
            observed.boxes[left], tracks.categories[left], targets.select(free)
        )
        i, j = assign_optimally(near, alone)
        return np.concatenate([rows, left[i]]), np.concatenate([columns, free[j]])

    def _overlapping(
        self, boxes: np.ndarray, categories: np.ndarray, targets: Detections
    ) -> Candidates:
        near = candidates_by_overlap(
            boxes, boxes_of(targets), overlap=self._overlap, least=self._least
        )
        return near.within_families(categories, targets.categories)

    def _consistency(
        self, near: Candidates, observed: Observations, targets: Detections
    ) -> np.ndarray:
        """Return (P,) how well pairs continue the directions seen, -1/2 to 1/2.

        As in the authors' code, and weighed with the detection's score; 0 where there is no
        direction.
        """
        ahead = targets.centres[near.columns, :2] - observed.anchors[near.rows]
        agreed = agreement(observed.directions[near.rows], units(ahead, self._moving_m))
        weighed: np.ndarray = targets.scores[near.columns] * agreed
        return weighed

    def _updated_again(self, observed: Observations, places: np.ndarray) -> Gaussians:
        """Filter from the last detections to (N, 2) new ones, through all ticks between (ORU).

        Between two ticks in succession that is the ordinary update.
        """
        beliefs, start, now_s = observed.beliefs, observed.boxes[:, :2], self._stamps[-1]
        for before_s, stamp_s in itertools.pairwise(self._stamps):
            rows = np.flatnonzero(observed.stamps <= before_s)
            if not len(rows):
                continue
            since = observed.stamps[rows]
            share = ((stamp_s - since) / (now_s - since))[:, None]
            virtual = start[rows] + share * (places[rows] - start[rows])
            ahead = self._filter.predicted(beliefs.select(rows), stamp_s - before_s)
            beliefs = beliefs.replaced(rows, self._filter.corrected(ahead, virtual))
        return beliefs

    def _opened(self, targets: Detections) -> Followed:
        beliefs = self._filter.started(targets)
        opened = Tracklets.opened(self._next_id, targets, beliefs)
        self._next_id += len(targets)
        return Followed(opened, Observations.opened(targets, beliefs, self._ticks))
