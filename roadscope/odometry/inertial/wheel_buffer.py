"""The latest wheel speeds, and what they tell of a moment."""

from __future__ import annotations

import numpy as np

from roadscope.core import WheelSamples

KEPT_S = 1.0
AROUND_S = 0.05
"""Samples so near a moment tell its speed."""
LEAST_FOR_A_LINE = 4
SAMPLE_M_S, STRAY_M_S = 0.03, 0.02
"""Standard deviations of one sample by itself, and of all near a moment together: wheels slip."""


class WheelBuffer:
    """Keeps samples of the last second, in order."""

    def __init__(self) -> None:
        self.stamps_s, self.speeds = np.empty(0), np.empty(0)

    def add(self, wheels: WheelSamples) -> None:
        """Take further samples; those not later than all before are left out."""
        block = np.column_stack([wheels.stamps_s, wheels.speeds])
        if len(block) and len(self.stamps_s) and block[0, 0] < self.stamps_s[-1] - KEPT_S:
            # The clock began anew.
            self.stamps_s, self.speeds = np.empty(0), np.empty(0)
        last = self.stamps_s[-1] if len(self.stamps_s) else -np.inf
        ahead = np.maximum.accumulate(np.concatenate([[last], block[:, 0]]))[:-1]
        block = block[block[:, 0] > ahead]
        stamps_s = np.concatenate([self.stamps_s, block[:, 0]])
        kept = stamps_s >= stamps_s[-1] - KEPT_S if len(stamps_s) else slice(None)
        self.stamps_s = stamps_s[kept]
        self.speeds = np.concatenate([self.speeds, block[:, 1]])[kept]

    def at(self, stamp_s: float) -> tuple[float, float] | None:
        """Return the speed, m/s, at a moment and its variance; None without samples near it.

        It is that of the straight line through them, so that acceleration does not shift it.
        """
        near = np.abs(self.stamps_s - stamp_s) <= AROUND_S
        times, speeds = self.stamps_s[near] - stamp_s, self.speeds[near]
        if not len(times):
            return None
        middle = times - times.mean()
        spread = float(middle @ middle)
        sloped = len(times) >= LEAST_FOR_A_LINE
        slope = float(middle @ speeds) / spread if sloped else 0.0
        share = 1 / len(times) + (float(times.mean()) ** 2 / spread if sloped else 0.0)
        told = float(speeds.mean()) - slope * float(times.mean())
        return told, SAMPLE_M_S**2 * share + STRAY_M_S**2
