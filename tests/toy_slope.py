"""A tiny ray caster for tests: an HDL-64 over ground of any shape, with boxes standing on it."""

import numpy as np
from toy_lidar import scan_of

from roadscope.core import Calibration, Frame, Pose
from roadscope.detectors import Cloud
from roadscope.envs.sensors import SPECS

CAR = (4.4, 1.8, 1.5)
HEIGHT_M = 1.73
ELEVATIONS = SPECS["hdl64e"].elevations
RANGES_M = np.concatenate([np.arange(2.0, 20.0, 0.25), np.geomspace(20.0, 80.0, 140)])


def hdl64_scan(height, boxes, *, columns=2083, noise_m=0.02, seed=0):
    """Scan ground z = height(x, y) and boxes (x, y, length, width, height) from the origin.

    The sensor stands level, 1.73 m above the ground below it. Boxes are 0.2 m clear of the ground.
    """
    azimuths = np.pi - 2 * np.pi * np.arange(columns) / columns
    cos, sin = np.cos(azimuths)[:, None], np.sin(azimuths)[:, None]
    slopes, floor = np.tan(ELEVATIONS), height(np.zeros(1), np.zeros(1))[0] + HEIGHT_M
    profile = height(RANGES_M * cos, RANGES_M * sin)
    # A return comes from where the ground first rises above the ray.
    reach = np.full((columns, len(slopes)), np.inf)
    for j, slope in enumerate(slopes):
        over = floor + slope * RANGES_M - profile
        first = np.argmax(over <= 0, axis=1)
        rows = np.flatnonzero(first > 0)
        k = first[rows]
        above, below = over[rows, k - 1], over[rows, k]
        share = above / (above - below)
        reach[rows, j] = RANGES_M[k - 1] + share * (RANGES_M[k] - RANGES_M[k - 1])
    for x, y, length, width, top in boxes:
        near, far = _crossed(
            cos, sin, (x - length / 2, x + length / 2, y - width / 2, y + width / 2)
        )
        z = floor + np.where(near < far, near, 0.0) * slopes - height(np.array([x]), np.array([y]))
        hit = (near < far) & (z > 0.2) & (z < top)
        reach = np.where(hit, np.minimum(reach, near), reach)
    column, ring = np.nonzero(np.isfinite(reach))
    noise = noise_m * np.random.default_rng(seed).standard_normal(len(column))
    flat = reach[column, ring] + noise * np.cos(ELEVATIONS[ring])
    points = np.column_stack([flat * cos[column, 0], flat * sin[column, 0], flat * slopes[ring]])
    return scan_of(points, ring, column, sensor="lidar", intensity=0.3)


def frame_of(scan, *, offset_m=0.0):
    """Put a scan into a frame that believes the sensor to be higher than it is by an offset."""
    calibration = Calibration((("lidar", Pose.planar(0.0, 0.0, 0.0, HEIGHT_M + offset_m)),))
    return Frame(1.0, calibration, lidar=scan)


def cloud_of(frame):
    """Return the scan of a frame as detectors take it."""
    return Cloud.of(frame.lidar, frame.calibration.pose("lidar"))


def _crossed(cos, sin, box):
    """Return ranges at which rays of each column enter and leave a rectangle, (C, 1) each."""
    with np.errstate(divide="ignore"):
        x = np.sort(np.stack([box[0] / cos, box[1] / cos]), axis=0)
        y = np.sort(np.stack([box[2] / sin, box[3] / sin]), axis=0)
    near, far = np.maximum(x[0], y[0]), np.minimum(x[1], y[1])
    return np.where(near > 0, near, np.inf), far
