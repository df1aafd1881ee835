"""An odometry on a folder of scans."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from roadscope.benchmarks.formats.scan_folder import ScanFolder
from roadscope.benchmarks.formats.trajectories import trajectory_text
from roadscope.core import OdometryEstimate
from roadscope.odometry import ODOMETRIES


def followed(folder: ScanFolder, odometry: str) -> Iterator[OdometryEstimate]:
    """Yield what an odometry, named by its spec, tells of one scan after the other; no IMU.

    A spec that names none is refused before anything is read.
    """
    running = ODOMETRIES.make(odometry)
    running.reset()
    return (running.update(scan, None) for scan in folder)


def write_followed(
    folder: ScanFolder, odometry: str, out: Path, form: str = "kitti"
) -> Iterator[OdometryEstimate]:
    """Yield likewise, and write each pose as soon as it is known: what is done stays.

    Poses are the LiDAR's in its first frame, x ahead, y left, z up, whatever the format.
    """
    estimates = followed(folder, odometry)
    trajectory_text(form, (), ())
    with out.open("w", encoding="utf-8") as file:
        for told in estimates:
            file.write(trajectory_text(form, (told.start_from_lidar,), (told.stamp_s,)))
            file.flush()
            yield told
