"""Rigs by name, or from a TOML file."""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from roadscope.core import Pose, RecordError
from roadscope.core.names import unknown
from roadscope.envs.imaging.pinhole import Pinhole, mounted
from roadscope.envs.sensors.camera_spec import CAMERAS, CameraSpec
from roadscope.envs.sensors.ego_motion import BodySway
from roadscope.envs.sensors.imu_spec import IMUS
from roadscope.envs.sensors.lidar_spec import SPECS
from roadscope.envs.sensors.rig import CameraMount, ImuMount, LidarMount, Rig
from roadscope.envs.sensors.wheels import WheelSpec

# --------------------------------------------------------------------------------------------------
# Checks of the keys and values of a rig's file.

ANGLES = ("yaw", "pitch", "roll")
MOUNT_KEYS = ("x_m", "y_m", "z_m", *(f"{angle}_deg" for angle in ANGLES))


def check_keys(table: Mapping[str, Any], keys: Sequence[str]) -> None:
    """Raise `RecordError` if a table has any other key."""
    for key in table:
        if key not in keys:
            close = difflib.get_close_matches(key, keys, n=1)
            hint = f" (did you mean '{close[0]}'?)" if close else ""
            raise RecordError(f"unknown key '{key}'{hint}; known: {', '.join(keys)}")


def name_of(key: str, value: object, kind: str, names: Iterable[str]) -> str:
    """Return the value of a key if it names a sensor of that kind; raise `RecordError` if not."""
    if value is None:
        raise RecordError(f"no key '{key}'; it names one of: {', '.join(names)}")
    if not isinstance(value, str) or value not in names:
        raise RecordError(f"no {kind} {value!r}; known: {', '.join(names)}")
    return value


