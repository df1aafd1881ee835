"""`roadscope new`."""

from __future__ import annotations

from pathlib import Path

from roadscope.commands import options
from roadscope.commands.completion import template_kinds
from roadscope.commands.options import argument, flag
from roadscope.commands.terminal import say


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
    say(f"written: {written.path}")
    say("Next:")
    for step in written.next_steps:
        say(f"  {step}")
