"""`roadscope list`."""

from __future__ import annotations

from typing import Annotated

import typer

from roadscope.commands.completion import listed_kinds
from roadscope.commands.terminal import show


def list_names(
    kind: Annotated[
        str | None,
        typer.Argument(
            help="detectors, stages (of detectors), camera-detectors, fusions, trackers, "
            "odometries, boards, scenarios, suites, rigs, sensors, weathers, lights or faults; "
            "all if left out.",
            autocompletion=listed_kinds,
        ),
    ] = None,
) -> None:
    """Show what can be named."""
    from roadscope.benchmarks.listing import KINDS, names_of
    from roadscope.benchmarks.tables import name_table

    for each in [kind] if kind else KINDS:
        show(name_table(each, names_of(each)))
