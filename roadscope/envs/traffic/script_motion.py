"""Smooth closed-form motion for scripted experiments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Change = tuple[float, float, float]
"""Start in seconds, duration in seconds, and how much changes."""


@dataclass(frozen=True, slots=True)
class Motion:
    """The way of a rear axle: speeds and lanes change by quintic smoothsteps.

    x_m, y_m: place at time 0, world frame, had nothing changed.
    speed: speed along x at the beginning, m/s.
    speed_changes, lane_changes: what is added to the speed along x, m/s, and to y, metres.

    Position is three times continuously differentiable, so yaw and yaw rate never jump.
    """

    x_m: float
    y_m: float
    speed: float
    speed_changes: tuple[Change, ...] = ()
    lane_changes: tuple[Change, ...] = ()

    def places(self, times: np.ndarray) -> np.ndarray:
        """Return (T, 2) places of the rear axle in metres."""
        x = self.x_m + self.speed * times
        y = np.full_like(times, self.y_m)
        for start, duration, change in self.speed_changes:
            x = x + change * duration * _ramp((times - start) / duration)
        for start, duration, change in self.lane_changes:
            y = y + change * _step((times - start) / duration)
        return np.stack([x, y], axis=-1)

    def velocities(self, times: np.ndarray) -> np.ndarray:
        """Return (T, 2) velocities in m/s."""
        vx = np.full_like(times, self.speed)
        vy = np.zeros_like(times)
        for start, duration, change in self.speed_changes:
            vx = vx + change * _step((times - start) / duration)
        for start, duration, change in self.lane_changes:
            vy = vy + change / duration * _slope((times - start) / duration)
        return np.stack([vx, vy], axis=-1)


def _step(u: np.ndarray) -> np.ndarray:
    """Rise from 0 to 1 as the quintic smoothstep does."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def _slope(u: np.ndarray) -> np.ndarray:
    """Differentiate `_step`."""
    u = np.clip(u, 0.0, 1.0)
    return 30.0 * u**2 * (1.0 - u) ** 2


def _ramp(u: np.ndarray) -> np.ndarray:
    """Integrate `_step` from 0."""
    inside = np.clip(u, 0.0, 1.0)
    area: np.ndarray = inside**4 * (2.5 - 3.0 * inside + inside**2) + np.maximum(u - 1.0, 0.0)
    return area
