"""One measured figure, and how calls are timed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np


@dataclass(frozen=True, slots=True)
class SpeedRow:
    """One measured figure.

    value: None where nothing was measured; then the unit says why.
    """

    name: str
    value: float | None
    unit: str


class SpeedStep(NamedTuple):
    """What is measured together, and its name."""

    name: str
    measure: Callable[[], list[SpeedRow]]


def interleaved(
    calls: Mapping[str, Callable[[], Any]],
    repeats: int,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, float]:
    """Return the median seconds of each call.

    clock: what is measured; `time.process_time` counts the work done, whatever else uses the core.
    The calls take turns, so that other load slows all of them; before each timed run the same call
    runs once untimed, so that its data are in the caches of the processor.
    """
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeats + 1):
        for name, call in calls.items():
            call()
            start = clock()
            call()
            times[name].append(clock() - start)
    return {name: float(np.median(values[1:])) for name, values in times.items()}
