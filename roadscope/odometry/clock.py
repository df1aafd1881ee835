"""Checks of the stamps of scans."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from statistics import median

GAP_PERIODS = 2.5
"""Two scans are separated by a gap if more than so many periods lie between them. One lost scan is
no gap, since speeds hardly change in 0.2 s."""

PERIODS = 9
"""The usual period is the median of the last so many: a gap or a wrong stamp does not change it."""

RESTART = 3
"""After so many stamps in a row that are not later than the last one in order, the clock is assumed
to have been reset."""


@dataclass(frozen=True, slots=True)
class ScanTick:
    """The time of one scan.

    elapsed_s: time since the last scan in order; 0 for the first, and for one out of order.
    reason: what is wrong with the stamp, or empty.
    in_order: whether the stamp is later than all earlier ones since the clock was reset.
    """

    elapsed_s: float
    reason: str = ""
    in_order: bool = True


class Clock:
    """Computes elapsed times from the stamps of scans, and detects gaps and resets.

    If stamps soon after a reset continue as before it, the clock was not reset: a few stamps were
    wrong.
    """

    def __init__(self) -> None:
        self.last_s = math.nan
        self._old_clock_s, self._since_restart = math.inf, 0
        self._periods_s: deque[float] = deque(maxlen=PERIODS)
        self._stamps_back = 0

    def tick(self, stamp_s: float) -> ScanTick:
        """Return the time of the scan with the next stamp, seconds."""
        if not math.isfinite(stamp_s):
            return ScanTick(0.0, f"a stamp of {stamp_s}", in_order=False)
        if math.isnan(self.last_s):
            self.last_s = stamp_s
            return ScanTick(0.0)
        elapsed_s = stamp_s - self.last_s
        if elapsed_s <= 0:
            self._stamps_back += 1
            if self._stamps_back >= RESTART:
                self._old_clock_s, self.last_s, self._stamps_back = self.last_s, stamp_s, 0
                self._since_restart = 0
            problem = "repeats the last" if elapsed_s == 0 else f"is {-elapsed_s:.3g} s before it"
            return ScanTick(0.0, f"the stamp {problem}", in_order=False)
        self.last_s, self._stamps_back = stamp_s, 0
        usual_s = median(self._periods_s) if self._periods_s else math.inf
        self._since_restart += 1
        is_gap, since_s = elapsed_s > GAP_PERIODS * usual_s, stamp_s - self._old_clock_s
        if (
            is_gap
            and self._since_restart <= PERIODS
            and 0 < since_s <= (RESTART + GAP_PERIODS) * usual_s
        ):
            self._old_clock_s = math.inf
            return ScanTick(since_s, "the clock is again where it was before")
        self._periods_s.append(elapsed_s)
        # Without the reset the clock would have advanced by the same time.
        self._old_clock_s += elapsed_s
        return ScanTick(elapsed_s, f"no scan for {elapsed_s:.3g} s" if is_gap else "")
