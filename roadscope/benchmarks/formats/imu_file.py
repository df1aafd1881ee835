"""Inertial samples in text files: one line each, of stamp, turn rate and specific force."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.stamped_samples import find_beside, read_samples
from roadscope.benchmarks.formats.table import FormatError
from roadscope.core import ImuSamples, Pose

NAMES = ("imu.csv", "imu.txt")
COLUMNS = ("stamp", "wx", "wy", "wz", "ax", "ay", "az")
FORCES_M_S2 = (5.0, 20.0)
"""What drives, or is carried, mostly feels: gravity."""
FASTEST_RAD_S = 6.0
"""What drives, or is carried, does not turn faster in one sample of a hundred."""
MOUNTING = "x,y,z,roll,pitch,yaw"


def find_imu(folder: Path) -> Path | None:
    """Return the file of inertial samples in a folder of scans or beside it, if there is one."""
    return find_beside(folder, NAMES)


def read_imu(path: Path | str) -> tuple[ImuSamples, int]:
    """Read `stamp wx wy wz ax ay az`, rad/s and m/s^2, as `read_samples` does.

    Return with them how many lines were left out.
    """
    path = Path(path)
    found = read_samples(path, COLUMNS)
    values = found.values
    force = float(np.median(np.linalg.norm(values[:, 3:], axis=1)))
    if not FORCES_M_S2[0] < force < FORCES_M_S2[1]:
        raise FormatError(
            f"{path}: expected forces in m/s^2, 9.8 at rest, got {force:.2f} mostly: in g, or with "
            "gravity taken out?"
        )
    rate = float(np.quantile(np.linalg.norm(values[:, :3], axis=1), 0.99))
    if rate > FASTEST_RAD_S:
        raise FormatError(f"{path}: expected rates in rad/s, got up to {rate:.1f}: in degrees?")
    return ImuSamples(found.stamps_s, values[:, :3], values[:, 3:]), found.left_out


def parse_mounting(text: str) -> Pose:
    """Return `lidar_from_imu` of x, y, z in metres and roll, pitch, yaw in degrees."""
    try:
        numbers = [float(part) for part in text.replace(",", " ").split()]
        x, y, z, roll, pitch, yaw = (each for each in numbers if np.isfinite(each))
    except ValueError:
        raise FormatError(
            f"expected a mounting {MOUNTING}, metres and degrees, got {text!r}"
        ) from None
    turned = np.deg2rad([roll, pitch, yaw])
    return Pose.from_euler(x, y, z, roll=turned[0], pitch=turned[1], yaw=turned[2])
