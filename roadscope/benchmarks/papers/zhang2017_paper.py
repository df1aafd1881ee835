"""What Zhang 2017 prints, and what must be known to read it."""

from __future__ import annotations

import numpy as np

from roadscope.benchmarks.papers.zhang2017_errors import HEADING, LATERAL, LONGITUDINAL, POSITION
from roadscope.benchmarks.papers.zhang2017_methods import MULTI, RANSAC, SINGLE

SIMULATED = {"straight": "table 1", "straight-past": "table 1", "curve": "table 2"}
"""The drives, two of them readings of one, and the tables in which they are reported."""
COLUMNS = (LATERAL, LONGITUDINAL, HEADING)
_PRINTED = {
    ("table 1", SINGLE): (0.0142, 0.0409, 7.3973),
    ("table 1", MULTI): (0.0085, 0.0223, 5.1006),
    ("table 1", RANSAC): (0.1173, 0.0520, 9.3973),
    ("table 2", SINGLE): (0.0329, 0.0471, 7.5966),
    ("table 2", MULTI): (0.0368, 0.0664, 7.8444),
    ("table 2", RANSAC): (1.6297, 0.1777, 18.7742),
}
PAPER: dict[tuple[str, str], dict[str, float]] = {
    place: {**dict(zip(COLUMNS, row, strict=True)), POSITION: round(float(np.hypot(*row[:2])), 4)}
    for place, row in _PRINTED.items()
}
"""Tables 1 and 2 by table and method. The position error is the root of the sum of squares of
its parts, as it must be for RMSE; only two of the six that are printed are."""
PAPER_TIMES = {
    SINGLE: {"mean": 89.6, "least": 77.8, "most": 93.1},
    MULTI: {"mean": 114.0, "least": 105.3, "most": 126.5},
    RANSAC: {"mean": 73.5, "least": 65.7, "most": 79.9},
}
HIGH_M = 1.9
"""Height of a sensor on a car's roof, the other reading of where it stands."""
SUMS = (
    "Position: root of the sum of squares of its parts; for single, multi and RANSAC the paper "
    "prints {}."
)
NOTES = {
    "straight, sharp body (table 1)": f"{SUMS.format('0.0433, 0.0260, 0.1283')} "
    "Ours knows the outline, but of the corners' radius only how it is spread. 'told radius' is "
    "ours knowing it too, 'any saloon' knows the size and how saloons are built, 'sized saloon' "
    "not even the size. Ours of 1 frame is told roughly how the car moves, as a tracker knows it: "
    "how its returns' mean went from scan to scan lately, at first to the next.",
    "curve, sharp body (table 2)": SUMS.format("0.575, 0.635, 1.7298"),
    "table 3, time": "Processor time of one core, the paper's of MATLAB. Slowest drive: greatest "
    "mean of a frame on any drive.",
    "following, ": "The paper shows these in a figure, without numbers.",
    "NEES, ": "Squared error in units of the covariance of x, y and yaw; 3 is expected over all "
    "cars and ways that the fit takes for possible, not of one of them.",
    "3 within the NEES's": "1: yes, 0: no. The interval is that of the mean over seeds "
    "(Student's t); frames of one seed are not independent. Of one seed alone: chi square, "
    "windows that share no frame counted as independent.",
    "frames turned": "Half and double noise and a sensor at 1.9 m: sharp body, straight and curve.",
    "claims of the paper, sharp": "1: holds on the means over seeds, 0: does not. Better: lower "
    "in every error that the paper gives; close: within half as much again.",
    "asked of ours, sharp": "1: holds on the means over seeds, 0: does not. Beats paper: 7 frames "
    "below its multi frame in position and heading (its figures; following, its method on the "
    "same seeds). More is better: 7 frames below 3 below 1. NEES: 3 within its interval for 1, 3 "
    "and 7 frames.",
    "asked on all": "1: holds, 0: does not. Times are means of a frame.",
}
"""By a part of the experiment's name."""
