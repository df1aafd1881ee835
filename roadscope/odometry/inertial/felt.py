"""How much speed a sensor has felt that it gained since it stood, without any scan."""

from __future__ import annotations

import numpy as np

from roadscope.odometry.inertial.filter import SPEED, InertialNoise, InertialState, propagate
from roadscope.odometry.inertial.track import Stretch

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
