"""Interacting multiple models of motion, one of which is right for each target at each time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.assignment import left_over
from roadscope.trackers.gating import chi_square_gate
from roadscope.trackers.gnn import likeliest_pairs
from roadscope.trackers.imm_filter import ImmFilter, Modes
from roadscope.trackers.imm_turn import CartesianTurn
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.motion import ConstantAcceleration, ConstantVelocity
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.rows import Rows
from roadscope.trackers.settings import check_not_negative, check_shares
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets


@dataclass(frozen=True, slots=True, eq=False)
class Followed(Rows):
    """Tracks, believed to be where the mixture of their models is."""

    tracks: Tracklets
    modes: Modes


class ImmTracker:
    """Constant velocity, constant acceleration and constant turn at once; association as GNN's.

    Each detection also tells which model fits, so a target that drives straight on is followed
    calmly and one that brakes or turns in time.
    """

    def __init__(
        self,
        *,
        gate_share: float = 0.997,
        least_score: float = 0.0,
        confirm_hits: int = 3,
        coast_frames: int = 10,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 0.5,
        acceleration_walk: float = 2.0,
        turn_walk: float = 0.3,
        sojourn_s: float = 3.0,
    ) -> None:
        """Set the tracker up.

        gate_share: share of right pairs that the gate lets through, if the noise is as said.
        least_score: detections below are not looked at.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`.
        position_m, speed_m_s: see `PlaceFilter`.
        velocity_walk, acceleration_walk, turn_walk: m/s, m/s2 and rad/s per root second, by which
            velocities, those of turning targets too, accelerations and yaw rates wander.
        sojourn_s: see `ImmFilter`.
        """
        check_shares(least_score=least_score)
        check_not_negative(
            velocity_walk=velocity_walk, acceleration_walk=acceleration_walk, turn_walk=turn_walk
        )
        self._gate, self._least_score = chi_square_gate(gate_share, 2), least_score
        self._life = LifeCycle(confirm_hits, coast_frames, 0, shown_misses)
        self._R = position_m**2 * np.eye(2)
        straight, pushed, turning = (
            PlaceFilter(position_m, speed_m_s, motion)
            for motion in (
                ConstantVelocity(velocity_walk),
                ConstantAcceleration(acceleration_walk),
                CartesianTurn(velocity_walk, turn_walk),
            )
        )
        self._filter = ImmFilter((straight, pushed, turning), sojourn_s)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._next_id = 0
        self._followed = self._opened(Detections.empty(0.0))

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        targets = tick.targets.select(tick.targets.scores >= self._least_score)
        modes = self._filter.predicted(self._followed.modes, tick.period_s)
        tracks = self._followed.tracks.moved_on(modes.mixture)
        rows, columns = likeliest_pairs(tracks, targets, self._R, self._gate)
        found = targets.select(columns)
        right = self._filter.corrected(modes.select(rows), found.centres[:, :2])
        tracks = tracks.seen(rows, found, right.mixture)
        followed = Followed(tracks, modes.replaced(rows, right)).select(self._life.alive(tracks))
        new = targets.select(left_over(len(targets), columns))
        self._followed = followed.joined(self._opened(new))
        tracks = self._followed.tracks
        return tracks.report(tracks.beliefs, self._life.states(tracks), tick.frame, tick.stamp_s)

    def _opened(self, targets: Detections) -> Followed:
        modes = self._filter.started(targets)
        opened = Tracklets.opened(self._next_id, targets, modes.mixture)
        self._next_id += len(targets)
        return Followed(opened, modes)
