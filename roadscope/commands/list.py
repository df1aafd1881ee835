"""`roadscope list`."""

from __future__ import annotations

from roadscope.commands import completion, options
from roadscope.commands.options import argument
from roadscope.commands.terminal import print_json, show


def list_names(
    kind: str | None = argument(
        "KIND",
        "detectors, stages (of detectors), camera-detectors, trackers, odometries, "
        "fusions, drivers, boards, suites, scenarios, rigs, sensors, weathers, lights or "
        "faults; all if left out",
        names=completion.listed_kinds,
        default=None,
    ),
    json: bool = options.JSON,
) -> None:
    """List the names that other commands take, each with a description."""
    from roadscope.benchmarks.listing import listed_kinds, names_of
    from roadscope.benchmarks.tables import name_table

    listed = {each: names_of(each) for each in ([kind] if kind else listed_kinds())}
    if json:
        print_json({each: dict(names) for each, names in listed.items()})
        return
    for each, names in listed.items():
        show(name_table(each, names))
