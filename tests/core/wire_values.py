"""Records and plain values as plug-ins get and give them."""

from typing import Any

import numpy as np

from roadscope.core import (
    Calibration,
    CameraImage,
    Detections,
    Frame,
    FusedDetections,
    ImageDetections,
    ImuSamples,
    LidarScan,
    OdometryEstimate,
    OdometryStatus,
    Pose,
    Projection,
    Tracks,
    WheelSamples,
)


def _make_pose(rng, count):
    x, y, z, yaw, pitch, roll = rng.normal(size=6)
    return Pose.from_euler(x, y, z, yaw=yaw, pitch=pitch, roll=roll)


def _make_calibration(rng, count):
    return Calibration(tuple((f"sensor {k}", _make_pose(rng, 0)) for k in range(count % 4)))


def _make_lidar(rng, count):
    return LidarScan(
        rng.normal(size=(count, 3)),
        rng.random(count),
        rng.integers(0, 64, count),
        rng.integers(0, 2000, count),
        rng.random(count),
        rng.random(),
        "top é",
    )


def _make_camera(rng, count):
    pixels = rng.integers(0, 255, (count, 4, 3)).astype(np.uint8)
    return CameraImage(pixels, np.eye(3), rng.random(), "front")


def _make_imu(rng, count):
    return ImuSamples(rng.random(count), rng.normal(size=(count, 3)), rng.normal(size=(count, 3)))


def _make_wheels(rng, count):
    return WheelSamples(rng.random(count), rng.normal(size=count))


def _make_frame(rng, count):
    return Frame(
        rng.random(),
        _make_calibration(rng, count),
        _make_lidar(rng, count),
        _make_camera(rng, count),
        _make_imu(rng, count),
        _make_pose(rng, 0),
        _make_wheels(rng, count),
    )


def _make_empty_frame(rng, count):
    return Frame(1, Calibration())


def _make_projection(rng, count):
    intrinsics = np.array([[500, 0, 320], [0, 500, 240], [0, 0, 1.0]])
    return Projection.of(intrinsics, _make_pose(rng, 0), 640, 480)


def _make_detections(rng, count):
    return Detections(
        rng.normal(size=(count, 3)),
        rng.random((count, 3)) + 0.1,
        rng.normal(size=count),
        rng.integers(0, 7, count),
        rng.random(count),
        "ego",
        rng.random(),
        rng.random((count, 4)) if count % 2 else None,
    )


def _make_image_detections(rng, count):
    corners = np.sort(rng.random((count, 2, 2)), axis=1)
    return ImageDetections(
        corners.reshape(count, 4),
        rng.integers(0, 7, count),
        rng.random(count),
        rng.random(),
        size_px=(640, 480) if count % 2 else None,
    )


def _make_fused(rng, count):
    return FusedDetections(
        rng.integers(0, 7, count),
        rng.random(count),
        np.ones(count, bool),
        rng.random(count) < 0.5,
        rng.random(count) < 0.5,
        rng.normal(size=(count, 3)),
        rng.random((count, 3)),
        rng.normal(size=count),
        rng.random(count),
        rng.integers(-1, 5, count),
        rng.random(count) < 0.5,
        np.sort(rng.random((count, 2, 2)), axis=1).reshape(count, 4),
        rng.random((count, 3)),
        rng.random(),
    )


def _make_tracks(rng, count):
    return Tracks(
        rng.permutation(count),
        rng.normal(size=(count, 3)),
        rng.random((count, 3)) + 0.1,
        rng.normal(size=count),
        rng.normal(size=(count, 2)),
        rng.normal(size=(count, 4, 4)),
        rng.integers(0, 7, count),
        rng.random(count),
        rng.integers(0, 3, count),
        "world",
        rng.random(),
    )


def _make_estimate(rng, count):
    return OdometryEstimate(_make_pose(rng, 0), np.eye(6), rng.random(count) < 0.5, rng.random())


def _make_degraded(rng, count):
    return OdometryEstimate(
        _make_pose(rng, 0), np.eye(6), np.zeros(count, bool), 1.0, OdometryStatus.DEGRADED, "few"
    )


MAKERS = {
    "pose": _make_pose,
    "calibration": _make_calibration,
    "lidar": _make_lidar,
    "camera": _make_camera,
    "imu": _make_imu,
    "wheels": _make_wheels,
    "frame": _make_frame,
    "empty_frame": _make_empty_frame,
    "projection": _make_projection,
    "detections": _make_detections,
    "image_detections": _make_image_detections,
    "fused": _make_fused,
    "tracks": _make_tracks,
    "estimate": _make_estimate,
    "degraded": _make_degraded,
}
NAMES = tuple(MAKERS)


def make_value(name: str, rng: np.random.Generator, count: int) -> Any:
    """Make a record of `count` rows with random content."""
    return MAKERS[name](rng, count)
