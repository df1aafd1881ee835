"""`roadscope new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from roadscope.commands.completion import template_kinds
from roadscope.commands.options import flag


def new(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help="tracker, detector, camera-detector, odometry, fusion, driver or suite",
            autocompletion=template_kinds,
        ),
    ],
    path: Annotated[
        Path | None, typer.Argument(metavar="FILE", help="my_KIND.py or my_suite.toml if left out")
    ] = None,
    force: Annotated[bool, flag("--force", "Overwrite a file that exists")] = False,
) -> None:
    """Write a suite or a plug-in that works and that you can change."""
    from roadscope.benchmarks.templates import write_template

    written = write_template(kind, path, force=force)
    typer.echo(f"written: {written.path}")
    typer.echo("Next:")
    for step in written.next_steps:
        typer.echo(f"  {step}")
