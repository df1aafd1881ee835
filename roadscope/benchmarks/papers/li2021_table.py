"""Table 1 of Li 2021: two targets, their masses, fused, and what is decided."""

from __future__ import annotations

import numpy as np

from roadscope.benchmarks.papers.reproduction import YES_OR_NO, ReproductionRow
from roadscope.fusion.evidence import UNDECIDED, combine, decide

TABLE_1 = "table 1"
COLUMNS = ("pedestrian", "car", "uncertain")
INPUTS = {
    "pedestrian": ((0.612, 0.302, 0.086), (0.865, 0.122, 0.013)),
    "car": ((0.253, 0.700, 0.047), (0.171, 0.812, 0.017)),
}
"""LiDAR's and the camera's masses by what the target is; 0.693 is printed for the car's 0.700."""
FUSED = {"pedestrian": (0.920, 0.077, 0.002), "car": (0.082, 0.917, 0.002)}
DECISIONS = {
    "pedestrian": (UNDECIDED, 0, 0),
    "car": (UNDECIDED, UNDECIDED, 1),
}
"""The last column: of LiDAR, camera and both."""


def table_1() -> list[ReproductionRow]:
    """Return fused masses and whether each decision is as printed."""
    rows = []
    for target, (lidar, camera) in INPUTS.items():
        fused = combine(np.array(lidar), np.array(camera))
        rows += [
            _row(f"{target}, fused", column, "share", paper, float(ours))
            for column, paper, ours in zip(COLUMNS, FUSED[target], fused, strict=True)
        ]
        for source, masses, printed in zip(
            ("LiDAR", "camera", "fused"), (lidar, camera, fused), DECISIONS[target], strict=True
        ):
            agrees = float(int(decide(np.array(masses))) == printed)
            rows.append(_row(f"{target}, {source}", "decided as printed", YES_OR_NO, 1.0, agrees))
    return rows


def _row(method: str, quantity: str, unit: str, paper: float, ours: float) -> ReproductionRow:
    return ReproductionRow(TABLE_1, method, quantity, unit, paper, ours, None, None, 1)
