"""Nearest association and one Kalman filter per target (Lu 2018, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Detections, Pose, Tracks, TrackState
from roadscope.trackers.association import associate_nearest
from roadscope.trackers.constant_velocity import ConstantVelocityFilter, Noise
from roadscope.trackers.ticks import Tick

FRAMES = ("world", "ego")


@dataclass(slots=True)
class Track:
    """A filter and what its last detection said of the body.

    row: the last detection, one row.
    hits: detections so far.
    misses: ticks since the last.
    """

    id: int
    filter: ConstantVelocityFilter
    row: Detections
    hits: int = 1
    misses: int = 0


class NearestTracker:
    """Lu 2018's tracker: every target that fits no filter opens one, every idle filter coasts.

    With `acceleration_m_s2` at 0 there is no process noise, as printed in eq. 8; a filter then
    trusts its past more with every frame.
    """

    def __init__(
        self,
        *,
        gate_m: float = 2.0,
        coast_frames: int = 20,
        confirm_hits: int = 1,
        sigma_p_m: float = 0.5,
        sigma_m_m: float = 0.2,
        acceleration_m_s2: float = 0.0,
        frame: str = "world",
        period_s: float = 0.08,
    ) -> None:
        """Set the tracker up.

        gate_m: greatest difference at which a target belongs to a filter. The paper gives none;
            two vehicles' centres cannot be nearer than a vehicle's width.
        coast_frames: ticks that an idle filter outlives. The paper says a few, and its longest
            is 13; a target half hidden before and after that is not detected for some more.
        confirm_hits: detections after which a track is confirmed rather than tentative; 1, as
            in the paper, believes every first one.
        sigma_p_m, sigma_m_m: the paper's.
        acceleration_m_s2: standard deviation of a white acceleration as process noise.
        frame: `world` follows targets in the world frame whenever the pose of the ego is known
            (constant velocity does not hold in a turning vehicle's frame); `ego` follows them
            in the vehicle's frame as the paper does.
        period_s: T of eq. 14 until two ticks have been seen; the LUX's.
        """
        _check_positive(gate_m=gate_m, sigma_p_m=sigma_p_m, sigma_m_m=sigma_m_m, period_s=period_s)
        if confirm_hits < 1:
            raise ValueError(f"confirm_hits must be 1 or more, got {confirm_hits!r}")
        if coast_frames < 0 or not 0 <= acceleration_m_s2 < np.inf:
            given = f"coast_frames={coast_frames!r}, acceleration_m_s2={acceleration_m_s2!r}"
            raise ValueError(f"coast_frames and acceleration_m_s2 must be 0 or more, got {given}")
        if frame not in FRAMES:
            raise ValueError(f"no frame '{frame}'; possible: {', '.join(FRAMES)}")
        self._gate_m, self._coast_frames = gate_m, coast_frames
        self._confirm_hits = confirm_hits
        self._noise = Noise(sigma_p_m, sigma_m_m, acceleration_m_s2)
        self._frame, self._first_period_s = frame, period_s
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tracks: list[Track] = []
        self._next_id = 0
        self._tick: Tick | None = None

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks, coasting ones included.

        Raises `ValueError` when stamps do not increase, or when the pose that earlier ticks had
        is missing.
        """
        last = self._tick
        pose = ego_pose if self._frame == "world" else None
        tick = self._tick = Tick.after(last, detections, pose)
        if last is not None and last.ego_velocity is None and tick.ego_velocity is not None:
            for track in self._tracks:
                track.filter.velocity = tick.ego_velocity
        for track in self._tracks:
            track.filter.predict(tick.period_s)
            track.misses += 1
        self._associate(tick)
        self._tracks = [t for t in self._tracks if t.misses <= self._coast_frames]
        return self._report(tick.targets)

    def _associate(self, tick: Tick) -> None:
        """Give targets to filters (3.1) and open filters for the rest (3.2)."""
        targets = tick.targets
        predictions = np.array([t.filter.position for t in self._tracks]).reshape(-1, 2)
        places = targets.centres[:, :2]
        pairs = dict(associate_nearest(places, predictions, self._gate_m))
        for index, place in enumerate(places):
            row = targets.select(np.array([index]))
            if index not in pairs:
                self._tracks.append(self._open(place, row, tick))
                continue
            track = self._tracks[pairs[index]]
            track.filter.update(place)
            track.row, track.hits, track.misses = row, track.hits + 1, 0

    def _open(self, place: np.ndarray, row: Detections, tick: Tick) -> Track:
        """Begin with the ego's own velocity, which is the paper's 0 in the vehicle's frame."""
        velocity = np.zeros(2) if tick.ego_velocity is None else tick.ego_velocity
        period_s = tick.period_s or self._first_period_s
        kalman = ConstantVelocityFilter(self._noise, place, velocity, period_s)
        self._next_id += 1
        return Track(self._next_id - 1, kalman, row)

    def _report(self, targets: Detections) -> Tracks:
        if not self._tracks:
            return Tracks.empty(targets.stamp_s, targets.frame)
        tracks = self._tracks
        rows = [track.row for track in tracks]
        heights = [row.centres[0, 2] for row in rows]
        places = np.array([track.filter.position for track in tracks])
        return Tracks(
            ids=np.array([track.id for track in tracks]),
            centres=np.column_stack([places, heights]),
            sizes=np.concatenate([row.sizes for row in rows]),
            yaws=np.concatenate([row.yaws for row in rows]),
            velocities=np.array([track.filter.velocity for track in tracks]),
            covariances=np.array([track.filter.covariance for track in tracks]),
            categories=np.concatenate([row.categories for row in rows]),
            scores=np.concatenate([row.scores for row in rows]),
            states=np.array([self._state(track) for track in tracks], np.int8),
            frame=targets.frame,
            stamp_s=targets.stamp_s,
        )

    def _state(self, track: Track) -> TrackState:
        if track.hits < self._confirm_hits:
            return TrackState.TENTATIVE
        return TrackState.COASTING if track.misses else TrackState.CONFIRMED


def _check_positive(**lengths: float) -> None:
    for name, value in lengths.items():
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive, got {value!r}")
