"""`roadscope new`."""

from __future__ import annotations

from pathlib import Path

import typer

from roadscope.commands import options
from roadscope.commands.completion import template_kinds
from roadscope.commands.options import argument, flag


def new(
    kind: str = argument(
        "KIND",
        "tracker, detector, camera-detector, odometry, fusion, driver or suite",
        names=template_kinds,
    ),
    path: Path | None = argument("FILE", "my_KIND.py or my_suite.toml if left out", default=None),
    force: bool = flag("--force", "Overwrite a file that exists"),
    quiet: bool = options.QUIET,
) -> None:
    """Write a suite or a plug-in that works and that you can change."""
    from roadscope.benchmarks.templates import write_template

    written = write_template(kind, path, force=force)
    if quiet:
        return
    typer.echo(f"written: {written.path}")
    typer.echo("Next:")
    for step in written.next_steps:
        typer.echo(f"  {step}")
