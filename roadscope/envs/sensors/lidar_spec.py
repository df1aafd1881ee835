"""What a LiDAR is: beams, timing, noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class LidarSpec(Record):
    """A scanning LiDAR whose beams share one azimuth per column.

    name: what it is called.
    elevations: (B,) float64, radians, increasing.
    firing_offsets_s: (B,) float64, seconds from the column's start at which each beam fires.
    azimuth_start, azimuth_span: radians; the first column's azimuth, counter-clockwise from x
        ahead, and the signed angle covered by all columns (negative: clockwise).
    columns: azimuth steps a sweep.
    period_s: time from sweep to sweep.
    sweep_s: time from first to last column, at most the period.
    range_min_m, range_max_m: returns outside are lost.
    range_noise_m: standard deviation of the measured range.
    range_resolution_m: ranges are rounded to multiples of it.
    dropout: probability that a return is lost for no reason.
    detection_limit: least reflectivity that is still seen at `range_max_m`, at normal
        incidence in clear air; the limit falls with the square of the range.
    """

    name: str
    elevations: np.ndarray
    firing_offsets_s: np.ndarray
    azimuth_start: float
    azimuth_span: float
    columns: int
    period_s: float
    sweep_s: float
    range_min_m: float
    range_max_m: float
    range_noise_m: float
    range_resolution_m: float
    dropout: float
    detection_limit: float

    def __post_init__(self) -> None:
        settle_arrays(self, elevations=(np.float64, ("B",)), firing_offsets_s=(np.float64, ("B",)))
        rising = len(self.elevations) > 0 and (np.diff(self.elevations) > 0).all()
        require(bool(rising), self, "elevations", "increasing angles", self.elevations.tolist())
        require(self.columns >= 1, self, "columns", "at least 1", self.columns)
        require(0 < self.sweep_s <= self.period_s, self, "sweep_s", "0 to period_s", self.sweep_s)
        require(
            0 <= self.range_min_m < self.range_max_m < np.inf,
            self, "range_max_m", "0 <= range_min_m < range_max_m", self.range_max_m,
        )  # fmt: skip
        for name in ("range_noise_m", "range_resolution_m", "detection_limit"):
            value = getattr(self, name)
            require(0 <= value < np.inf, self, name, "a finite value from 0 up", value)
        require(0 <= self.dropout < 1, self, "dropout", "a probability below 1", self.dropout)

    @property
    def beams(self) -> int:
        """Number of beams."""
        return len(self.elevations)

    def azimuths(self) -> np.ndarray:
        """(C,) azimuth of each column in radians."""
        return self.azimuth_start + self.azimuth_span / self.columns * np.arange(self.columns)

    def column_offsets_s(self) -> np.ndarray:
        """(C,) start of each column in seconds from the middle of the sweep."""
        return self.sweep_s * (np.arange(self.columns) / self.columns - 0.5)
