"""A buffer of the latest wheel speeds."""

from __future__ import annotations

import numpy as np

from roadscope.core import WheelSamples

BUFFER_S = 1.0
"""Time for which samples are stored."""
AROUND_S = 0.05
"""Samples within this time of an instant give its speed."""
LEAST_FOR_A_LINE = 4
"""Samples from which on a line is fitted to their speeds; fewer are averaged."""
SAMPLE_M_S, STRAY_M_S = 0.03, 0.02
"""Standard deviations of a single sample, and of a common error of neighbours: wheels slip."""


class WheelBuffer:
    """Stores samples of the last second, in order."""

    def __init__(self) -> None:
        self.stamps_s, self.speeds = np.empty(0), np.empty(0)

    def add(self, wheels: WheelSamples) -> None:
        """Add samples; those that are not later than all earlier ones are left out."""
        block = np.column_stack([wheels.stamps_s, wheels.speeds])
        if len(block) and len(self.stamps_s) and block[0, 0] < self.stamps_s[-1] - BUFFER_S:
            # The clock was reset.
            self.stamps_s, self.speeds = np.empty(0), np.empty(0)
        last = self.stamps_s[-1] if len(self.stamps_s) else -np.inf
        ahead = np.maximum.accumulate(np.concatenate([[last], block[:, 0]]))[:-1]
        block = block[block[:, 0] > ahead]
        stamps_s = np.concatenate([self.stamps_s, block[:, 0]])
        recent = stamps_s >= stamps_s[-1] - BUFFER_S if len(stamps_s) else slice(None)
        self.stamps_s = stamps_s[recent]
        self.speeds = np.concatenate([self.speeds, block[:, 1]])[recent]

    def at(self, stamp_s: float) -> tuple[float, float] | None:
        """Return the speed, m/s, at an instant and its variance; None without samples near it.

        It is read from a line fitted to the samples, so that acceleration does not bias it; from
        the mean of fewer than `LEAST_FOR_A_LINE`.
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
        speed = float(speeds.mean()) - slope * float(times.mean())
        return speed, SAMPLE_M_S**2 * share + STRAY_M_S**2
