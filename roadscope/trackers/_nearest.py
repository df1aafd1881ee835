"""Nearest association and one Kalman filter for each target (Lu 2018, section 3)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from roadscope.core import Detections, Pose, Tracks, TrackState
from roadscope.core.arguments import check_counts, check_not_negative, check_positive
from roadscope.trackers._assignment import assign_greedily
from roadscope.trackers._headings import facing_ahead
from roadscope.trackers._ticks import TrackerTick

FRAMES = ("world", "ego")


@dataclass(slots=True)
class Track:
    """A filter and the last detection of one track.

    detection: the last one, a record of one row.
    hits: detections so far.
    misses: ticks since the last detection.
    """

    id: int
    filter: ConstantVelocityFilter
    detection: Detections
    hits: int = 1
    misses: int = 0


class NearestTracker:
    """Lu 2018's tracker: each target has a filter, which coasts while it has no detection.

    With `acceleration_m_s2` at 0 there is no process noise, as in the paper's eq. 8, so the gain
    falls with every frame.
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

        gate_m: greatest distance between a detection and its filter. The paper gives none; the
            centres of two vehicles cannot be nearer than the width of a vehicle.
        coast_frames: ticks without a detection that a filter outlives. The paper says a few, and
            its longest occlusion is 13; before and after it the target is partly occluded and not
            detected for some more.
        confirm_hits: detections after which a track is confirmed; 1, as in the paper, confirms
            it at once.
        sigma_p_m, sigma_m_m: the paper's, see `FilterNoise`.
        acceleration_m_s2: see `FilterNoise`.
        frame: `world` tracks in the world frame whenever the ego pose is known (velocities are not
            constant in the frame of a turning vehicle); `ego` tracks in the ego frame, as the
            paper does.
        period_s: T of eq. 14 for tracks of the first tick; that of the LUX, 12.5 Hz.
        """
        check_positive(gate_m=gate_m, sigma_p_m=sigma_p_m, sigma_m_m=sigma_m_m, period_s=period_s)
        check_counts(1, confirm_hits=confirm_hits)
        check_counts(0, coast_frames=coast_frames)
        check_not_negative(acceleration_m_s2=acceleration_m_s2)
        if frame not in FRAMES:
            raise ValueError(f"no frame '{frame}'; possible: {', '.join(FRAMES)}")
        self._gate_m, self._coast_frames, self._confirm_hits = gate_m, coast_frames, confirm_hits
        self._noise = FilterNoise(sigma_p_m, sigma_m_m, acceleration_m_s2)
        self._frame, self._first_period_s = frame, period_s
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tracks: list[Track] = []
        self._next_id = 0
        self._tick: TrackerTick | None = None

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick, coasting ones included.

        Raises `ValueError` if stamps do not increase, or if the pose is given at some updates only.
        """
        last = self._tick
        pose = ego_pose if self._frame == "world" else None
        tick = self._tick = TrackerTick.after(last, detections, pose)
        if last is not None and last.ego_velocity is None and tick.ego_velocity is not None:
            for track in self._tracks:
                track.filter.velocity = tick.ego_velocity
        for track in self._tracks:
            track.filter.predict(tick.period_s)
            track.misses += 1
        self._associate(tick)
        self._tracks = [t for t in self._tracks if t.misses <= self._coast_frames]
        return self._report(tick)

    def _associate(self, tick: TrackerTick) -> None:
        """Correct filters by their detections (3.1) and start filters for the rest (3.2)."""
        predictions = np.array([t.filter.position for t in self._tracks]).reshape(-1, 2)
        positions = tick.detections.centres[:, :2]
        pairs = dict(associate_nearest(positions, predictions, self._gate_m))
        for index, position in enumerate(positions):
            detection = tick.detections.select(np.array([index]))
            if index not in pairs:
                self._tracks.append(self._started(position, detection, tick))
                continue
            track = self._tracks[pairs[index]]
            track.filter.update(position)
            track.detection, track.hits, track.misses = detection, track.hits + 1, 0

    def _started(self, position: np.ndarray, detection: Detections, tick: TrackerTick) -> Track:
        """Return a new track at the ego's velocity: relative to the ego that is the paper's 0."""
        velocity = np.zeros(2) if tick.ego_velocity is None else tick.ego_velocity
        period_s = tick.period_s or self._first_period_s
        kalman = ConstantVelocityFilter(self._noise, position, velocity, period_s)
        self._next_id += 1
        return Track(self._next_id - 1, kalman, detection)

    def _report(self, tick: TrackerTick) -> Tracks:
        if not self._tracks:
            return Tracks.empty(tick.stamp_s, tick.frame)
        last = [track.detection for track in self._tracks]
        heights = [detection.centres[0, 2] for detection in last]
        positions = np.array([track.filter.position for track in self._tracks])
        tracks = Tracks(
            ids=np.array([track.id for track in self._tracks]),
            centres=np.column_stack([positions, heights]),
            sizes=np.concatenate([detection.sizes for detection in last]),
            yaws=np.concatenate([detection.yaws for detection in last]),
            velocities=np.array([track.filter.velocity for track in self._tracks]),
            covariances=np.array([track.filter.covariance for track in self._tracks]),
            categories=np.concatenate([detection.categories for detection in last]),
            scores=np.concatenate([detection.scores for detection in last]),
            states=np.array([self._state(track) for track in self._tracks], np.int8),
            frame=tick.frame,
            stamp_s=tick.stamp_s,
        )
        return facing_ahead(tracks)

    def _state(self, track: Track) -> TrackState:
        if track.hits < self._confirm_hits:
            return TrackState.TENTATIVE
        return TrackState.COASTING if track.misses else TrackState.CONFIRMED


