"""A tiny ray caster for tests: upright boxes on a plane, one column after the other."""

import numpy as np

from roadscope.core import Calibration, Frame, LidarScan, Pose

LUX_DEG = (-1.2, -0.4, 0.4, 1.2)
HEIGHT_M, FRONT_M = 0.55, 5.0
CALIBRATION = Calibration((("lux", Pose.planar(FRONT_M, 0.0, 0.0, HEIGHT_M)),))


def scan(boxes, *, noise_m=0.0, seed=0, elevations=LUX_DEG, azimuths=None, ground=True):
    """Scan boxes given as (x, y, length, width, height, yaw), ego frame, with a LUX."""
    rng = np.random.default_rng(seed)
    azimuths = np.radians(np.arange(-55, 55, 0.25)) if azimuths is None else azimuths
    column, ring = np.meshgrid(np.arange(len(azimuths)), np.arange(len(elevations)), indexing="ij")
    azimuth, slope = azimuths[column], np.tan(np.radians(np.array(elevations)))[ring]
    reach = np.full(column.shape, 200.0)
    if ground:
        reach = np.where(slope < 0, np.minimum(reach, HEIGHT_M / np.maximum(-slope, 1e-9)), reach)
    for box in boxes:
        hit = _hit(azimuth, box)
        inside = HEIGHT_M + np.where(np.isfinite(hit), hit, 0.0) * slope
        reach = np.where((inside > 0.15) & (inside < box[4]), np.minimum(reach, hit), reach)
    in_range = reach < 200.0
    reach = reach + noise_m * rng.standard_normal(reach.shape)
    points = np.stack([reach * np.cos(azimuth), reach * np.sin(azimuth), reach * slope], axis=-1)
    count = int(in_range.sum())
    return LidarScan(
        points[in_range],
        np.ones(count),
        ring[in_range],
        column[in_range],
        np.zeros(count),
        1.0,
        "lux",
    )


def scan_of(points, ring=None, column=None, stamp_s=1.0, sensor="lux", intensity=1.0):
    """Make a scan of (N, 3) points in the lidar frame, one column each by default."""
    points, n = np.reshape(points, (-1, 3)), len(points)
    intensity = np.broadcast_to(intensity, n)
    ring = np.zeros(n, int) if ring is None else ring
    column = np.arange(n) if column is None else column
    return LidarScan(points, intensity, ring, column, np.zeros(n), stamp_s, sensor)


def frame(boxes, **options):
    """Put a scan of the boxes in a frame."""
    return Frame(1.0, CALIBRATION, scan(boxes, **options))


def _hit(azimuth, box):
    """Horizontal range at which each ray enters the box, inf where it misses."""
    x, y, length, width, _, yaw = box
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    start = turn @ np.array([FRONT_M - x, -y])
    heading = np.einsum("ij,j...->i...", turn, np.stack([np.cos(azimuth), np.sin(azimuth)]))
    half = np.array([length, width]) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        a = (-half.reshape(2, 1, 1) - start.reshape(2, 1, 1)) / heading
        b = (half.reshape(2, 1, 1) - start.reshape(2, 1, 1)) / heading
    near, far = np.minimum(a, b).max(axis=0), np.maximum(a, b).min(axis=0)
    return np.where((near <= far) & (near > 0), near, np.inf)


def cloud(boxes, **options):
    """Return what detectors cluster: the same scan in the ego frame."""
    from roadscope.detectors import Cloud

    return Cloud.of(scan(boxes, **options), CALIBRATION.pose("lux"))
