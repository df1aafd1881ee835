"""Constant acceleration, and the surest predictions first: PC3T (Wu 2021)."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.assignment import Pairs, assign_in_turn
from roadscope.trackers.gating import candidates_by_distance
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.management import TrackManager
from roadscope.trackers.motion import ConstantAcceleration
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.settings import check_positive, check_shares
from roadscope.trackers.tracklets import Tracklets


class Pc3tTracker:
    """Each track in turn, by falling confidence in its prediction, takes the cheapest detection.

    From the paper: motion of constant acceleration; a confidence in each prediction that guides
    the association; costs of pairs that add several features up.

    Our reading: a prediction is as sure as the track's last detection and less so with every
    frame unseen, and the surest chooses first; features are places, boxes, headings and speeds,
    all in metres, a heading's times the box's length and a speed's what it comes to in the time
    since the last tick; new tracks are given up sooner than old ones, as in what the authors
    published. What that drops after the fact, tracks of a low mean score, is no part of what is
    online. Gate and noise are ours.
    """

    def __init__(
        self,
        *,
        least_score: float = 0.5,
        new_score: float = 0.5,
        gate_m: float = 4.0,
        decay: float = 0.03,
        confirm_hits: int = 3,
        coast_frames: int = 12,
        new_coast_frames: int = 2,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        acceleration_walk: float = 3.0,
    ) -> None:
        """Set the tracker up; decay and frames as the authors published for KITTI.

        least_score: detections below are not looked at; of PointRCNN the authors' is 0.5.
        new_score: those from here on open tracks if they find none; of PointRCNN the authors'
            is 0.98 online.
        gate_m: greatest distance of a detection from where a track is expected.
        decay: of a prediction's confidence, share for each frame unseen.
        confirm_hits, shown_misses: see `LifeCycle`.
        coast_frames, new_coast_frames: ticks without a detection that a track outlives, once it
            is confirmed and before.
        position_m, speed_m_s: see `PlaceFilter`.
        acceleration_walk: m/s2 per root second, by which accelerations wander.
        """
        check_shares(least_score=least_score, new_score=new_score, decay=decay)
        check_positive(gate_m=gate_m)
        self._least_score, self._new_score = least_score, new_score
        self._gate_m, self._decay = gate_m, decay
        self._manager = TrackManager(
            PlaceFilter(position_m, speed_m_s, ConstantAcceleration(acceleration_walk)),
            LifeCycle(confirm_hits, coast_frames, new_coast_frames, shown_misses),
        )

    def reset(self) -> None:
        """Forget all tracks."""
        self._manager.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._manager.arrived(detections, ego_pose)
        targets = tick.targets.select(tick.targets.scores >= self._least_score)
        tracks = self._manager.expected(tick)
        pairs = self._associated(tracks, targets, tick.period_s)
        return self._manager.concluded(tick, tracks, targets, pairs, self._new_score)

    def _associated(self, tracks: Tracklets, targets: Detections, dt: float) -> Pairs:
        gates = np.full(len(tracks), self._gate_m)
        near = candidates_by_distance(tracks.places, targets.centres[:, :2], gates)
        near = near.within_families(tracks.categories, targets.categories)
        i, j = near.rows, near.columns
        boxes = np.abs(tracks.sizes[i] - targets.sizes[j]).sum(axis=1)
        turned = np.abs(np.sin(tracks.yaws[i] - targets.yaws[j])) * tracks.sizes[i, 0]
        costs = near.costs + boxes + turned + self._odd_speeds(tracks, targets, i, j, dt)
        confidence = tracks.scores * (1 - self._decay) ** (tracks.misses - 1)
        return assign_in_turn(near.costing(costs), np.lexsort([tracks.ids, -confidence]))

    def _odd_speeds(
        self, tracks: Tracklets, targets: Detections, i: np.ndarray, j: np.ndarray, dt: float
    ) -> np.ndarray:
        """Return (P,) metres between how fast tracks are and would have been, over a tick."""
        states = tracks.beliefs.means[i]
        before = states[:, :2] - dt * states[:, 2:4] + dt**2 / 2 * states[:, 4:6]
        covered = np.hypot(*(targets.centres[j, :2] - before).T)
        odd: np.ndarray = np.abs(covered - dt * np.hypot(states[:, 2], states[:, 3]))
        return odd
