"""What Zhang 2017 prints, and the names, units and notes of all tables."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.papers.reproduction import FigureKey
from roadscope.benchmarks.papers.zhang2017_methods import (
    FROM_PARTS,
    HEADING,
    LATERAL,
    LONGITUDINAL,
    MULTI,
    OTHER_UNITS,
    POSITION,
    RANSAC,
    RMSE_UNITS,
    SINGLE,
)

SIMULATED = {"straight": "table 1", "straight-past": "table 1", "curve": "table 2"}
"""The simulated drives with their tables; the first two are readings of one drive."""


class PrintedRow(NamedTuple):
    """One line of table 1 or 2."""

    lateral_m: float
    longitudinal_m: float
    heading_deg: float
    position_m: float

    @property
    def columns(self) -> dict[str, float]:
        """The columns by name, and the position error that follows from its parts.

        Only two of the six that are printed are the root of the sum of squares of their parts, as
        an RMSE must be.
        """
        from_parts_m = float(np.hypot(self.lateral_m, self.longitudinal_m))
        return {
            LATERAL: self.lateral_m,
            LONGITUDINAL: self.longitudinal_m,
            HEADING: self.heading_deg,
            POSITION: self.position_m,
            FROM_PARTS: round(from_parts_m, 4),
        }


PAPER: Mapping[tuple[str, str], Mapping[str, float]] = MappingProxyType(
    {
        ("table 1", SINGLE): PrintedRow(0.0142, 0.0409, 7.3973, 0.0433).columns,
        ("table 1", MULTI): PrintedRow(0.0085, 0.0223, 5.1006, 0.0260).columns,
        ("table 1", RANSAC): PrintedRow(0.1173, 0.0520, 9.3973, 0.1283).columns,
        ("table 2", SINGLE): PrintedRow(0.0329, 0.0471, 7.5966, 0.575).columns,
        ("table 2", MULTI): PrintedRow(0.0368, 0.0664, 7.8444, 0.635).columns,
        ("table 2", RANSAC): PrintedRow(1.6297, 0.1777, 18.7742, 1.7298).columns,
    }
)
"""Tables 1 and 2 by table and method."""
PAPER_TIMES_MS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        SINGLE: {"mean": 89.6, "least": 77.8, "most": 93.1},
        MULTI: {"mean": 114.0, "least": 105.3, "most": 126.5},
        RANSAC: {"mean": 73.5, "least": 65.7, "most": 79.9},
    }
)
"""Table 3."""

RMSE = "{}, {} body ({})"
"""Drive, body, table."""
BESIDE = "{}, {} body: beside RMSE"
FOLLOWING = "following, {} body: {} RMSE"
NOISE = "half and double noise, sharp body: {} RMSE"
HIGH = "{}, sharp body, sensor at 1.9 m ({})"
READING = "readings of the paper: {} RMSE"
NEES = "NEES, {} body"
INSIDE = "3 within the NEES's 95 % interval, {} body"
TURNED_FRAMES = "frames turned by 90 deg, percent of those scored"
COUNTS = "frames, and those not scored for having fewer than 3 returns"
TIMES, RATIOS = "table 3, time a frame while following", "table 3, ratios"
RATIO = "mean over single frame's"
MEAN, SLOWEST, FRAMES = "mean", "slowest drive", "frames"
OF_PAPER, OF_OURS = "claims of the paper, {} body", "asked of ours, {} body"
OF_ALL, SHARE_OF_SEEDS = "asked on all drives", ": share of seeds"
HOLDS, SINGLE_SEEDS = "holds", "in single seeds"
"""Columns of claims: on the means over seeds, and the share of seeds in which it holds alone."""


def frames_name(frames: int) -> str:
    """Return the name of a number of frames."""
    return f"{frames} frame{'s' if frames > 1 else ''}"


def paper_figure(key: FigureKey) -> float | None:
    """Return what the paper prints for a quantity, None where it prints nothing."""
    for (table, method), columns in PAPER.items():
        if key.experiment.endswith(f"({table})") and key.method == method:
            return columns[key.quantity]
    if key.experiment == TIMES and key.method in PAPER_TIMES_MS:
        return PAPER_TIMES_MS[key.method].get(key.quantity)
    if key.experiment == RATIOS and key.method in PAPER_TIMES_MS:
        return round(PAPER_TIMES_MS[key.method]["mean"] / PAPER_TIMES_MS[SINGLE]["mean"], 3)
    return None


def unit_of(key: FigureKey) -> str:
    """Return the unit of a figure."""
    experiment = key.experiment
    if experiment == COUNTS:
        return "count"
    if experiment == TURNED_FRAMES:
        return "%"
    if experiment == TIMES:
        return "ms"
    if experiment.endswith(" RMSE") and ": " in experiment and "beside" not in experiment:
        return "deg" if f": {HEADING} " in experiment else "m"
    return {**RMSE_UNITS, **OTHER_UNITS}.get(key.quantity, "1")


NOTES = {
    "straight, sharp body (table 1)": "Four of the paper's six position errors do not follow from "
    "their parts; the last column is what follows. All fits are given the car's length and width. "
    "The paper's pair of lines is turned through 180 deg, coarsely and then finely: 90 deg, as "
    "printed, cannot tell length from width. Our RANSAC is better than the paper's: it knows both "
    "sizes, and takes the first line for the side that it is nearest to in size; 'main' among the "
    "readings always takes it for the flank, as the paper does. Ours knows the outline, but only "
    "the distribution of the corners' radius. 'known radius' knows the radius too; 'any saloon' "
    "knows the size and how saloons are built; 'sized saloon' knows only the latter. Ours of 1 "
    "frame knows the car's velocity roughly, as a tracker does: the median of the last steps of "
    "the mean of its returns, in the first frame the next step.",
    "table 3, time": "Processor time of one core, the paper's of MATLAB. Slowest drive: greatest "
    "mean of a frame on any drive.",
    "following, ": "The paper shows these in a figure, without numbers.",
    "NEES, ": "Squared error in units of the covariance of x, y and yaw; 3 is expected over all "
    "cars and motions that the fit takes for possible, not of one of them.",
    "3 within the NEES's": "1: yes, 0: no. The interval is that of the mean over seeds "
    "(Student's t); frames of one seed are not independent. Of one seed alone: chi square, "
    "windows that share no frame counted as independent.",
    "frames turned": "Half and double noise and a sensor at 1.9 m: sharp body, straight and curve.",
    "claims of the paper, sharp": "1: holds on the means over seeds, 0: does not. Better: lower "
    "in every error that the paper gives; close: at most 1.5 times.",
    "asked of ours, sharp": "1: holds on the means over seeds, 0: does not. Beats paper: 7 frames "
    "below its multi frame in position and heading (its figures; following, its method on the "
    "same seeds). More is better: 7 frames below 3 below 1. NEES: 3 within its interval for 1, 3 "
    "and 7 frames.",
    "asked on all": "1: holds, 0: does not. Times are means of a frame.",
    READING.format(HEADING): "The filter's step function is not printed. Ours: the weight of a "
    "face follows from its extent and from how echoes fade with incidence. Also tried: extent "
    "only; without the near edge; the search over the paper's 90 deg in place of 180; three frames "
    "shifted freely in place of one speed; RANSAC's first line always the flank in place of the "
    "side it is nearest to in size. Sharp body.",
}
"""By a part of the experiment's name."""


def note_of(experiment: str) -> str | None:
    """Return what must be known to read an experiment's table."""
    if experiment.endswith(SHARE_OF_SEEDS):
        return None
    return next((note for part, note in NOTES.items() if part in experiment), None)
