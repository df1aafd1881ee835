"""`roadscope check`."""

from __future__ import annotations

from dataclasses import asdict

import typer

from roadscope.commands import completion, options
from roadscope.commands.options import argument, flag, option
from roadscope.commands.terminal import complain, print_json, say


def check(
    spec: str = argument(
        "SPEC",
        "A detector, camera detector, tracker, fusion, odometry or driver: file.py:Class, "
        "module:Class or a NAME of ours; or a suite's .toml file",
        names=completion.entries,
    ),
    kind: str | None = option(
        "KIND",
        "Kind of plug-in, if its class does not say: tracker, detector, 'camera detector', "
        "fusion, odometry, driver",
        name="--kind",
        names=completion.plugin_kinds,
    ),
    deadline: float = option("S", "Time limit of each item, seconds", min=1, default=120.0),
    trust: bool = flag("--trust", "Run it in this process, for debugging"),
    sandbox: bool = flag("--sandbox", "No network, read-only files; needs bubblewrap"),
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Check a plug-in against its contract, item by item, and on some seconds of traffic.

    Of a suite it is checked that all it names exists and can be loaded.

    Exit status: 0 if every item is right, otherwise 1.
    """
    if spec.endswith(".toml"):
        _check_suite(spec, quiet=quiet, json=json)
        return
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


def _check_suite(path: str, *, quiet: bool, json: bool) -> None:
    """Plan a run of a suite and say how many jobs it has; an error lists what is wrong."""
    from collections import Counter

    from roadscope.benchmarks import load_suite
    from roadscope.benchmarks.run import plan

    jobs = Counter(job.board.name for job in plan(load_suite(path), []).jobs)
    if json:
        print_json({"suite": path, "jobs": jobs, "ok": True})
    elif not quiet:
        counts = ", ".join(f"{count} jobs on {board}" for board, count in jobs.items())
        say(f"{path}: all right, {counts}")
