"""What Zhang 2017 prints, and what must be known to read it."""

from __future__ import annotations

import numpy as np

from roadscope.benchmarks.zhang2017_errors import HEADING, LATERAL, LONGITUDINAL, POSITION
from roadscope.benchmarks.zhang2017_methods import MULTI, RANSAC, SINGLE

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
SUMS = (
    "Position: root of the sum of squares of its parts; for single, multi and RANSAC the paper "
    "prints {}. "
)
FLOOR_NOTE = (
    "Floor: the least RMSE of any estimator that knows the car's outline, for the first seeds. "
    "Ours knows the outline too; 'any saloon' knows size and rough build only."
)
NOTES = {
    "table 1": SUMS.format("0.0433, 0.0260, 0.1283") + FLOOR_NOTE,
    "table 2": SUMS.format("0.575, 0.635, 1.7298") + FLOOR_NOTE,
    "table 3": "Processor time of one core. The paper's are of MATLAB, its ratios of means.",
    "following": "The paper shows these in a figure, without numbers.",
}
"""By a word in the name of the experiment."""
