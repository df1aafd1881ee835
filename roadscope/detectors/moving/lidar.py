"""The beams and columns of a LiDAR, estimated from one of its scans."""

from __future__ import annotations

import numpy as np

from roadscope.core import LidarScan
from roadscope.detectors.moving.view import evenly, range_noise_of, tabulate
from roadscope.envs.sensors.lidar_spec import LidarSpec

SWEEP_LEAST_S = 1e-3
"""Least duration of a sweep, for scans whose returns have no times."""


def lidar_of(
    scan: LidarScan, *, range_noise_m: float | None, range_max_m: float, detection_limit: float
) -> LidarSpec | None:
    """Return the LiDAR that made a scan, estimated; None if the scan has too few beams or columns.

    A frame does not name its LiDAR. Directions and times follow from the returns, and also the
    range noise if it is None. The limits are arguments. Elevations of beams without a return are
    interpolated.
    """
    if not len(scan) or scan.ring.min() < 0 or scan.column.min() < 0:
        return None
    image, slopes, azimuths, times_s = tabulate(
        scan.points, scan.ring, scan.column, scan.time_offset_s.astype(np.float64)
    )
    rings, columns = np.flatnonzero(np.isfinite(slopes)), np.flatnonzero(np.isfinite(azimuths))
    rising = len(rings) > 1 and (np.diff(slopes[rings]) > 0).all()
    if not rising or len(columns) < 2:
        return None
    elevations = np.interp(np.arange(len(slopes)), rings, np.arctan(slopes[rings]))
    azimuth, step = evenly(columns, azimuths[columns])
    if rings[0] > 0 or step == 0.0:
        return None
    turn = 2 * np.pi / abs(step)
    count = round(turn) if len(azimuths) > 0.9 * turn else len(azimuths)
    count = max(count, len(azimuths))
    seconds_per_column = (times_s[columns[-1]] - times_s[columns[0]]) / (columns[-1] - columns[0])
    sweep_s = max(float(seconds_per_column) * count, SWEEP_LEAST_S)
    if range_noise_m is None:
        range_noise_m = float(range_noise_of(image))
    return LidarSpec(
        "estimated",
        elevations,
        np.zeros(len(slopes)),
        azimuth,
        step * count,
        count,
        sweep_s,
        sweep_s,
        0.0,
        range_max_m,
        range_noise_m,
        0.0,
        0.0,
        detection_limit,
    )
