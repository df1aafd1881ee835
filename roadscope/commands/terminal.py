"""Output of the commands: results on stdout, complaints and progress on stderr."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

import typer

LINE_EACH_S = 10.0
"""Without a terminal, progress is a line of text, at most this often, seconds."""
PIPED_WIDTH = 80
"""Width of tables that go to a file or pipe, characters."""


def console(*, stderr: bool = False, width: int | None = None) -> Any:
    """Return a rich console that prints text unchanged: no markup, no colours of its own.

    width: characters; None: as wide as the terminal.
    """
    from rich.console import Console

    screen = Console(stderr=stderr, highlight=False, markup=False, emoji=False, width=width)
    if width is None and not screen.is_terminal and "COLUMNS" not in os.environ:
        screen.width = PIPED_WIDTH
    return screen


def show(thing: Any, *, dim: bool = False) -> None:
    """Print a table or text."""
    console().print(thing, style="dim" if dim else None)


def headline(text: str) -> None:
    """Print one bold line, which may be longer than the terminal is wide."""
    from rich.text import Text

    console().print(Text(text, style="bold"), soft_wrap=True)


def print_json(content: Any) -> None:
    """Print content as JSON, and nothing else."""
    typer.echo(json.dumps(content, indent=1, allow_nan=False))


def printable(text: str) -> str:
    """Return a text that may come from a plug-in or a file as one line that is safe to print."""
    from roadscope.core.text import one_line

    return one_line(text)


def complain(text: str) -> None:
    """Write one line on stderr."""
    typer.echo(printable(text), err=True)


@contextmanager
def progress_bars(*, quiet: bool = False) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function that shows progress: a bar for each stage; without a terminal, lines.

    quiet: show nothing.
    """
    if quiet:
        yield lambda stage, done, total: None
        return
    from rich import progress as bars

    columns = (
        bars.SpinnerColumn(),
        bars.TextColumn("{task.description:9}"),
        bars.BarColumn(),
        bars.MofNCompleteColumn(),
        bars.TimeElapsedColumn(),
        bars.TimeRemainingColumn(),
    )
    display = bars.Progress(*columns, console=console(stderr=True))
    tasks: dict[str, bars.TaskID] = {}
    logged, start_s = not display.console.is_terminal, monotonic()
    written_s = dict[str, float]()

    def log(stage: str, done: int, total: int) -> None:
        now_s = monotonic()
        if done == total or now_s - written_s.get(stage, -LINE_EACH_S) >= LINE_EACH_S:
            written_s[stage] = now_s
            complain(f"{stage} {done}/{total}, {now_s - start_s:.0f} s")

    def update(stage: str, done: int, total: int) -> None:
        if logged:
            log(stage, done, total)
            return
        # Started late, so that an error in the input is the only line there is.
        display.start()
        if stage not in tasks:
            tasks[stage] = display.add_task(stage, total=total)
        display.update(tasks[stage], completed=done, total=total)

    try:
        yield update
        for task in display.tasks:
            display.update(task.id, completed=task.total)
    finally:
        if tasks:
            display.stop()
