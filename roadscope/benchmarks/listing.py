"""All names that the command line takes, by kind, with a description of each."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from roadscope.benchmarks.kinds import CAMERA_DETECTOR, DETECTOR, DRIVER, FUSION, ODOMETRY, TRACKER
from roadscope.benchmarks.noisy import NOISES
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES
from roadscope.benchmarks.noisy_odometry import ODOMETRY_NOISES
from roadscope.benchmarks.recorded.mot import MOT
from roadscope.benchmarks.recorded.suite import KITTI, recorded_table
from roadscope.benchmarks.suite_files import SUITES, load_suite
from roadscope.core import Registry, SpecError
from roadscope.core.names import unknown
from roadscope.core.spec import FUSED, ORACLE
from roadscope.envs.imaging.light import LIGHTS
from roadscope.envs.sensors.camera_spec import CAMERAS
from roadscope.envs.sensors.faults import FAULTS, summary_of
from roadscope.envs.sensors.imu_spec import IMUS
from roadscope.envs.sensors.lidar_spec import SPECS
from roadscope.envs.sensors.rigs import RIGS
from roadscope.envs.sensors.weathers import WEATHERS
from roadscope.envs.traffic.scenarios import SCENARIOS

DescribedNames = list[tuple[str, str]]
"""Names, each with its description."""


def names_of(kind: str) -> list[tuple[str, str]]:
    """Return the names of a kind with their descriptions, as `roadscope list` shows them.

    kind: `detectors`, `trackers`, `scenarios`, `suites`, `rigs` or another of the kinds that
        `roadscope list` shows; an unknown one raises `SpecError`.
    """
    # Other kinds are known only to boards, which take long to import.
    kinds = KINDS if kind in KINDS else listed_kinds()
    if kind not in kinds:
        raise SpecError(unknown("kind", kind, kinds))
    return kinds[kind]()


def listed_kinds() -> dict[str, Callable[[], DescribedNames]]:
    """Return `KINDS`, and after them the kinds of plug-in that boards bring."""
    from roadscope.benchmarks.boards import plugin_kinds

    kinds = dict(KINDS)
    for kind in plugin_kinds().values():
        kinds.setdefault(kind.plural.replace(" ", "-"), partial(_registered, kind.registry))
    return kinds


def _detectors() -> DescribedNames:
    composed = [
        (FUSED, "LiDAR and camera fused: ?lidar=A&camera=B&fusion=C."),
        (ORACLE, "The true boxes of all eligible objects."),
    ]
    return [*_registered(DETECTOR.registry), *composed, *_registered(NOISES)]


def _camera_detectors() -> DescribedNames:
    oracle = (ORACLE, "The true boxes of all that images show.")
    return [*_registered(CAMERA_DETECTOR.registry), oracle, *_registered(CAMERA_NOISES)]


def _odometries() -> DescribedNames:
    oracle = (f"{ORACLE}?odometry=A", "The odometry A on scans without moving objects; on boards.")
    return [*_registered(ODOMETRY.registry), oracle, *_registered(ODOMETRY_NOISES)]


def _registered(registry: Registry[Any]) -> DescribedNames:
    """Return the names of a registry with their summaries.

    A plug-in of another package has no summary there: it is described by its class.
    """
    return [
        (name, registry.summaries.get(name) or _described(registry, name))
        for name in registry.names()
    ]


def _described(registry: Registry[Any], name: str) -> str:
    """Return the first line of a plug-in's docstring, with its arguments, or why it has none."""
    try:
        spec = registry.resolve(name)
        text = _first_line(spec.factory)
    except SpecError as error:
        return f"cannot be loaded: {error}"
    arguments = ", ".join(f"{key}={value}" for key, value in spec.arguments.items())
    return f"{text} ({arguments})" if arguments else text


def _first_line(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").partition("\n")[0]


def _stages() -> DescribedNames:
    from roadscope.detectors.stages import STAGES, listed, options_of

    return [
        (f"{kind}={name}", f"{_first_line(stage)} Options: {listed(options_of(stage))}.")
        for kind, stages in STAGES.items()
        for name, stage in stages.items()
    ]


def _suites() -> DescribedNames:
    suites = [(name, load_suite(name)) for name in SUITES]
    names = [(name, f"v{suite.version}: {suite.summary_with_seeds}.") for name, suite in suites]
    return names + [
        (table.name, f"v{table.version}: {table.summary} (--{table.name} DIR).")
        for table in map(recorded_table, (KITTI, MOT))
    ]


def _rigs() -> DescribedNames:
    names = []
    for name, rig in RIGS.items():
        ahead = f"{rig.x_m:g} m ahead of the rear axle, {rig.z_m:g} m above ground."
        camera = f" Camera {rig.camera}." if rig.camera else ""
        imu = f" IMU {rig.imu}, wheel speed, swaying body." if rig.imu else ""
        names.append((name, f"LiDAR {rig.sensor}, {ahead}{camera}{imu}"))
    return names


def _sensors() -> DescribedNames:
    lidars = {
        name: f"LiDAR: {spec.beams} beams, {spec.columns} columns, {1 / spec.period_s:g} Hz, "
        f"to {spec.range_max_m:g} m, range noise {spec.range_noise_m * 100:g} cm."
        for name, spec in SPECS.items()
    }
    cameras = {
        name: f"Camera: {spec.pinhole.width} x {spec.pinhole.height} pixels, "
        f"focal length {spec.pinhole.focal_px[0]:g} pixels, {1 / spec.period_s:g} Hz."
        for name, spec in CAMERAS.items()
    }
    imus = {
        name: f"IMU: {spec.rate_hz:g} Hz, noise {spec.gyro_noise:.3g} rad/s and "
        f"{spec.accelerometer_noise:.3g} m/s2 per root of a Hz."
        for name, spec in IMUS.items()
    }
    return [*lidars.items(), *cameras.items(), *imus.items()]


def _boards() -> DescribedNames:
    from roadscope.benchmarks.boards import BOARDS

    return [
        (name, f"{board.summary} Broken down by {', '.join(each.by for each in board.breakdowns)}.")
        for name, board in BOARDS.items()
    ]


KINDS: Mapping[str, Callable[[], DescribedNames]] = {
    "detectors": _detectors,
    "stages": _stages,
    "camera-detectors": _camera_detectors,
    "fusions": partial(_registered, FUSION.registry),
    "trackers": partial(_registered, TRACKER.registry),
    "odometries": _odometries,
    "drivers": partial(_registered, DRIVER.registry),
    "boards": _boards,
    "scenarios": lambda: [(name, each.description) for name, each in SCENARIOS.items()],
    "suites": _suites,
    "rigs": _rigs,
    "sensors": _sensors,
    "weathers": lambda: [(name, each.summary) for name, each in WEATHERS.items()],
    "lights": lambda: [(name, _first_line(light)) for name, light in LIGHTS.items()],
    "faults": lambda: [(kind, summary_of(kind)) for kind in FAULTS],
}
"""Kinds of names, and what lists each; `listed_kinds` has the kinds that boards bring too."""
