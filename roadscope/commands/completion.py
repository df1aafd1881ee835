"""Names that a shell offers to complete; everything is imported when a shell asks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import typer

Completion = Iterator[tuple[str, str]]
"""Names, each with the text that a shell shows beside it."""


def _beginning(incomplete: str, names: Iterable[tuple[str, str]]) -> Completion:
    return ((name, text) for name, text in names if name.startswith(incomplete))


def scenarios(incomplete: str) -> Completion:
    """Return scenarios."""
    from roadscope.envs.traffic.scenarios import SCENARIOS

    return _beginning(incomplete, ((each.name, each.description) for each in SCENARIOS.values()))


def suites(incomplete: str) -> Completion:
    """Return the suites that come with roadscope."""
    from roadscope.benchmarks.suite_files import SUITES

    return _beginning(incomplete, ((name, "") for name in SUITES))


def rigs(incomplete: str) -> Completion:
    """Return rigs."""
    from roadscope.envs.sensors.rigs import RIGS

    return _beginning(incomplete, ((name, preset.sensor) for name, preset in RIGS.items()))


def weathers(incomplete: str) -> Completion:
    """Return weathers."""
    from roadscope.envs.sensors.weathers import WEATHERS

    return _beginning(incomplete, ((name, each.summary) for name, each in WEATHERS.items()))


def lights(incomplete: str) -> Completion:
    """Return lights."""
    from roadscope.envs.imaging.light import LIGHTS

    return _beginning(incomplete, ((name, "") for name in LIGHTS))


def detectors(incomplete: str) -> Completion:
    """Return LiDAR detectors."""
    from roadscope.detectors import DETECTORS

    return _beginning(incomplete, _registered(DETECTORS))


def camera_detectors(incomplete: str) -> Completion:
    """Return camera detectors."""
    from roadscope.detectors.camera import CAMERA_DETECTORS

    return _beginning(incomplete, _registered(CAMERA_DETECTORS))


def trackers(incomplete: str) -> Completion:
    """Return trackers."""
    from roadscope.trackers import TRACKERS

    return _beginning(incomplete, _registered(TRACKERS))


def odometries(incomplete: str) -> Completion:
    """Return odometries."""
    from roadscope.odometry import ODOMETRIES

    return _beginning(incomplete, _registered(ODOMETRIES))


def entries(incomplete: str) -> Completion:
    """Return the plug-ins that boards rank."""
    from roadscope.benchmarks.boards import BOARDS

    for board in BOARDS.values():
        yield from _beginning(incomplete, _registered(board.kind.registry))


def entries_of_runs(ctx: typer.Context, incomplete: str) -> Completion:
    """Return the entries of the results that stand on the command line before."""
    from roadscope.benchmarks.compare import CompareError, read_run

    # Typer names the arguments; click does not where an option lacks its value.
    places = [ctx.params.get(name) for name in ("a", "b", "source")]
    for place in filter(None, [*places, *ctx.args]):
        try:
            names = read_run(place).entries()
        except (CompareError, OSError):
            continue
        yield from _beginning(incomplete, ((name, "") for name in names))


def boards(incomplete: str) -> Completion:
    """Return boards."""
    from roadscope.benchmarks.boards import BOARDS

    return _beginning(incomplete, ((name, each.summary) for name, each in BOARDS.items()))


def listed_kinds(incomplete: str) -> Completion:
    """Return what `roadscope list` lists."""
    from roadscope.benchmarks.listing import KINDS

    return _beginning(incomplete, ((kind, "") for kind in KINDS))


def plugin_kinds(incomplete: str) -> Completion:
    """Return the kinds of plug-in."""
    from roadscope.benchmarks.boards import plugin_kinds as every_kind

    kinds = every_kind().items()
    return _beginning(incomplete, ((kind, f"has {each.method}()") for kind, each in kinds))


def template_kinds(incomplete: str) -> Completion:
    """Return what `roadscope new` writes."""
    from roadscope.benchmarks.templates import TEMPLATES

    return _beginning(incomplete, ((kind, "") for kind in TEMPLATES))


def cache_kinds(incomplete: str) -> Completion:
    """Return kinds of files in the cache."""
    from roadscope.benchmarks.cached_files import FILE_KINDS

    return _beginning(incomplete, ((kind, each.description) for kind, each in FILE_KINDS.items()))


def _registered(registry: object) -> Iterator[tuple[str, str]]:
    """Return names of a registry with their summaries."""
    from roadscope.core import Registry

    assert isinstance(registry, Registry)
    for name in registry.names():
        yield name, registry.summaries.get(name, "")


def backends(incomplete: str) -> Completion:
    """Return the backends that provide worker processes."""
    from roadscope.benchmarks.workers import BACKENDS

    return _beginning(incomplete, ((name, "") for name in BACKENDS))
