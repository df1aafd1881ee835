"""Rigs by name, or from a TOML file.

A file names a LiDAR and may change its mount and its figures:

    lidar = "vlp16"
    x_m = 2.5
    z_m = 1.8
    pitch_deg = 1.0
    range_noise_m = 0.03
"""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from roadscope.core import Pose, RecordError
from roadscope.core.names import unknown
from roadscope.envs.imaging.pinhole import mounted
from roadscope.envs.sensors.camera_spec import CAMERAS
from roadscope.envs.sensors.lidar_specs import SPECS
from roadscope.envs.sensors.rig import CameraMount, LidarMount, Rig

MOUNT_KEYS = ("x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg")
SPEC_KEYS = (
    "range_noise_m", "range_resolution_m", "dropout", "detection_limit",
    "range_min_m", "range_max_m",
)  # fmt: skip
KEYS = ("name", "lidar", *MOUNT_KEYS, *SPEC_KEYS)


@dataclass(frozen=True)
class Place:
    """Where the sensors of a preset sit, metres, ego frame (rear axle on the ground)."""

    sensor: str
    x_m: float
    z_m: float
    camera: str | None = None
    camera_x_m: float = 2.0
    camera_z_m: float = 1.4


RIGS: Mapping[str, Place] = MappingProxyType(
    {
        "lux": Place("lux", 5.0, 0.55),
        "vlp16": Place("vlp16", 2.5, 1.9),
        "hdl32e": Place("hdl32e", 2.5, 1.9),
        "hdl64e": Place("hdl64e", 2.5, 1.73),
        "li2021": Place("lux", 5.0, 0.55, "bumblebee-xb3", 2.0, 1.4),
        "wide": Place("hdl32e", 2.5, 1.9, "wide", 2.0, 1.4),
    }
)
"""LUX on the front bumper as in Lu 2018, HDL-64E as high as KITTI's, the others on the roof;
cameras behind the windscreen."""


def rig(name_or_path: str | Path) -> Rig:
    """Return a preset or read a `.toml` file; anything else is refused with what there is."""
    text = str(name_or_path)
    if text in RIGS:
        place = RIGS[text]
        made = _rig(text, place.sensor, {"x_m": place.x_m, "z_m": place.z_m})
        return replace(made, camera=_camera(place))
    if text.endswith(".toml"):
        return load_rig(Path(text))
    raise RecordError(f"{unknown('rig', text, RIGS)}; or a path ending in .toml")


def load_rig(path: Path | str) -> Rig:
    """Read a rig from a TOML file; what the file leaves out comes from the sensor's preset."""
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
    """Return the rig with every error and dropout times a factor: half, double, none."""
    if not (math.isfinite(factor) and factor >= 0):
        raise RecordError(f"a noise factor is a finite number from 0 up, got {factor}")
    spec = rig.lidar.spec
    noisy = replace(
        spec, range_noise_m=spec.range_noise_m * factor, dropout=min(spec.dropout * factor, 0.99)
    )
    lidar, wheels = replace(rig.lidar, spec=noisy), rig.dead_reckoning.scaled(factor)
    return replace(rig, lidar=lidar, dead_reckoning=wheels)


def _from_table(table: Mapping[str, Any], stem: str) -> Rig:
    for key in table:
        if key not in KEYS:
            close = difflib.get_close_matches(key, KEYS, n=1)
            hint = f" (did you mean '{close[0]}'?)" if close else ""
            raise RecordError(f"unknown key '{key}'{hint}; known: {', '.join(KEYS)}")
    sensor, name = table.get("lidar"), table.get("name", stem)
    if sensor is None:
        raise RecordError(f"no key 'lidar'; it names one of: {', '.join(SPECS)}")
    if not isinstance(sensor, str) or sensor not in SPECS:
        raise RecordError(f"no LiDAR {sensor!r}; known: {', '.join(SPECS)}")
    if not isinstance(name, str) or not name:
        raise RecordError(f"name: expected text, got {name!r}")
    numbers = {k: _number(k, v) for k, v in table.items() if k not in ("name", "lidar")}
    place = RIGS.get(sensor)
    preset = {} if place is None else {"x_m": place.x_m, "z_m": place.z_m}
    return _rig(name, sensor, {**preset, **numbers})


def _rig(name: str, sensor: str, numbers: Mapping[str, float]) -> Rig:
    changes: dict[str, Any] = {key: numbers[key] for key in SPEC_KEYS if key in numbers}
    spec = replace(SPECS[sensor], **changes)
    angles = {a: math.radians(numbers.get(f"{a}_deg", 0.0)) for a in ("yaw", "pitch", "roll")}
    x, y, z = (numbers.get(key, 0.0) for key in ("x_m", "y_m", "z_m"))
    return Rig(name, LidarMount("lidar", spec, Pose.from_euler(x, y, z, **angles)))


def _camera(place: Place) -> CameraMount | None:
    if place.camera is None:
        return None
    pose = mounted(place.camera_x_m, 0.0, place.camera_z_m)
    return CameraMount("camera", CAMERAS[place.camera], pose)


def _number(key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RecordError(f"{key}: expected a number, got {value!r}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise RecordError(f"{key}: expected a finite number, got {number}")
    return number
