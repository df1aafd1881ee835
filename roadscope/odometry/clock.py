"""The stamps of scans, and what is wrong with them."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from statistics import median

GAP_PERIODS = 2.5
"""So many periods between two scans are a gap: one lost scan is none, vehicles hardly change
their speed in 0.2 s."""

REMEMBERED = 9
"""The usual period is the median of so many: neither a gap nor a stray stamp between two scans
changes it."""

RESTART = 3
"""So many stamps in a row that are not later than the last good one: the clock began anew."""


@dataclass(frozen=True, slots=True)
class ScanTick:
    """One scan's place in time.

    elapsed_s: since the last scan in order; 0 for the first, and for one that is out of order.
    reason: what is wrong, or empty.
    in_order: whether the stamp is later than all before.
    """

    elapsed_s: float
    reason: str = ""
    in_order: bool = True


class Clock:
    """Tells from the stamps of scans how much time passed, and finds gaps and steps back.

    Where a clock that began anew soon goes on as before, it was a few stamps that were wrong.
    """

    def __init__(self) -> None:
        self.last_s = math.nan
        self._left_s, self._anew = math.inf, 0
        self._periods_s: deque[float] = deque(maxlen=REMEMBERED)
        self._late = 0

    def tick(self, stamp_s: float) -> ScanTick:
        """Take the next stamp, seconds."""
        if not math.isfinite(stamp_s):
            return ScanTick(0.0, f"a stamp of {stamp_s}", in_order=False)
        if math.isnan(self.last_s):
            self.last_s = stamp_s
            return ScanTick(0.0)
        elapsed_s = stamp_s - self.last_s
        if elapsed_s <= 0:
            self._late += 1
            if self._late >= RESTART:
                self._left_s, self.last_s, self._late = self.last_s, stamp_s, 0
                self._anew = 0
            said = "repeats the last" if elapsed_s == 0 else f"is {-elapsed_s:.3g} s before it"
            return ScanTick(0.0, f"the stamp {said}", in_order=False)
        self.last_s, self._late = stamp_s, 0
        usual_s = median(self._periods_s) if self._periods_s else math.inf
        self._anew += 1
        is_gap, since_s = elapsed_s > GAP_PERIODS * usual_s, stamp_s - self._left_s
        if is_gap and self._anew <= REMEMBERED and 0 < since_s <= (RESTART + GAP_PERIODS) * usual_s:
            self._left_s = math.inf
            return ScanTick(since_s, "the clock is again where it was before")
        self._periods_s.append(elapsed_s)
        # What passed on the other clock has passed.
        self._left_s += elapsed_s
        return ScanTick(elapsed_s, f"no scan for {elapsed_s:.3g} s" if is_gap else "")
