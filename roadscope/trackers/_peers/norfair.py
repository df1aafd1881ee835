"""Norfair's tracker: Kalman filters, the nearest pairs first."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from roadscope.core import Detections, Family, Requirement
from roadscope.core.arguments import check_counts, check_not_negative, check_positive
from roadscope.trackers._motion import RELATIVE_SPEEDS, ConstantVelocity, PositionFilter
from roadscope.trackers._peers.adapter import LibraryTrack, TrackerAdapter


class NorfairTracker(TrackerAdapter):
    """Norfair (Tryolabs) with centres in metres and Euclidean distances.

    The nearest pair of all is taken first, confirmed tracks before new ones. Its filters get
    metres and the true time between ticks instead of pixels and frames.
    """

    requires: ClassVar = Requirement("norfair", "pip install --no-deps norfair filterpy")
    """It works with NumPy 2, filterpy 2 and rich 15 but its metadata asks for older ones."""

    def __init__(
        self,
        *,
        vehicle_gate_m: float = 3.0,
        cyclist_gate_m: float = 2.0,
        pedestrian_gate_m: float = 1.0,
        confirm_hits: int = 3,
        coast_frames: int = 10,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        vehicle_gate_m, cyclist_gate_m, pedestrian_gate_m: `distance_threshold`, from the expected
            position of a track: that of a new car at 30 m/s is 3 m off at 10 Hz.
        confirm_hits: detections in a row after which a track is confirmed; Norfair's
            `initialization_delay` is one less.
        coast_frames: `hit_counter_max`: detections count up to it, misses count down to 0.
        shown_misses: see `LifeCycle`.
        position_m, speed_m_s: see `PositionFilter`.
        velocity_walk: see `ConstantVelocity`.
        """
        gates = {
            Family.VEHICLE: vehicle_gate_m,
            Family.CYCLIST: cyclist_gate_m,
            Family.PEDESTRIAN: pedestrian_gate_m,
        }
        check_positive(**{f"{family}_gate_m": gate for family, gate in gates.items()})
        check_counts(1, confirm_hits=confirm_hits)
        check_counts(confirm_hits, coast_frames=coast_frames)
        check_not_negative(velocity_walk=velocity_walk)
        filter_ = PositionFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk))
        super().__init__(
            lambda family: _Norfair(
                _Filters(filter_, speed_m_s * RELATIVE_SPEEDS[family]),
                distance_function="euclidean",
                distance_threshold=gates[family],
                hit_counter_max=coast_frames,
                initialization_delay=confirm_hits - 1,
            ),
            shown_misses,
        )


class _Filters:
    """The factory of the Kalman filters of Norfair's tracks, filterpy's as in Norfair's own."""

    def __init__(self, position_filter: PositionFilter, speed_m_s: float) -> None:
        self._filter = position_filter
        self._variances = np.repeat([position_filter.position_m, speed_m_s], 2) ** 2

    def create_filter(self, points: np.ndarray) -> Any:
        """Return a filter that starts at (1, 2) x and y."""
        from filterpy.kalman import KalmanFilter

        kalman = KalmanFilter(dim_x=4, dim_z=2)
        kalman.x[:2, 0] = points[0]
        kalman.P, kalman.H, kalman.R = np.diag(self._variances), self._filter.H, self._filter.R
        return kalman

    def set_period(self, one: Any, period_s: float) -> None:
        """Set the length of the next step of a filter."""
        motion = self._filter.motion
        one.F, one.Q = motion.jacobian(one.x.T, period_s), motion.noise(one.x.T, period_s)


class _Norfair:
    """`norfair.Tracker` as a `LibraryTracker`."""

    def __init__(self, filters: _Filters, **settings: Any) -> None:
        from norfair import Tracker

        self._filters = filters
        self._tracker = Tracker(filter_factory=filters, past_detections_length=0, **settings)

    def follow(self, detections: Detections, period_s: float) -> list[LibraryTrack]:
        from norfair import Detection

        for track in self._tracker.tracked_objects:
            self._filters.set_period(track.filter, period_s)
        own = [Detection(position[None]) for position in detections.centres[:, :2]]
        self._tracker.update(own)
        rows = {id(each): row for row, each in enumerate(own)}
        return [
            LibraryTrack(
                track.initializing_id,
                track.filter.x[:, 0],
                track.filter.P,
                rows.get(id(track.last_detection), -1),
                not track.is_initializing,
            )
            for track in self._tracker.tracked_objects
            if track.hit_counter_is_positive
        ]
