"""`roadscope check`."""

from __future__ import annotations

from dataclasses import asdict

import typer

from roadscope.commands import options
from roadscope.commands.completion import plugin_kinds
from roadscope.commands.options import argument, flag, option
from roadscope.commands.terminal import complain, print_json, say


def check(
    spec: str = argument(
        "SPEC",
        "A detector, camera detector, tracker, fusion, odometry or driver: file.py:Class, "
        "module:Class or a NAME of ours",
    ),
    kind: str | None = option(
        "KIND",
        "Kind of plug-in, if its class does not say: tracker, detector, 'camera detector', "
        "fusion, odometry, driver",
        name="--kind",
        names=plugin_kinds,
    ),
    deadline: float = option("S", "Time limit of each item, seconds", min=1, default=120.0),
    trust: bool = flag("--trust", "Run it in this process, for debugging"),
    sandbox: bool = flag("--sandbox", "No network, read-only files; needs bubblewrap"),
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Check a plug-in against its contract, item by item, and on some seconds of traffic.

    Exit status: 0 if every item is right, otherwise 1.
    """
    from roadscope.testing import check as check_contract

    report = None if json or quiet else say
    checked = check_contract(
        spec, kind=kind, deadline_s=deadline, trust=trust, sandbox=sandbox, report=report
    )
    if json:
        print_json({**asdict(checked), "ok": checked.ok})
    elif quiet:
        for item in checked.broken:
            complain(str(item))
    else:
        say(checked.verdict)
    if not checked.ok:
        raise typer.Exit(1)
