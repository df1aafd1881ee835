"""What is shown: results on stdout, complaints and progress on stderr."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

import typer

LINE_EACH_S = 60.0
"""Where no terminal shows bars, a line says this often how far a stage is."""


def console(*, stderr: bool = False) -> Any:
    """Return a rich console that colours nothing of its own accord."""
    from rich.console import Console

    return Console(stderr=stderr, highlight=False)


def show(thing: Any, *, dim: bool = False) -> None:
    """Print a table or text with rich's markup."""
    console().print(thing, style="dim" if dim else None)


def headline(text: str) -> None:
    """Print one bold line, which may be longer than the terminal is wide."""
    from rich.text import Text

    console().print(Text(text, style="bold"), soft_wrap=True)


def complain(text: str) -> None:
    """Write one line on stderr."""
    typer.echo(" ".join(text.split()), err=True)


@contextmanager
def progress_bars() -> Iterator[Callable[[str, int, int], None]]:
    """Show one bar for each stage, with time spent and left; in a log, a line now and then."""
    from rich import progress as bars

    columns = (
        bars.SpinnerColumn(),
        bars.TextColumn("{task.description:9}"),
        bars.BarColumn(),
        bars.MofNCompleteColumn(),
        bars.TimeElapsedColumn(),
        bars.TimeRemainingColumn(),
    )
    shown = bars.Progress(*columns, console=console(stderr=True))
    tasks: dict[str, bars.TaskID] = {}
    logged, begun = not shown.console.is_terminal, monotonic()
    told_s = begun

    def tell(stage: str, done: int, total: int) -> None:
        nonlocal told_s
        # Started late, so that an error in the input is the only line there is.
        shown.start()
        if stage not in tasks:
            tasks[stage] = shown.add_task(stage, total=total)
        shown.update(tasks[stage], completed=done, total=total)
        if logged and monotonic() - told_s > LINE_EACH_S:
            told_s = monotonic()
            complain(f"{stage} {done}/{total}, {told_s - begun:.0f} s")

    try:
        yield tell
        for task in shown.tasks:
            shown.update(task.id, completed=task.total)
    finally:
        if tasks:
            shown.stop()