def associate_nearest(
    positions: np.ndarray, predictions: np.ndarray, gate_m: float
) -> list[tuple[int, int]]:
    """Return pairs of (N, 2) detected positions and (M, 2) predictions within a gate (eq. 5).

    They are in the order of predictions. In the paper each target in turn takes its nearest free
    filter, so the result depends on the order of targets. Our reading: the pair with the smallest
    distance of all is taken first. Of equal distances that of the earlier filter is taken, then
    that of the earlier target.
    """
    distances = np.hypot(*(predictions[:, None] - positions).transpose(2, 0, 1))
    columns, rows = assign_greedily(distances, gate_m)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
"""Eq. 13: the state is (x, vx, y, vy)."""
PLANAR_ORDER = np.ix_([0, 2, 1, 3], [0, 2, 1, 3])
"""From (x, vx, y, vy) to the order (x, y, vx, vy) of `Tracks`."""


@dataclass(frozen=True, slots=True)
class FilterNoise:
    """The noise of a filter.

    sigma_p_m, sigma_m_m: standard deviations of a new position and of a measurement (below eq. 15).
        The paper calls the first that of the process noise, but uses it in eq. 14 only.
    acceleration_m_s2: standard deviation of a random acceleration that is constant between two
        frames; 0 is the paper's eq. 8, which has no process noise.
    """

    sigma_p_m: float
    sigma_m_m: float
    acceleration_m_s2: float


class ConstantVelocityFilter:
    """Kalman filter of one target at constant velocity (section 3.3)."""

    def __init__(
        self, noise: FilterNoise, position: np.ndarray, velocity: np.ndarray, period_s: float
    ) -> None:
        """Start at a measured (2,) position with a guess of the (2,) velocity."""
        self._noise, self._R = noise, noise.sigma_m_m**2 * np.eye(2)
        self._x = np.array([position[0], velocity[0], position[1], velocity[1]])
        self._P = initial_covariance(noise.sigma_p_m, period_s)

    @property
    def position(self) -> np.ndarray:
        """(2,) x, y in metres."""
        return self._x[[0, 2]]

    @property
    def velocity(self) -> np.ndarray:
        """(2,) vx, vy in m/s."""
        return self._x[[1, 3]]

    @velocity.setter
    def velocity(self, velocity: np.ndarray) -> None:
        self._x[[1, 3]] = velocity

    @property
    def covariance(self) -> np.ndarray:
        """(4, 4) of x, y, vx, vy."""
        return self._P[PLANAR_ORDER]

    def predict(self, period_s: float) -> None:
        """Advance by one period (eq. 16 and 8)."""
        A, Q = transition(period_s), process_noise(self._noise.acceleration_m_s2, period_s)
        self._x = A @ self._x
        self._P = A @ self._P @ A.T + Q

    def update(self, position: np.ndarray) -> None:
        """Correct by a measured (2,) position (eq. 9 to 11; eq. 11 in Joseph's stable form)."""
        PHT = self._P @ H.T
        K = PHT @ np.linalg.inv(H @ PHT + self._R)
        self._x = self._x + K @ (position - H @ self._x)
        rest = np.eye(4) - K @ H
        self._P = rest @ self._P @ rest.T + K @ self._R @ K.T


@lru_cache(maxsize=8)
def transition(T: float) -> np.ndarray:
    """Return A, (4, 4), for a period T in seconds (eq. 12)."""
    return _for_both_axes(1.0, T, 0.0, 1.0)


def initial_covariance(sigma_p: float, T: float) -> np.ndarray:
    """Return P, (4, 4), of a new filter (eq. 14); T: period in seconds."""
    return _for_both_axes(1.0, 1 / T, 1 / T, 2 / T**2) * sigma_p**2


@lru_cache(maxsize=8)
def process_noise(acceleration: float, T: float) -> np.ndarray:
    """Return Q, (4, 4), of a random acceleration, m/s2, that is constant for one period T, s."""
    return _for_both_axes(T**4 / 4, T**3 / 2, T**3 / 2, T**2) * acceleration**2


def _for_both_axes(a: float, b: float, c: float, d: float) -> np.ndarray:
    """Return a (4, 4) matrix with the 2 x 2 block of one axis twice on its diagonal."""
    return np.array([[a, b, 0, 0], [c, d, 0, 0], [0, 0, a, b], [0, 0, c, d]])
