"""How long odometries take for a scan.

All of it in processor time, summed over threads: what one core needs for it, whatever else runs.
All odometries take turns on every scan of one drive, since shared machines change meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from functools import partial
from time import process_time

import numpy as np

from roadscope.benchmarks.drive_steps import Step, drive, imu_mounting
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.speed.rows import SpeedRow, SpeedStep
from roadscope.core import Pose
from roadscope.odometry import ODOMETRIES

RIG = "vlp16-imu"
LARGER = ("hdl32e-imu", "hdl64e-imu")
"""More beams, for odometries that need no other package."""
SCENARIO, SEED, DURATION_S = "two-way", 17, 4.0
"""A street with traffic, one of the training seeds."""
LEAD_SCANS = 10
"""Scans that are not timed: in these maps and speeds are estimated, and code is compiled."""


def odometry_steps() -> list[SpeedStep]:
    """Return a step for each rig."""
    return [
        SpeedStep(f"odometries, {rig}", partial(measure_odometries, rig)) for rig in (RIG, *LARGER)
    ]


def measure_odometries(
    rig: str = RIG, names: Sequence[str] | None = None, duration_s: float = DURATION_S
) -> list[SpeedRow]:
    """Measure whole updates: median, 90th percentile and slowest scan.

    names: specs of odometries; None: all that are registered and installed, of a larger LiDAR
        those that need no other package. duration_s: of the drive.
    """
    episode = Episode(SCENARIO, SEED, rig, duration_s)
    if names is None:
        names = ODOMETRIES.installed() if rig == RIG else own_odometries()
    steps = list(drive(episode))
    returns = float(np.median([len(step.scan) for step in steps]))
    rows = [SpeedRow(f"returns, {rig}", returns, "points")]
    for name, times_ms in timed_scans(names, steps, imu_mounting(episode)).items():
        median_ms, p90_ms = np.percentile(times_ms, [50, 90]).tolist()
        what = f"odometry {name}, {rig}"
        rows += [SpeedRow(what, median_ms, "ms"), SpeedRow(f"{what}, p90", p90_ms, "ms")]
        rows.append(SpeedRow(f"{what}, slowest scan", float(times_ms.max()), "ms"))
    return rows


def own_odometries() -> list[str]:
    """Return the registered odometries that need no other package."""
    return [name for name in ODOMETRIES if ODOMETRIES.resolve(name).requirement is None]


def timed_scans(
    names: Sequence[str], steps: Sequence[Step], mounting: Pose | None
) -> dict[str, np.ndarray]:
    """Run odometries over a drive side by side; return the ms of each scan from `LEAD_SCANS` on."""
    if len(steps) <= LEAD_SCANS:
        raise ValueError(f"a drive of more than {LEAD_SCANS} scans is needed, got {len(steps)}")
    odometries = {name: ODOMETRIES.make(name) for name in names}
    times_ms: dict[str, list[float]] = {name: [] for name in names}
    for odometry in odometries.values():
        odometry.reset(mounting)
    for number, step in enumerate(steps):
        for name, odometry in odometries.items():
            own = deepcopy(step)
            start = process_time()
            odometry.update(own.scan, own.imu)
            if number >= LEAD_SCANS:
                times_ms[name].append((process_time() - start) * 1e3)
    return {name: np.array(values) for name, values in times_ms.items()}
