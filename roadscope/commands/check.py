"""`roadscope check`."""

from __future__ import annotations

from typing import Annotated

import typer

from roadscope.commands.completion import plugin_kinds


def check(
    spec: Annotated[
        str,
        typer.Argument(
            help="A detector (of LiDAR or images), tracker, odometry or fusion: "
            "module:Class or file.py:Class."
        ),
    ],
    kind: Annotated[
        str | None,
        typer.Option(
            help="What it is, if its class does not say so: detector, camera detector, tracker, "
            "fusion or odometry.",
            autocompletion=plugin_kinds,
        ),
    ] = None,
    deadline: Annotated[
        float,
        typer.Option(min=1, help="Seconds for each item; what takes longer hangs."),
    ] = 120.0,
    trust: Annotated[
        bool, typer.Option("--trust", help="Run it in this process, for debugging.")
    ] = False,
) -> None:
    """Check a plug-in of your own: its contract, item by item, and two seconds of traffic."""
    from roadscope.testing import check as check_contract

    done = check_contract(
        spec, kind=kind, deadline_s=deadline, trust=trust, report=lambda item: typer.echo(str(item))
    )
    typer.echo(done.verdict)
    if not done.ok:
        raise typer.Exit(1)
