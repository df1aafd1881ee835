"""Greedy nearest centres, the surest detection first (CenterPoint, Yin 2021)."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Family, Pose, Tracks
from roadscope.trackers.assignment import Pairs, assign_in_turn
from roadscope.trackers.gating import FAMILIES, candidates_by_distance
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.management import TrackManager
from roadscope.trackers.motion import ConstantVelocity
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.settings import check_not_negative, check_positive
from roadscope.trackers.tracklets import Tracklets


class GreedyTracker:
    """Each detection in turn, by falling score, takes the nearest free track within its gate.

    CenterPoint's network tells each detection's velocity and carries the detection back to the
    last frame by it. Detections here have none: each track is carried forward by its own velocity,
    of a Kalman filter over its detections, which comes to the same once it has two of them; until
    then it is taken to stand still in the world.
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

        vehicle_gate_m, cyclist_gate_m, pedestrian_gate_m: greatest distance from a track's
            expected place; the authors' of cars, bicycles and pedestrians.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`; the authors'.
        position_m, speed_m_s: see `PlaceFilter`.
        velocity_walk: m/s per root second, by which velocities wander.
        """
        gates = {
            Family.VEHICLE: vehicle_gate_m,
            Family.CYCLIST: cyclist_gate_m,
            Family.PEDESTRIAN: pedestrian_gate_m,
        }
        check_positive(**{f"{family}_gate_m": gate for family, gate in gates.items()})
        check_not_negative(velocity_walk=velocity_walk)
        self._gates = np.array([gates[family] for family in Family])
        self._manager = TrackManager(
            PlaceFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk)),
            LifeCycle(confirm_hits, coast_frames, coast_frames, shown_misses),
        )

    def reset(self) -> None:
        """Forget all tracks."""
        self._manager.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._manager.arrived(detections, ego_pose)
        tracks = self._manager.expected(tick)
        pairs = self._associated(tick.targets, tracks)
        return self._manager.concluded(tick, tracks, tick.targets, pairs, 0.0)

    def _associated(self, targets: Detections, tracks: Tracklets) -> Pairs:
        """Pair detections with tracks; of equal scores the nearer comes first."""
        gates = self._gates[FAMILIES[targets.categories]]
        near = candidates_by_distance(targets.centres[:, :2], tracks.places, gates)
        near = near.within_families(targets.categories, tracks.categories)
        nearest = np.full(len(targets), np.inf)
        np.minimum.at(nearest, near.rows, near.costs)
        columns, rows = assign_in_turn(near, np.lexsort([nearest, -targets.scores]))
        return rows, columns
