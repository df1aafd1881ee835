"""Detection of standstill, and the states of a sensor at rest."""

from __future__ import annotations

from collections import deque

import numpy as np

from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.inertial.filter import SPEED, InertialNoise, InertialState, propagate
from roadscope.odometry.inertial.track import ImuInterval, InertialTrack

# --------------------------------------------------------------------------------------------------
# Detection of rest: constant inertial samples.

WINDOW_S, BLOCK_S = 1.0, 0.1
"""Samples are at rest if the means of all blocks of a window are alike; lengths of both."""
STANDSTILL_SIGMAS = 3.8
"""Largest deviation of the means of blocks from that of the window, in deviations of the noise.
Driving vehicles exceed it unless they drive straight at constant speed for a second."""
TURNING_RAD_S = 0.05
"""A constant rate above this is a turn: no gyro has such a bias."""


def measured_rest(
    samples: ImuBuffer, now_s: float, noise: InertialNoise, window_s: float = WINDOW_S
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the mean rate, (3,) rad/s, and force, (3,) m/s^2, if both were constant; else None."""
    if not samples.covers(now_s - window_s, now_s):
        return None
    _, rates, forces = samples.within(now_s - window_s, now_s)
    blocks = max(round(window_s / BLOCK_S), 1)
    usable = len(rates) // blocks * blocks
    if not usable:
        return None
    means = np.hstack([rates, forces])[:usable].reshape(blocks, -1, 6).mean(axis=1)
    mean = means.mean(axis=0)
    deviation = np.abs(means - mean).max(axis=0)
    most = STANDSTILL_SIGMAS / np.sqrt(BLOCK_S)
    quiet = deviation[:3].max() < most * noise.rate and deviation[3:].max() < most * noise.force
    still = quiet and np.abs(mean[:3]).max() < TURNING_RAD_S
    return (mean[:3], mean[3:]) if still else None


# --------------------------------------------------------------------------------------------------
# States during a rest, to return to after it has ended.

DOUBTED_S = 1.5
"""A vehicle pulls away gradually: for a second or more its acceleration cannot be distinguished
from noise and would be learned as a bias."""
RECENT_S, COMPARED_S = 0.5, 2.5
"""Length of the recent interval that is compared with the time before, and length of both."""
REST_SIGMAS = 4.0
"""Largest difference of both, in standard deviations."""
NEAR_M, DOUBT_M = 3.0, 0.3
"""Other vehicles at rest cannot be distinguished from static objects until the sensor has moved
this far; until then everything in the map has this standard deviation of a common motion."""


class RestHistory:
    """Stores states of the last seconds of a rest, each with the interval before it."""

    def __init__(self, noise: InertialNoise) -> None:
        self.noise = noise
        self._states: list[tuple[InertialState, ImuInterval]] = []
        self._samples: deque[tuple[float, np.ndarray]] = deque()
        self._left_s, self._place = -np.inf, np.full(3, np.inf)

    @property
    def is_empty(self) -> bool:
        """Whether no state of rest is stored yet."""
        return not self._states

    def may_continue(self, interval: ImuInterval, now_s: float) -> bool:
        """Return whether the interval until now may be a rest: its samples equal the earlier ones.

        A sensor that has just left does not rest again at once.
        """
        if not len(interval.lengths_s) or now_s < self._left_s + DOUBTED_S:
            return False
        self._samples.append((interval.elapsed_s, interval.lengths_s @ interval.forces))
        while sum(length for length, _ in self._samples) > COMPARED_S:
            self._samples.popleft()
        lengths = np.array([length for length, _ in self._samples])
        gained = np.array([each for _, each in self._samples])
        late = np.cumsum(lengths[::-1])[::-1] <= RECENT_S + 1e-3
        late_s, early_s = float(lengths[late].sum()), float(lengths[~late].sum())
        if min(late_s, early_s) < RECENT_S / 2:
            return True
        off = gained[late].sum(axis=0) / late_s - gained[~late].sum(axis=0) / early_s
        noise, walk = self.noise.force**2, self.noise.force_walk**2
        variance = noise * (1 / late_s + 1 / early_s) + walk * (late_s + early_s) / 2
        return bool(np.abs(off).max() < REST_SIGMAS * np.sqrt(variance))

    def doubt_m(self, track: InertialTrack) -> float:
        """Return the standard deviation of a common motion of everything in the map, metres."""
        distance_m = float(np.linalg.norm(track.state.pose[:3, 3] - self._place))
        return DOUBT_M if distance_m < NEAR_M and not self._states else 0.0

    def add(self, track: InertialTrack, interval: ImuInterval) -> None:
        """Store the state of a sensor at rest at the end of an interval."""
        self._states.append((track.state.copied(), interval))
        self._place = track.state.pose[:3, 3].copy()
        while sum(each.elapsed_s for _, each in self._states[1:]) > DOUBTED_S:
            del self._states[0]

    def end(self, track: InertialTrack, interval: ImuInterval, now_s: float) -> bool:
        """End the rest: return to the oldest stored state and predict from there.

        Returns whether the sensor was at rest until now.
        """
        self._samples.clear()
        if not self._states:
            return False
        track.state = self._states[0][0]
        for _, each in self._states[1:]:
            track.predict(each)
        track.predict(interval)
        self._states, self._left_s = [], now_s
        return True


# --------------------------------------------------------------------------------------------------
# The speed gained since a rest by inertial samples alone.

LEAST_M_S, DEVIATIONS = 1.0, 3.0
"""Allowances for errors of the gained speed. A vehicle can reach the first before its start is
noticed; the second is a number of standard deviations."""


class IntegratedSpeed:
    """Predicts the state of a rest by inertial samples alone, without scans.

    A rest determines biases and gravity so well that half a minute later the speed is known to
    2 m/s. Traffic that moves along, and smooth walls, seem to show a sensor at rest; but vehicles
    drive forward, so that the speed is at least the gained one, even if the sensor was not at rest
    but driving steadily.
    """

    def __init__(self, noise: InertialNoise) -> None:
        self.noise = noise
        self._state: InertialState | None = None

    def start_from_rest(self, state: InertialState) -> None:
        """Start from the state of a sensor at rest."""
        self._state = state.copied()

    def predict(self, interval: ImuInterval) -> None:
        """Predict the state at the next stamp; without samples it becomes unknown."""
        if self._state is None or not interval.elapsed_s:
            return
        if len(interval.lengths_s):
            propagate(self._state, interval.lengths_s, interval.rates, interval.forces, self.noise)
        else:
            self._state = None

    @property
    def gained_m_s(self) -> float:
        """Gained speed ahead, m/s; minus infinity if unknown."""
        if self._state is None:
            return -np.inf
        return float(self._state.pose[:3, 0] @ self._state.velocity)

    @property
    def least_m_s(self) -> float:
        """Lower bound of the speed ahead, m/s; minus infinity if unknown."""
        if self._state is None:
            return -np.inf
        ahead = self._state.pose[:3, 0]
        variance = float(ahead @ self._state.covariance[SPEED, SPEED] @ ahead)
        return self.gained_m_s - LEAST_M_S - DEVIATIONS * float(np.sqrt(variance))