def number(key: str, value: object) -> float:
    """Return the value of a key as a finite number; raise `RecordError` if it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RecordError(f"{key}: expected a number, got {value!r}")
    try:
        finite = float(value)
    except OverflowError:
        finite = math.inf
    if not math.isfinite(finite):
        raise RecordError(f"{key}: expected a finite number, got {finite}")
    return finite


def switch(key: str, value: object) -> bool:
    """Return the value of a key if it is true or false; raise `RecordError` if not."""
    if not isinstance(value, bool):
        raise RecordError(f"{key}: expected true or false, got {value!r}")
    return value


# --------------------------------------------------------------------------------------------------
# The table `[camera]` of a rig's file.

CAMERA_X_M, CAMERA_Z_M = 2.0, 1.4
"""Usual place of a camera: behind the windscreen."""
FIRST_STAMP_S = 0.02
"""Stamp of the first image, unless the exposure is too long for it."""
SIZE_KEYS = ("width_px", "height_px", "focal_px")
CAMERA_SPEC_KEYS = ("exposure_s", "full_well", "read_noise", "vignetting")
CAMERA_SWITCHES = ("motion_blur", "plain")
CAMERA_KEYS = ("sensor", *MOUNT_KEYS, *SIZE_KEYS, "rate_hz", *CAMERA_SPEC_KEYS, *CAMERA_SWITCHES)
LARGEST_PX = 8192
"""Largest width and height of an image."""


def camera_mount(table: object) -> CameraMount:
    """Return the camera of a table; `RecordError` explains what is wrong in it."""
    if not isinstance(table, Mapping):
        raise RecordError(f"camera: expected a table [camera], got {table!r}")
    try:
        return _mount(table)
    except RecordError as error:
        raise RecordError(f"[camera] {error}") from error


def preset(sensor: str) -> CameraMount:
    """Return a camera of `CAMERAS` at the usual place."""
    return _mount({"sensor": sensor})


def _mount(table: Mapping[str, Any]) -> CameraMount:
    check_keys(table, CAMERA_KEYS)
    spec = _spec(CAMERAS[name_of("sensor", table.get("sensor"), "camera", CAMERAS)], table)
    at = {key: number(key, table[key]) for key in MOUNT_KEYS if key in table}
    z_m = at.get("z_m", CAMERA_Z_M)
    if z_m <= 0:
        raise RecordError(f"z_m: expected a camera above the ground, got {z_m}")
    angles = {angle: math.radians(at.get(f"{angle}_deg", 0.0)) for angle in ANGLES}
    pose = mounted(at.get("x_m", CAMERA_X_M), at.get("y_m", 0.0), z_m, **angles)
    return CameraMount("camera", spec, pose, max(FIRST_STAMP_S, spec.exposure_s / 2))


def _spec(spec: CameraSpec, table: Mapping[str, Any]) -> CameraSpec:
    changes: dict[str, Any] = {k: number(k, table[k]) for k in CAMERA_SPEC_KEYS if k in table}
    changes |= {key: switch(key, table[key]) for key in CAMERA_SWITCHES if key in table}
    if "rate_hz" in table:
        changes["period_s"] = 1 / _positive("rate_hz", table["rate_hz"])
    if any(key in table for key in SIZE_KEYS):
        camera = spec.pinhole
        width, height = (
            _pixels(key, table.get(key, usual))
            for key, usual in (("width_px", camera.width), ("height_px", camera.height))
        )
        focal = _positive("focal_px", table.get("focal_px", camera.focal_px[0]))
        changes["pinhole"] = Pinhole.centred(width, height, focal)
    return replace(spec, **changes)


def _positive(key: str, value: object) -> float:
    positive = number(key, value)
    if positive <= 0:
        raise RecordError(f"{key}: expected a number above 0, got {value!r}")
    return positive


def _pixels(key: str, value: object) -> int:
    if type(value) is not int or not 1 <= value <= LARGEST_PX:
        raise RecordError(f"{key}: expected whole pixels, 1 to {LARGEST_PX}, got {value!r}")
    return value


# --------------------------------------------------------------------------------------------------
# Rigs by name, or from a TOML file.

SPEC_KEYS = (
    "range_noise_m",
    "range_resolution_m",
    "dropout",
    "detection_limit",
    "range_min_m",
    "range_max_m",
)
SWITCHES = ("wheels", "sway")
KEYS = ("name", "lidar", "imu", "camera", *SWITCHES, *MOUNT_KEYS, *SPEC_KEYS)
IMU_X_M, IMU_Z_M = 1.3, 0.6
"""Place of inertial units: level, between the front seats."""


@dataclass(frozen=True)
class RigPreset:
    """The LiDAR of a preset rig and where it is mounted, and the names of its other sensors.

    sensor: name of the LiDAR. x_m, z_m: metres, ego frame (origin on the ground below the rear
    axle). imu: its inertial unit; a rig with one also has wheel speeds and sway. detection_limit:
    in place of that of the LiDAR.
    """

    sensor: str
    x_m: float
    z_m: float
    camera: str | None = None
    imu: str | None = None
    detection_limit: float | None = None


PAVEMENT_LIMIT = 0.1 * (1.73 / 50.0) * (120.0 / 50.0) ** 2
"""Detection limit of an HDL-64E that detects pavement 50 m away from 1.73 m above it. The manual
gives the 50 m without an angle of incidence; `lidar_spec` assumes normal incidence, and then
returns from roads end at about 20 m. Not compared with recorded scans."""

RIGS: Mapping[str, RigPreset] = MappingProxyType(
    {
        "lux": RigPreset("lux", 5.0, 0.55),
        "vlp16": RigPreset("vlp16", 2.5, 1.9),
        "hdl32e": RigPreset("hdl32e", 2.5, 1.9),
        "hdl64e": RigPreset("hdl64e", 2.5, 1.73),
        "li2021": RigPreset("lux", 5.0, 0.55, "bumblebee-xb3"),
        "wide": RigPreset("hdl32e", 2.5, 1.9, "wide"),
        "vlp16-imu": RigPreset("vlp16", 2.5, 1.9, imu="adis16448"),
        "hdl32e-imu": RigPreset("hdl32e", 2.5, 1.9, imu="adis16448"),
        "hdl64e-imu": RigPreset("hdl64e", 2.5, 1.73, imu="adis16448"),
        "hdl64e-far": RigPreset(
            "hdl64e", 2.5, 1.73, imu="adis16448", detection_limit=PAVEMENT_LIMIT
        ),
    }
)
"""LUX on the front bumper as in Lu 2018, HDL-64E as high as KITTI's, the others on the roof.
`hdl64e-far` sees roads farther away, see `PAVEMENT_LIMIT`."""


def rig(name_or_path: str | Path) -> Rig:
    """Return a preset, or the rig of a `.toml` file; errors list the known names."""
    text = str(name_or_path)
    if text in RIGS:
        chosen = RIGS[text]
        numbers = {"x_m": chosen.x_m, "z_m": chosen.z_m}
        if chosen.detection_limit is not None:
            numbers["detection_limit"] = chosen.detection_limit
        lidar_rig = _rig(text, chosen.sensor, numbers)
        camera = None if chosen.camera is None else preset(chosen.camera)
        camera_rig = replace(lidar_rig, camera=camera)
        return camera_rig if chosen.imu is None else _with_imu(camera_rig, chosen.imu)
    if text.endswith(".toml"):
        return load_rig(Path(text))
    raise RecordError(f"{unknown('rig', text, RIGS)}; or a path ending in .toml")


def load_rig(path: Path | str) -> Rig:
    """Return the rig of a TOML file; missing keys have the values of the sensor's preset."""
    path = Path(path)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecordError(f"cannot read rig file {path}: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RecordError(f"{path} is not a TOML file: {error}") from error
    try:
        return _from_table(table, path.stem)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error


def scaled_noise(rig: Rig, factor: float) -> Rig:
    """Return the rig with the errors of all sensors but the camera, and dropout, times a factor."""
    if not (math.isfinite(factor) and factor >= 0):
        raise RecordError(f"a noise factor is a finite number from 0 up, got {factor}")
    spec = rig.lidar.spec
    noisy = replace(
        spec, range_noise_m=spec.range_noise_m * factor, dropout=min(spec.dropout * factor, 0.99)
    )
    imu = None if rig.imu is None else replace(rig.imu, spec=rig.imu.spec.scaled(factor))
    return replace(
        rig,
        lidar=replace(rig.lidar, spec=noisy),
        imu=imu,
        dead_reckoning=rig.dead_reckoning.scaled(factor),
        wheels=None if rig.wheels is None else rig.wheels.scaled(factor),
    )


def _from_table(table: Mapping[str, Any], stem: str) -> Rig:
    check_keys(table, KEYS)
    sensor = name_of("lidar", table.get("lidar"), "LiDAR", SPECS)
    name = table.get("name", stem)
    if not isinstance(name, str) or not name:
        raise RecordError(f"name: expected text, got {name!r}")
    numbers = {k: number(k, table[k]) for k in (*MOUNT_KEYS, *SPEC_KEYS) if k in table}
    of_sensor = RIGS.get(sensor)
    usual = {} if of_sensor is None else {"x_m": of_sensor.x_m, "z_m": of_sensor.z_m}
    return _with_extras(_rig(name, sensor, {**usual, **numbers}), table)


def _with_extras(rig: Rig, table: Mapping[str, Any]) -> Rig:
    """Return the rig with the inertial unit, camera, wheels and sway of a table."""
    unit, camera = table.get("imu"), table.get("camera")
    wheels, sway = (switch(key, table.get(key, False)) for key in SWITCHES)
    return replace(
        rig,
        imu=None if unit is None else _imu(name_of("imu", unit, "inertial unit", IMUS)),
        camera=None if camera is None else camera_mount(camera),
        wheels=WheelSpec() if wheels else None,
        sway=BodySway() if sway else None,
    )


def _with_imu(rig: Rig, unit: str) -> Rig:
    """Return the rig with an inertial unit, wheel speeds and sway."""
    return replace(rig, imu=_imu(unit), wheels=WheelSpec(), sway=BodySway())


def _imu(unit: str) -> ImuMount:
    return ImuMount("imu", IMUS[unit], Pose.planar(IMU_X_M, 0.0, 0.0, IMU_Z_M))


def _rig(name: str, sensor: str, numbers: Mapping[str, float]) -> Rig:
    changes: dict[str, Any] = {key: numbers[key] for key in SPEC_KEYS if key in numbers}
    spec = replace(SPECS[sensor], **changes)
    angles = {a: math.radians(numbers.get(f"{a}_deg", 0.0)) for a in ANGLES}
    x, y, z = (numbers.get(key, 0.0) for key in ("x_m", "y_m", "z_m"))
    return Rig(name, LidarMount("lidar", spec, Pose.from_euler(x, y, z, **angles)))
