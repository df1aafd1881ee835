"""A Kalman filter of where targets are, seen from above."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from roadscope.core import Category, Detections, Family
from roadscope.trackers.kalman import Gaussians, corrected
from roadscope.trackers.motion import ConstantVelocity, Motion, Start, carried
from roadscope.trackers.settings import check_positive

SPEED_SHARES = {Family.VEHICLE: 1.0, Family.CYCLIST: 0.4, Family.PEDESTRIAN: 0.15}
"""How fast road users are, vehicles being 1."""
SHARES = np.array([SPEED_SHARES[category.family] for category in Category])
"""The same for each value of `Category`."""


@dataclass(frozen=True, slots=True)
class PlaceFilter:
    """Any motion model, with the x and y of a detection's centre as the measurement.

    position_m: standard deviation of the measurement along each axis.
    speed_m_s: standard deviation of a new vehicle's velocity along each axis; cyclists' and
        pedestrians' by `SPEED_SHARES`.
    """

    position_m: float = 0.3
    speed_m_s: float = 15.0
    motion: Motion = field(default_factory=ConstantVelocity)

    def __post_init__(self) -> None:
        check_positive(position_m=self.position_m, speed_m_s=self.speed_m_s)

    @property
    def dimensions(self) -> int:
        """Length D of the state."""
        return self.motion.dimensions

    @property
    def H(self) -> np.ndarray:  # noqa: N802
        """(2, D): a detection shows x and y."""
        return np.eye(2, self.dimensions)

    @property
    def R(self) -> np.ndarray:  # noqa: N802
        """(2, 2) covariance of a measurement."""
        return self.position_m**2 * np.eye(2)

    def started(self, targets: Detections) -> Gaussians:
        """Begin with (N,) detections, at rest more or less."""
        speeds = self.speed_m_s * SHARES[targets.categories]
        places = targets.centres[:, :2]
        return self.motion.started(Start(places, targets.yaws, self.position_m, speeds))

    def predicted(self, beliefs: Gaussians, dt: float) -> Gaussians:
        """Move beliefs on by dt seconds."""
        return carried(self.motion, beliefs, dt)

    def expected(self, beliefs: Gaussians) -> np.ndarray:
        """Return (N, 2, 2) covariances of the places at which detections are expected, S."""
        S: np.ndarray = beliefs.covariances[:, :2, :2] + self.R
        return S

    def corrected(self, beliefs: Gaussians, places: np.ndarray) -> Gaussians:
        """Take a measured place for each, (N, 2)."""
        return corrected(beliefs, places, self.H, self.R)

    def planar(self, beliefs: Gaussians) -> Gaussians:
        """Return beliefs of x, y, vx, vy."""
        return self.motion.planar(beliefs)
