"""`roadscope check`."""

from __future__ import annotations

from typing import Annotated

import typer


def check(
    spec: Annotated[
        str,
        typer.Argument(
            help="A detector (of LiDAR; of images if detect() is said to return "
            "ImageDetections), tracker, odometry (an update() of scans) or fusion: "
            "module:Class or file.py:Class."
        ),
    ],
    deadline: Annotated[
        float,
        typer.Option(
            min=1,
            help="Seconds for each item; what takes longer hangs. Ours, which compile, have 900.",
        ),
    ] = 120.0,
) -> None:
    """Look at a plug-in of your own: its contract, item by item, and two seconds of traffic."""
    from roadscope.benchmarks.check.plugin import broken, check_plugin, line

    items = check_plugin(spec, deadline_s=deadline, told=lambda item: typer.echo(line(item)))
    if count := broken(items):
        typer.echo(f"{spec}: {count} {'item' if count == 1 else 'items'} wrong")
        raise typer.Exit(1)
    typer.echo(f"{spec}: all right")
