"""`roadscope doctor`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from roadscope.commands import options
from roadscope.commands.terminal import complain, headline, print_json, say

if TYPE_CHECKING:
    from collections.abc import Iterable

    from roadscope.benchmarks.doctor import Diagnosis


def doctor(quiet: bool = options.QUIET, json: bool = options.JSON) -> None:
    """Show whether this installation works: versions, extras, cache, kernels, isolation.

    Exit status: 1 if something is broken.
    """
    from roadscope.benchmarks.doctor import doctor as examine

    diagnosis = examine()
    if json:
        print_json(diagnosis.to_json())
    elif quiet:
        for text in diagnosis.broken:
            complain(f"broken: {text}")
    else:
        _show(diagnosis)
    if diagnosis.broken:
        raise typer.Exit(1)


def _show(diagnosis: Diagnosis) -> None:
    from roadscope.benchmarks.cached_files import size_text

    _section("versions", ((k, v or "not installed") for k, v in diagnosis.versions.items()))
    _section(
        "extras",
        (
            (
                each.name,
                f"missing {', '.join(each.missing)}: {each.command}"
                if each.missing
                else "installed",
            )
            for each in diagnosis.extras
        ),
    )
    machine, cache, kernels = diagnosis.machine, diagnosis.cache, diagnosis.kernels
    memory = size_text(machine.memory_bytes)
    rows = [("platform", machine.platform), ("cores", str(machine.cores)), ("memory", memory)]
    _section("machine", rows)
    free = "" if cache.free_bytes is None else f", {size_text(cache.free_bytes)} free"
    rows = [("folder", f"{cache.path} ({_writable(cache.writable)}{free})")]
    rows += [
        (usage.kind, f"{usage.files} files, {size_text(usage.size_bytes)}")
        for usage in diagnosis.usages
        if usage.files
    ]
    _section("cache", rows)
    location = f"{kernels.folder.path} ({_writable(kernels.folder.writable)})"
    amount = f"{kernels.cached}, {size_text(kernels.size_bytes)}" if kernels.cached else "none"
    _section("kernels", [("folder", location), ("cached", amount)])
    isolation = diagnosis.isolation
    rows = [(part, "yes" if present else "no") for part, present in isolation.parts.items()]
    rows.append(("sandbox (bubblewrap)", isolation.sandbox_reason or "yes"))
    _section("isolation of plug-ins", rows)
    say("")
    for text in diagnosis.warnings:
        say(f"warning: {text}")
    for text in diagnosis.broken:
        say(f"broken: {text}")
    if not diagnosis.broken:
        say("nothing is broken")


def _section(title: str, rows: Iterable[tuple[str, str]]) -> None:
    """Print a heading and rows of a name and a text."""
    headline(title)
    listed = list(rows)
    width = max((len(name) for name, _ in listed), default=0)
    for name, text in listed:
        say(f"  {name:{width}}  {text}")


def _writable(writable: bool) -> str:
    return "can be written" if writable else "CANNOT be written"
