"""`roadscope cache`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from roadscope.commands.completion import cache_kinds
from roadscope.commands.help import GroupedCommand, command_group
from roadscope.commands.options import Json, flag, option
from roadscope.commands.terminal import print_json, show

if TYPE_CHECKING:
    from collections.abc import Sequence

    from roadscope.benchmarks.cached_files import KindUsage

cache = command_group("Show or remove files that are computed once and read again.")


@cache.command("path", cls=GroupedCommand, help="Print the folder that computed files go to.")
def print_path() -> None:
    """Print the folder; nothing else, for use in scripts."""
    from roadscope.benchmarks.cache import cache_folder

    typer.echo(cache_folder())


@cache.command("show", cls=GroupedCommand, help="Show how much there is of each kind of file.")
def show_usage(
    json: Json = False,
) -> None:
    """Show sizes by kind of file."""
    from dataclasses import asdict

    from roadscope.benchmarks.cache import cache_folder
    from roadscope.benchmarks.cached_files import cache_usage

    usages = cache_usage()
    if json:
        table = {"folder": str(cache_folder()), "kinds": [asdict(usage) for usage in usages]}
        print_json(table)
        return
    typer.echo(cache_folder())
    _show_sizes(usages)


@cache.command(
    "clear",
    cls=GroupedCommand,
    help="Remove files; they are computed again when needed.",
)
def clear(
    kind: Annotated[
        list[str] | None,
        option(
            "KIND",
            "Only this kind of file, see roadscope cache show; repeatable",
            name="--kind",
            autocompletion=cache_kinds,
        ),
    ] = None,
    results: Annotated[bool, flag("--results", "Remove the results database, too")] = False,
) -> None:
    """Remove computed files and print how many of each kind."""
    from roadscope.benchmarks.cache import cache_folder
    from roadscope.benchmarks.cached_files import clear_cache

    removed = [usage for usage in clear_cache(kind, results=results) if usage.files]
    if not removed:
        typer.echo(f"nothing to remove in {cache_folder()}")
        return
    typer.echo(f"removed from {cache_folder()}:")
    _show_sizes(removed)


def _show_sizes(usages: Sequence[KindUsage]) -> None:
    from roadscope.benchmarks.tables import usage_table

    show(usage_table(usages))
