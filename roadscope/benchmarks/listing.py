"""What can be named on the command line, one line each."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from roadscope.benchmarks.noisy import NOISES
from roadscope.benchmarks.oracle import ORACLE
from roadscope.benchmarks.recorded.suite import kitti_table
from roadscope.benchmarks.suite import SUITES, load_suite, unknown
from roadscope.core import Registry, SpecError


def names_of(kind: str) -> list[tuple[str, str]]:
    """Return name and description of everything of a kind; an unknown kind raises `SpecError`."""
    if kind not in KINDS:
        raise SpecError(unknown("kind", kind, KINDS))
    return KINDS[kind]()


def _detectors() -> list[tuple[str, str]]:
    from roadscope.detectors import DETECTORS

    oracle = (ORACLE, "The true boxes of all eligible objects.")
    return [*_plugins(DETECTORS), oracle, *_plugins(NOISES)]


def _trackers() -> list[tuple[str, str]]:
    from roadscope.trackers import TRACKERS

    return _plugins(TRACKERS)


def _plugins(registry: Registry[Any]) -> list[tuple[str, str]]:
    """Describe plug-ins: by their summary, those of other packages by their class."""
    return [
        (name, registry.summaries.get(name) or _described(registry, name))
        for name in registry.names()
    ]


def _described(registry: Registry[Any], name: str) -> str:
    try:
        plugin = registry.resolve(name)
    except SpecError as error:
        return f"cannot be loaded: {error}"
    text = _first_line(plugin.factory)
    arguments = ", ".join(f"{k}={v}" for k, v in plugin.arguments.items())
    return f"{text} ({arguments})" if arguments else text


def _first_line(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").partition("\n")[0]


def _stages() -> list[tuple[str, str]]:
    from roadscope.detectors.clustering import CLUSTERINGS
    from roadscope.detectors.ground import GROUNDS
    from roadscope.detectors.shape import SHAPES

    kinds = {"ground": GROUNDS, "clustering": CLUSTERINGS, "shape": SHAPES}
    return [
        (f"{kind}={name}", _first_line(stage))
        for kind, stages in kinds.items()
        for name, stage in stages.items()
    ]


def _scenarios() -> list[tuple[str, str]]:
    from roadscope.envs.traffic.scenarios import SCENARIOS

    return [(name, scenario.description) for name, scenario in SCENARIOS.items()]


def _suites() -> list[tuple[str, str]]:
    suites = [load_suite(name) for name in SUITES]
    recorded = kitti_table()
    return [
        *((s.name, f"v{s.version}: {s.summary}.") for s in suites),
        (recorded["name"], f"v{recorded['version']}: {recorded['summary']} (--kitti DIR)."),
    ]


def _rigs() -> list[tuple[str, str]]:
    from roadscope.envs.sensors.rigs import RIGS

    return [
        (
            name,
            f"{'LiDAR' if p.sensor == name else p.sensor}, {p.x_m:g} m ahead of the rear axle, "
            f"{p.z_m:g} m above ground.",
        )
        for name, p in RIGS.items()
    ]


def _sensors() -> list[tuple[str, str]]:
    from roadscope.envs.sensors.lidar_specs import SPECS

    return [
        (
            name,
            f"LiDAR: {s.beams} beams, {s.columns} columns, {1 / s.period_s:g} Hz, "
            f"to {s.range_max_m:g} m, range noise {s.range_noise_m * 100:g} cm.",
        )
        for name, s in SPECS.items()
    ]


def _weathers() -> list[tuple[str, str]]:
    from roadscope.envs.sensors.weather import WEATHERS

    return [(name, weather.summary) for name, weather in WEATHERS.items()]


KINDS: Mapping[str, Callable[[], list[tuple[str, str]]]] = {
    "detectors": _detectors,
    "stages": _stages,
    "trackers": _trackers,
    "scenarios": _scenarios,
    "suites": _suites,
    "rigs": _rigs,
    "sensors": _sensors,
    "weathers": _weathers,
}
