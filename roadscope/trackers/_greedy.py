"""Nearest centres, the detection of highest score first (CenterPoint, Yin 2021)."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Family, Pose, Tracks
from roadscope.core.arguments import check_not_negative, check_positive
from roadscope.trackers._assignment import Pairs, assign_in_turn
from roadscope.trackers._gating import FAMILIES, pairs_by_distance
from roadscope.trackers._motion import ConstantVelocity, PositionFilter
from roadscope.trackers._tracklets import LifeCycle, Tracklets, TrackManager


class GreedyTracker:
    """Each detection, by falling score, takes the nearest free track within its gate.

    CenterPoint's network estimates the velocity of each detection and moves the detection back to
    the last frame. Detections here have no velocity: each track is moved forward by its own, which
    is equivalent once it has two detections; until then it is taken to stand still in the world.
    """

    def __init__(
        self,
        *,
        vehicle_gate_m: float = 4.0,
        cyclist_gate_m: float = 3.0,
        pedestrian_gate_m: float = 1.0,
        confirm_hits: int = 1,
        coast_frames: int = 3,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        vehicle_gate_m, cyclist_gate_m, pedestrian_gate_m: greatest distance from the expected
            position of a track; the authors' values for cars, bicycles and pedestrians.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`; the authors' values.
        position_m, speed_m_s: see `PositionFilter`.
        velocity_walk: see `ConstantVelocity`.
        """
        gates = {
            Family.VEHICLE: vehicle_gate_m,
            Family.CYCLIST: cyclist_gate_m,
            Family.PEDESTRIAN: pedestrian_gate_m,
        }
        check_positive(**{f"{family}_gate_m": gate for family, gate in gates.items()})
        check_not_negative(velocity_walk=velocity_walk)
        self._gates_m = np.array([gates[family] for family in Family])
        self._manager = TrackManager(
            PositionFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk)),
            LifeCycle(confirm_hits, coast_frames, coast_frames, shown_misses),
        )

    def reset(self) -> None:
        """Forget all tracks."""
        self._manager.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._manager.start_tick(detections, ego_pose)
        tracks = self._manager.predicted_tracks(tick)
        pairs = self._assigned(tick.detections, tracks)
        return self._manager.finish_tick(tick, tracks, tick.detections, pairs)

    def _assigned(self, detections: Detections, tracks: Tracklets) -> Pairs:
        """Return pairs; of detections with equal scores the one nearer to a track comes first."""
        gates_m = self._gates_m[FAMILIES[detections.categories]]
        near = pairs_by_distance(detections.centres[:, :2], tracks.positions, gates_m)
        near = near.within_families(detections.categories, tracks.categories)
        nearest_m = np.full(len(detections), np.inf)
        np.minimum.at(nearest_m, near.rows, near.costs)
        columns, rows = assign_in_turn(near, np.lexsort([nearest_m, -detections.scores]))
        return rows, columns
