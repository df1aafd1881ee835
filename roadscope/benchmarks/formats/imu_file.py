"""Inertial samples in text files: one line each, of stamp, turn rate and specific force."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.table import FormatError, read_lines, read_table
from roadscope.core import ImuSamples, Pose

NAMES = ("imu.csv", "imu.txt")
COLUMNS = ("stamp", "wx", "wy", "wz", "ax", "ay", "az")
LONGEST_S, SHORTEST_NS = 1.0, 1e4
"""Between these, the usual step of stamps is neither seconds nor nanoseconds."""
IN_G = (0.5, 2.0)
"""A mean force within is one in units of gravity."""
MOUNTING = "x,y,z,roll,pitch,yaw"


def find_imu(folder: Path) -> Path | None:
    """Return the file of inertial samples in a folder of scans or beside it, if there is one."""
    places = (root / name for root in (folder, folder.parent) for name in NAMES)
    return next((path for path in places if path.is_file()), None)


def read_imu(path: Path) -> ImuSamples:
    """Read `stamp wx wy wz ax ay az`: rad/s and m/s^2, by commas or white space.

    Stamps are seconds or whole nanoseconds, on the clock of the scans; a line of names at the top
    and lines that begin with `#` are passed over.
    """
    lines = read_lines(path)
    separator = "," if any("," in line for line in lines[:2]) else None
    head = next((line for line in lines if line.strip()), "")
    comment = head.strip()[:1] if head.strip()[:1].isalpha() else "#"
    table = read_table(path, COLUMNS, separator=separator, comment=comment)
    values = table.numbers(0, len(COLUMNS))
    if len(values) < 2:
        raise FormatError(f"{path}: expected lines of {' '.join(COLUMNS)}, got {len(values)}")
    step = float(np.median(np.diff(values[:, 0])))
    if not (0 < step <= LONGEST_S or step >= SHORTEST_NS):
        raise FormatError(f"{path}: expected stamps in seconds or nanoseconds, got steps of "
                          f"{step:g}")  # fmt: skip
    stamps_s = values[:, 0] * (1e-9 if step >= SHORTEST_NS else 1.0)
    force = float(np.linalg.norm(values[:, 4:], axis=1).mean())
    if IN_G[0] < force < IN_G[1]:
        raise FormatError(f"{path}: expected forces in m/s^2, got {force:.2f} on average: in g?")
    return ImuSamples(stamps_s, values[:, 1:4], values[:, 4:])


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
