"""Specifications of LiDARs: beams, timing, noise; presets of products."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from roadscope.core.bounds import Bounds
from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record

# --------------------------------------------------------------------------------------------------
# Specification.


@dataclass(frozen=True, slots=True, eq=False)
class LidarSpec(Record):
    """A scanning LiDAR whose beams share one azimuth per column.

    elevations: (B,) float64, radians, increasing.
    firing_offsets_s: (B,) float64, seconds from the column's start at which each beam fires.
    azimuth_start, azimuth_span: radians; the first column's azimuth, counter-clockwise from x
        ahead, and the signed angle covered by all columns (negative: clockwise).
    columns: azimuth steps of a sweep.
    period_s: time from sweep to sweep.
    sweep_s: time from first to last column, at most the period.
    range_min_m, range_max_m: returns outside are lost.
    range_noise_m: standard deviation of the measured range.
    range_resolution_m: ranges are rounded to multiples of it.
    dropout: probability that a return is lost at random.
    detection_limit: least reflectivity that is still detected at `range_max_m`, at normal
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
            self,
            "range_max_m",
            "0 <= range_min_m < range_max_m",
            self.range_max_m,
        )
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


# --------------------------------------------------------------------------------------------------
# LiDARs on the market, from their makers' documents.

DROPOUT = 0.002
"""No maker states the share of lost returns; the same small share is assumed for all."""


def _spinning(
    name: str,
    elevations_deg: np.ndarray,
    firing_offsets_s: np.ndarray,
    *,
    columns: int,
    range_m: Bounds,
    range_noise_m: float,
    range_resolution_m: float,
    detection_limit: float,
) -> LidarSpec:
    """Return a LiDAR with ten turns a second, clockwise from above, beginning at the rear."""
    order = np.argsort(elevations_deg)
    return LidarSpec(
        name=name,
        elevations=np.radians(elevations_deg[order]),
        firing_offsets_s=firing_offsets_s[order],
        azimuth_start=np.pi,
        azimuth_span=-2 * np.pi,
        columns=columns,
        period_s=0.1,
        sweep_s=0.1,
        range_min_m=range_m.low,
        range_max_m=range_m.high,
        range_noise_m=range_noise_m,
        range_resolution_m=range_resolution_m,
        dropout=DROPOUT,
        detection_limit=detection_limit,
    )


def _lux() -> LidarSpec:
    """Return the LUX by ibeo, four layers of 0.8 degrees.

    110 degrees in steps of 0.25, 12.5 Hz, 200 m: Lu 2018, table 1. Layers, accuracy of 10 cm,
    steps of 4 cm and 10 % remission at 50 m on average are ascribed to the ibeo LUX 2010 data
    sheet, which we could not check; the accuracy is read as the standard deviation of the
    measured range. The mirror turns evenly, so the field of view takes 110/360 of a turn; the
    four layers share one pulse. The real field is turned by 5 degrees to the right; here it is
    symmetric.
    """
    columns = 440
    turn_s = 1 / 12.5
    return LidarSpec(
        name="lux",
        elevations=np.radians([-1.2, -0.4, 0.4, 1.2]),
        firing_offsets_s=np.zeros(4),
        azimuth_start=np.radians(55.0),
        azimuth_span=-np.radians(110.0),
        columns=columns,
        period_s=turn_s,
        sweep_s=turn_s * 110 / 360,
        range_min_m=0.3,
        range_max_m=200.0,
        range_noise_m=0.10,
        range_resolution_m=0.04,
        dropout=DROPOUT,
        detection_limit=0.1 * (200 / 50) ** 2,
    )


def _vlp16() -> LidarSpec:
    """Return the Velodyne VLP-16: user manual 63-9243 Rev. D, section 9.3 and 9.4.

    One beam every 2.304 us in turn from below and above, a round every 55.296 us; 100 m, 3 cm,
    steps of 2 mm. The manual names no reflectivity: 10 % at half its range is assumed.
    """
    fired = np.arange(16)
    elevations = np.where(fired % 2 == 0, fired - 15.0, fired)
    return _spinning(
        "vlp16",
        elevations,
        fired * 2.304e-6,
        columns=1808,
        range_m=Bounds(0.9, 100.0),
        range_noise_m=0.03,
        range_resolution_m=0.002,
        detection_limit=0.1 * (100 / 50) ** 2,
    )


def _hdl32e() -> LidarSpec:
    """Return the Velodyne HDL-32E.

    User's manual and programming guide, "Laser Firing Sequence" and App. E.

    Lasers of the lower and the upper half in turn, from the lowest, 1.152 us apart, a round every
    46.08 us; angles as printed, to 0.01 degrees; 100 m, 2 cm at one standard deviation, steps
    of 2 mm. Its reflectivity limit is assumed as for the VLP-16.
    """
    lower = [-30.67, -29.33, -28.00, -26.66, -25.33, -24.00, -22.67, -21.33]
    lower += [-20.00, -18.67, -17.33, -16.00, -14.67, -13.33, -12.00, -10.67]
    upper = [-9.33, -8.00, -6.66, -5.33, -4.00, -2.67, -1.33, 0.00]
    upper += [1.33, 2.67, 4.00, 5.33, 6.67, 8.00, 9.33, 10.67]
    elevations = np.column_stack([lower, upper]).ravel()
    return _spinning(
        "hdl32e",
        elevations,
        np.arange(32) * 1.152e-6,
        columns=2170,
        range_m=Bounds(0.9, 100.0),
        range_noise_m=0.02,
        range_resolution_m=0.002,
        detection_limit=0.1 * (100 / 50) ** 2,
    )


def _hdl64e() -> LidarSpec:
    """Return the Velodyne HDL-64E S2: user's manual Rev. B, specifications and App. G.

    32 beams from +2 degrees in steps of 1/3, 32 below from -8.83 in steps of 1/2; a laser of each
    block fires every 0.728 us (table of transmit times); 1.333 million points a second are
    20,833 rounds a second, 2083 a turn. 2 cm, steps of 2 mm, 120 m at 80 % reflectivity but 50 m
    for pavement at 10 %, which sets the limit. Lasers are taken to fire from the top down.
    """
    fired = np.arange(32)
    return _spinning(
        "hdl64e",
        np.concatenate([2.0 - fired / 3, -8.83 - fired / 2]),
        np.tile(fired * 0.728e-6, 2),
        columns=2083,
        range_m=Bounds(0.9, 120.0),
        range_noise_m=0.02,
        range_resolution_m=0.002,
        detection_limit=0.1 * (120 / 50) ** 2,
    )


SPECS: Mapping[str, LidarSpec] = MappingProxyType(
    {spec.name: spec for spec in (_lux(), _vlp16(), _hdl32e(), _hdl64e())}
)
