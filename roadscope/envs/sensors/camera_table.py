"""The table `[camera]` of a rig's file.

    [camera]
    sensor = "wide"
    x_m = 1.8
    pitch_deg = 2.0
    rate_hz = 10
    exposure_s = 0.01
    motion_blur = true

What the table leaves out comes from the camera of that name (`CAMERAS`) and from where the presets
have theirs. With `width_px`, `height_px` or `focal_px` the principal point is the middle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from roadscope.core import RecordError
from roadscope.envs.imaging.pinhole import Pinhole, mounted
from roadscope.envs.sensors.camera_spec import CAMERAS, CameraSpec
from roadscope.envs.sensors.rig import CameraMount
from roadscope.envs.sensors.rig_values import (
    ANGLES,
    MOUNT_KEYS,
    known_keys,
    name_of,
    number,
    switch,
)

CAMERA_X_M, CAMERA_Z_M = 2.0, 1.4
"""Behind the windscreen."""
FIRST_STAMP_S = 0.02
SIZE_KEYS = ("width_px", "height_px", "focal_px")
SPEC_KEYS = ("exposure_s", "full_well", "read_noise", "vignetting")
SWITCHES = ("motion_blur", "plain")
KEYS = ("sensor", *MOUNT_KEYS, *SIZE_KEYS, "rate_hz", *SPEC_KEYS, *SWITCHES)
LARGEST_PX = 8192


def camera_mount(table: object) -> CameraMount:
    """Return the camera that a table describes; `RecordError` says what is wrong in it."""
    if not isinstance(table, Mapping):
        raise RecordError(f"camera: expected a table [camera], got {table!r}")
    try:
        return _mount(table)
    except RecordError as error:
        raise RecordError(f"[camera] {error}") from error


def preset(sensor: str) -> CameraMount:
    """Return a camera of `CAMERAS` where the presets have theirs."""
    return _mount({"sensor": sensor})


def _mount(table: Mapping[str, Any]) -> CameraMount:
    known_keys(table, KEYS)
    spec = _spec(CAMERAS[name_of("sensor", table.get("sensor"), "camera", CAMERAS)], table)
    at = {key: number(key, table[key]) for key in MOUNT_KEYS if key in table}
    z_m = at.get("z_m", CAMERA_Z_M)
    if z_m <= 0:
        raise RecordError(f"z_m: expected a camera above the ground, got {z_m}")
    angles = {angle: math.radians(at.get(f"{angle}_deg", 0.0)) for angle in ANGLES}
    pose = mounted(at.get("x_m", CAMERA_X_M), at.get("y_m", 0.0), z_m, **angles)
    return CameraMount("camera", spec, pose, max(FIRST_STAMP_S, spec.exposure_s / 2))


def _spec(spec: CameraSpec, table: Mapping[str, Any]) -> CameraSpec:
    changes: dict[str, Any] = {k: number(k, table[k]) for k in SPEC_KEYS if k in table}
    changes |= {key: switch(key, table[key]) for key in SWITCHES if key in table}
    if "rate_hz" in table:
        changes["period_s"] = 1 / _positive("rate_hz", table["rate_hz"])
    if any(key in table for key in SIZE_KEYS):
        eye = spec.pinhole
        width, height = (
            _pixels(key, table.get(key, usual))
            for key, usual in (("width_px", eye.width), ("height_px", eye.height))
        )
        focal = _positive("focal_px", table.get("focal_px", eye.focal_px[0]))
        changes["pinhole"] = Pinhole.centred(width, height, focal)
    return replace(spec, **changes)


def _positive(key: str, value: object) -> float:
    found = number(key, value)
    if found <= 0:
        raise RecordError(f"{key}: expected a number above 0, got {value!r}")
    return found


def _pixels(key: str, value: object) -> int:
    if type(value) is not int or not 1 <= value <= LARGEST_PX:
        raise RecordError(f"{key}: expected whole pixels, 1 to {LARGEST_PX}, got {value!r}")
    return value
