"""One measured figure, and how calls are timed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class SpeedRow:
    """One measured figure.

    value: None where nothing was measured; then the unit says why.
    ratio: how many times that is what was measured beside it, whose name is `beside`.
    """

    name: str
    value: float | None
    unit: str
    ratio: float | None = None
    beside: str = ""


Step = tuple[str, Callable[[], list[SpeedRow]]]
"""What is measured together, by name."""


def interleaved(
    calls: Mapping[str, Callable[[], Any]],
    repeats: int,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, float]:
    """Median seconds of each call.

    clock: what is measured; `time.process_time` for the work done, whoever else uses the core.
    The calls take turns, so that other load hits all alike; before each timed run the same call
    runs once untimed, so that each finds its own data in the processor's caches.
    """
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeats + 1):
        for name, call in calls.items():
            call()
            start = clock()
            call()
            times[name].append(clock() - start)
    return {name: float(np.median(values[1:])) for name, values in times.items()}
