"""`roadscope cache`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from roadscope.commands import options
from roadscope.commands.completion import cache_kinds
from roadscope.commands.help import GroupedCommand, command_group
from roadscope.commands.options import flag, option
from roadscope.commands.terminal import print_json, say, show

if TYPE_CHECKING:
    from collections.abc import Sequence

    from roadscope.benchmarks.cached_files import KindUsage

cache = command_group("Show or remove files that are computed once and read again.")


@cache.command("path", cls=GroupedCommand)
def print_path() -> None:
    """Print the folder that computed files go to."""
    from roadscope.benchmarks.cache import cache_folder

    say(cache_folder())


@cache.command("show", cls=GroupedCommand)
def show_usage(json: bool = options.JSON) -> None:
    """Show how much there is of each kind of file."""
    from roadscope.benchmarks.cache import cache_folder
    from roadscope.benchmarks.cached_files import cache_usage

    usages = cache_usage()
    if json:
        _print_json(usages)
        return
    say(cache_folder())
    _show_sizes(usages)


@cache.command("clear", cls=GroupedCommand)
def clear(
    kind: list[str] | None = option(
        "KIND",
        "Only this kind of file, see roadscope cache show; repeatable",
        name="--kind",
        names=cache_kinds,
    ),
    results: bool = flag("--results", "Remove the results database, too"),
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Remove files; they are computed again when needed."""
    from roadscope.benchmarks.cache import cache_folder
    from roadscope.benchmarks.cached_files import clear_cache

    removed = [usage for usage in clear_cache(kind, results=results) if usage.files]
    if json:
        _print_json(removed)
    if json or quiet:
        return
    if not removed:
        say(f"nothing to remove in {cache_folder()}")
        return
    say(f"removed from {cache_folder()}:")
    _show_sizes(removed)


def _print_json(usages: Sequence[KindUsage]) -> None:
    from dataclasses import asdict

    from roadscope.benchmarks.cache import cache_folder

    print_json({"folder": str(cache_folder()), "kinds": [asdict(usage) for usage in usages]})


def _show_sizes(usages: Sequence[KindUsage]) -> None:
    from roadscope.benchmarks.tables import usage_table

    show(usage_table(usages))
