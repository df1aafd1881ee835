"""How a body on springs leans when its vehicle brakes and turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import require
from roadscope.core.record import Record

STANDARD_GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True, eq=False)
class BodySway(Record):
    """Pitch and roll of a sprung body as answers of second order to acceleration.

    The figures are assumptions for a calm passenger car: text books on vehicle dynamics give roll
    gradients of 2 to 7 deg/g, less for pitch, body modes of 1 to 2 Hz and a fifth to a half of
    critical damping. Uneven roads are not part of it.

    pitch_deg_per_g, roll_deg_per_g: angle in steady acceleration; the nose rises when the vehicle
        speeds up, the body leans out of a curve.
    frequency_hz, damping: of both modes, undamped, and as a share of critical damping.
    limit_m_s2: acceleration that bump stops let through at most, approached smoothly.
    memory_s: how long a jolt is felt.
    pivot_m: point of the ego frame about which the body turns.
    """

    pitch_deg_per_g: float = 1.5
    roll_deg_per_g: float = 3.0
    frequency_hz: float = 1.4
    damping: float = 0.35
    limit_m_s2: float = 8.0
    memory_s: float = 2.0
    pivot_m: tuple[float, float, float] = (1.4, 0.0, 0.4)

    def __post_init__(self) -> None:
        for name in ("pitch_deg_per_g", "roll_deg_per_g"):
            value = getattr(self, name)
            require(0 <= value <= 20, self, name, "0 to 20 deg/g", value)
        for name in ("frequency_hz", "limit_m_s2", "memory_s"):
            value = getattr(self, name)
            require(0 < value < np.inf, self, name, "a finite value above 0", value)
        require(0 < self.damping < 1, self, "damping", "a share between 0 and 1", self.damping)

    def respond(self, stamps_s: np.ndarray, accelerations: np.ndarray) -> np.ndarray:
        """(N, 2) pitch and roll in radians at (N,) stamps.

        accelerations: (N, 2) m/s^2, ahead and to the left, at the stamps; 0 before the first. Sums
        run over equal lags, so that the same history gives the same bits.
        """
        pushed = self.limit_m_s2 * np.tanh(accelerations / self.limit_m_s2)
        answer, weight = np.zeros_like(pushed), np.zeros((len(pushed), 1))
        for lag in range(1, 1 + int(np.ceil(self.memory_s / np.diff(stamps_s).min()))):
            if lag >= len(stamps_s):
                break
            felt = self._felt(stamps_s[lag:] - stamps_s[:-lag])[:, None]
            answer[lag:] += felt * pushed[:-lag]
            weight[lag:] += felt
        steady = np.radians([-self.pitch_deg_per_g, self.roll_deg_per_g]) / STANDARD_GRAVITY_M_S2
        swayed: np.ndarray = steady * answer / np.maximum(weight, 1e-9)
        return swayed

    def _felt(self, since_s: np.ndarray) -> np.ndarray:
        """Impulse response of a damped oscillator, faded out at the end of the memory."""
        omega = 2 * np.pi * self.frequency_hz
        swing = np.sin(omega * np.sqrt(1 - self.damping**2) * since_s)
        fading = np.cos(np.pi / 2 * np.minimum(since_s / self.memory_s, 1.0)) ** 2
        felt: np.ndarray = np.exp(-self.damping * omega * since_s) * swing * fading
        return felt
