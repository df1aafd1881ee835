"""Names that a shell offers to complete; everything is imported when a shell asks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import typer

Suggestions = Iterator[tuple[str, str]]
"""What a shell may complete to, each with the text that it shows beside it."""


def _names_of(table: Any, text: str = "") -> Suggestions:
    """Yield the names of a table or registry.

    text: a format of the table's value, shown beside its name; empty: nothing is shown.
    """
    from roadscope.core import Registry

    for name in table:
        if isinstance(table, Registry):
            yield name, table.summaries.get(name, "")
        else:
            yield name, text.format(table[name]) if text else ""


def _names_in(place: str, text: str = "") -> Callable[[], Suggestions]:
    """Return a function that imports a table and yields its names.

    place: `module:attribute` in `roadscope`. text: as in `_names_of`.
    """
    module, _, attribute = place.partition(":")
    return lambda: _names_of(getattr(import_module(f"roadscope.{module}"), attribute), text)


scenarios = _names_in("envs.traffic.scenarios:SCENARIOS", "{.description}")
suites = _names_in("benchmarks.suite_files:SUITES")
rigs = _names_in("envs.sensors.rigs:RIGS", "{.sensor}")
weathers = _names_in("envs.sensors.weathers:WEATHERS", "{.summary}")
lights = _names_in("envs.imaging.light:LIGHTS")
detectors = _names_in("detectors:DETECTORS")
camera_detectors = _names_in("detectors.camera:CAMERA_DETECTORS")
trackers = _names_in("trackers:TRACKERS")
odometries = _names_in("odometry:ODOMETRIES")
boards = _names_in("benchmarks.boards:BOARDS", "{.summary}")
template_kinds = _names_in("benchmarks.templates:TEMPLATES")
cache_kinds = _names_in("benchmarks.cached_files:FILE_KINDS", "{.description}")
backends = _names_in("benchmarks.workers:BACKENDS")


def entries() -> Suggestions:
    """Yield the plug-ins that boards rank."""
    from roadscope.benchmarks.boards import BOARDS

    for board in BOARDS.values():
        yield from _names_of(board.kind.registry)


def breakdowns() -> Suggestions:
    """Yield what boards can be broken down by."""
    from roadscope.benchmarks.boards import BOARDS

    each_board = (board.breakdowns for board in BOARDS.values())
    yield from ((name, "") for name in dict.fromkeys(b.by for each in each_board for b in each))


def entries_of_runs(ctx: typer.Context) -> Suggestions:
    """Yield the entries of the results that the command line already names."""
    from roadscope.benchmarks.compare import CompareError, read_run

    # Where the last option still lacks its value, click has not named the arguments.
    named = [ctx.params.get(name) for name in ("a", "b", "source")]
    for place in filter(None, [*named, *ctx.args]):
        try:
            names = read_run(place).entries()
        except (CompareError, OSError):
            continue
        yield from ((name, "") for name in names)


def listed_kinds() -> Suggestions:
    """Yield what `roadscope list` lists, also the kinds that boards bring."""
    from roadscope.benchmarks import listing

    yield from ((kind, "") for kind in listing.listed_kinds())


def plugin_kinds() -> Suggestions:
    """Yield the kinds of plug-in, also those that boards bring."""
    from roadscope.benchmarks import boards

    yield from ((name, f"has {kind.method}()") for name, kind in boards.plugin_kinds().items())
