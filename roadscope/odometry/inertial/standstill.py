"""Whether a sensor stands, and what is kept of the time when it stood."""

from __future__ import annotations

from collections import deque

import numpy as np

from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.inertial.filter import SPEED, InertialNoise, InertialState, propagate
from roadscope.odometry.inertial.track import InertialTrack, Stretch

# --------------------------------------------------------------------------------------------------
# Whether an inertial unit stands: nothing changes in what it feels.

WINDOW_S, BLOCK_S = 1.0, 0.1
STANDSTILL_SIGMAS = 3.8
"""Means over blocks may stray so many deviations of the noise from that of the window. Vehicles
that drive are felt more, unless they drive straight at one speed for a second."""
TURNING_RAD_S = 0.05
"""A steadier turn than any gyro's bias is a turn."""


def felt_still(
    samples: ImuBuffer, now_s: float, noise: InertialNoise, window_s: float = WINDOW_S
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return means over the last seconds if nothing changed in them, or None.

    Rate, (3,) rad/s, and force, (3,) m/s^2.
    """
    if not samples.covers(now_s - window_s, now_s):
        return None
    _, rates, forces = samples.within(now_s - window_s, now_s)
    blocks = max(round(window_s / BLOCK_S), 1)
    usable = len(rates) // blocks * blocks
    if not usable:
        return None
    felt = np.hstack([rates, forces])[:usable].reshape(blocks, -1, 6).mean(axis=1)
    mean = felt.mean(axis=0)
    stray = np.abs(felt - mean).max(axis=0)
    most = STANDSTILL_SIGMAS / np.sqrt(BLOCK_S)
    quiet = stray[:3].max() < most * noise.rate and stray[3:].max() < most * noise.force
    still = quiet and np.abs(mean[:3]).max() < TURNING_RAD_S
    return (mean[:3], mean[3:]) if still else None


# --------------------------------------------------------------------------------------------------
# What was held while a sensor stood, to go back to once it has left.

DOUBTED_S = 1.5
"""Who pulls away does so from nothing: for a second or more it is not told from noise, and
meanwhile its acceleration passes for a bias."""
RECENT_S, COMPARED_S = 0.5, 2.5
"""How long is felt what is compared with what was felt before, and how long both together."""
REST_SIGMAS = 4.0
"""Standard deviations."""
NEAR_M, DOUBT_M = 3.0, 0.3
"""Traffic that stood as well cannot be told from the world before it is seen from places so far
apart; until then it may have moved along."""


class Rest:
    """Keeps states of the last seconds of a rest, each with the stretch that it ended."""

    def __init__(self, noise: InertialNoise) -> None:
        self.noise = noise
        self._kept: list[tuple[InertialState, Stretch]] = []
        self._felt: deque[tuple[float, np.ndarray]] = deque()
        self._left_s, self._place = -np.inf, np.full(3, np.inf)

    @property
    def begins(self) -> bool:
        """Whether the sensor is not held to stand yet."""
        return not self._kept

    def may_be(self, stretch: Stretch, now_s: float) -> bool:
        """Say whether a stretch until now may be one of rest: it is felt as those before were.

        Who has just left does not stand again at once.
        """
        if not len(stretch.lengths_s) or now_s < self._left_s + DOUBTED_S:
            return False
        self._felt.append((stretch.elapsed_s, stretch.lengths_s @ stretch.forces))
        while sum(length for length, _ in self._felt) > COMPARED_S:
            self._felt.popleft()
        lengths = np.array([length for length, _ in self._felt])
        gained = np.array([each for _, each in self._felt])
        late = np.cumsum(lengths[::-1])[::-1] <= RECENT_S + 1e-3
        late_s, early_s = float(lengths[late].sum()), float(lengths[~late].sum())
        if min(late_s, early_s) < RECENT_S / 2:
            return True
        off = gained[late].sum(axis=0) / late_s - gained[~late].sum(axis=0) / early_s
        noise, walk = self.noise.force**2, self.noise.force_walk**2
        variance = noise * (1 / late_s + 1 / early_s) + walk * (late_s + early_s) / 2
        return bool(np.abs(off).max() < REST_SIGMAS * np.sqrt(variance))

    def doubt_m(self, track: InertialTrack) -> float:
        """Return how far what was seen in the rest may have moved together since it ended."""
        way_m = float(np.linalg.norm(track.state.pose[:3, 3] - self._place))
        return DOUBT_M if way_m < NEAR_M and not self._kept else 0.0

    def held(self, track: InertialTrack, stretch: Stretch) -> None:
        """Take it that the sensor stands at the end of a stretch."""
        self._kept.append((track.state.copied(), stretch))
        self._place = track.state.pose[:3, 3].copy()
        while sum(each.elapsed_s for _, each in self._kept[1:]) > DOUBTED_S:
            del self._kept[0]

    def left(self, track: InertialTrack, stretch: Stretch, now_s: float) -> bool:
        """Take it that the sensor stands no longer, and that since when is not known.

        Say whether it stood until now.
        """
        self._felt.clear()
        if not self._kept:
            return False
        track.state = self._kept[0][0]
        for _, each in self._kept[1:]:
            track.predict(each)
        track.predict(stretch)
        self._kept, self._left_s = [], now_s
        return True


# --------------------------------------------------------------------------------------------------
# How much speed a sensor has felt that it gained since it stood, without any scan.

LEAST_M_S, DEVIATIONS = 1.0, 3.0
"""How far off what is felt may be: what the end of a rest hides, and so many deviations."""


class FeltSpeed:
    """Carries the state of a rest on by samples alone: what scans say is not let in.

    A rest tells biases and what is down so well that half a minute later the speed is known to
    2 m/s. Traffic that keeps its place, and walls that fade away along the road, say that nothing
    moves; but vehicles drive ahead, so that nobody is slower than what he gained: be it that he
    did not stand, but drove steadily.
    """

    def __init__(self, noise: InertialNoise) -> None:
        self.noise = noise
        self._state: InertialState | None = None

    def stood(self, state: InertialState) -> None:
        """Begin from a state of which scans said nothing since the sensor stood."""
        self._state = state.copied()

    def predict(self, stretch: Stretch) -> None:
        """Go on to the next stamp; without samples nothing is known any more."""
        if self._state is None or not stretch.elapsed_s:
            return
        if len(stretch.lengths_s):
            propagate(self._state, stretch.lengths_s, stretch.rates, stretch.forces, self.noise)
        else:
            self._state = None

    @property
    def gained_m_s(self) -> float:
        """Return the speed ahead that was gained; minus infinity if that is not known."""
        if self._state is None:
            return -np.inf
        return float(self._state.pose[:3, 0] @ self._state.velocity)

    @property
    def least_m_s(self) -> float:
        """Return how fast the sensor is at least."""
        if self._state is None:
            return -np.inf
        ahead = self._state.pose[:3, 0]
        variance = float(ahead @ self._state.covariance[SPEED, SPEED] @ ahead)
        return self.gained_m_s - LEAST_M_S - DEVIATIONS * float(np.sqrt(variance))
