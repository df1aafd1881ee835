"""Samples of the wheel speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class WheelSamples(Record):
    """A block of speeds of the rear axle, measured by the wheels.

    stamps_s: (K,) float64, seconds since reset.
    speeds: (K,) float64, m/s along the vehicle, negative backwards.
    """

    stamps_s: np.ndarray
    speeds: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, stamps_s=(np.float64, ("K",)), speeds=(np.float64, ("K",)))
