"""Inertial samples in text files: one line each, of stamp, turn rate and specific force."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.stamped_samples import find_beside, read_samples
from roadscope.benchmarks.formats.table import FormatError
from roadscope.core import ImuSamples, Pose

NAMES = ("imu.csv", "imu.txt")
COLUMNS = ("stamp", "wx", "wy", "wz", "ax", "ay", "az")
IN_G = (0.5, 2.0)
"""A mean force within is one in units of gravity."""
MOUNTING = "x,y,z,roll,pitch,yaw"


def find_imu(folder: Path) -> Path | None:
    """Return the file of inertial samples in a folder of scans or beside it, if there is one."""
    return find_beside(folder, NAMES)


def read_imu(path: Path) -> ImuSamples:
    """Read `stamp wx wy wz ax ay az`, rad/s and m/s^2, as `read_samples` does."""
    stamps_s, values = read_samples(path, COLUMNS)
    force = float(np.linalg.norm(values[:, 3:], axis=1).mean())
    if IN_G[0] < force < IN_G[1]:
        raise FormatError(f"{path}: expected forces in m/s^2, got {force:.2f} on average: in g?")
    return ImuSamples(stamps_s, values[:, :3], values[:, 3:])


def parse_mounting(text: str) -> Pose:
    """Return `lidar_from_imu` of x, y, z in metres and roll, pitch, yaw in degrees."""
    try:
        x, y, z, roll, pitch, yaw = (float(part) for part in text.replace(",", " ").split())
    except ValueError:
        raise FormatError(
            f"expected a mounting {MOUNTING}, metres and degrees, got {text!r}"
        ) from None
    turned = np.deg2rad([roll, pitch, yaw])
    return Pose.from_euler(x, y, z, roll=turned[0], pitch=turned[1], yaw=turned[2])
