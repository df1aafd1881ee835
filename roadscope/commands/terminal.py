"""Output of the commands: results on stdout, complaints and progress on stderr."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Lock, Thread
from time import monotonic
from typing import Any, cast

import typer

LINE_EACH_S, FIRST_S, LATER_EACH_S = 2.0, 60.0, 10.0
"""Without a terminal, progress is lines of text: one every `LINE_EACH_S` in the first minute
(`FIRST_S`) and while kernels are compiled, then one every `LATER_EACH_S`."""
COMPILING_S = 20.0
"""After this time without a new kernel nothing is being compiled; chosen by hand."""
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
    """Print one bold line, which may be longer than the terminal is wide and may name files."""
    from rich.text import Text

    console().print(Text(printable(text), style="bold"), soft_wrap=True)


def print_json(content: Any) -> None:
    """Print content as JSON, and nothing else."""
    typer.echo(json.dumps(content, indent=1, allow_nan=False))


def open_page(path: Path) -> None:
    """Show a page in the user's browser; say so where there is none."""
    import webbrowser

    if not webbrowser.open(path.resolve().as_uri()):
        complain(f"no browser was found to show {path}")


def printable(text: str) -> str:
    """Return a text that may come from a plug-in or a file as one line that is safe to print."""
    from roadscope.core.text import one_line

    return one_line(text)


def say(line: object) -> None:
    """Write one line on stdout, which may name files or what a user gave."""
    from roadscope.core.text import without_controls

    typer.echo(without_controls(str(line)))


def complain(text: str) -> None:
    """Write one line on stderr."""
    typer.echo(printable(text), err=True)


@contextmanager
def progress_bars(
    *, quiet: bool = False, clock: Callable[[], float] = monotonic
) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function that shows progress: a bar for each stage; without a terminal, lines.

    quiet: show nothing. clock: returns the seconds by which lines are timed.
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
    if not display.console.is_terminal:
        with _Lines(clock) as lines:
            yield lines.update
        return
    tasks: dict[str, bars.TaskID] = {}

    def update(stage: str, done: int, total: int) -> None:
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


def count_kernels() -> int:
    """Return how many pieces of machine code are cached. The import also loads NumPy."""
    from roadscope.core.kernel_files import count_kernels

    return count_kernels()


class _Lines:
    """Progress as lines on stderr, also while nothing is reported; a context manager."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._start_s = clock, clock()
        self._written_s = -math.inf
        self._latest: tuple[str, int, int] | None = None
        self._kernels = self._kernels_at_start = count_kernels()
        self._compiled_s = -math.inf
        self._lock, self._ended = Lock(), Event()
        self._thread = Thread(target=self._repeat, daemon=True)

    def __enter__(self) -> _Lines:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        self._thread.join()

    def update(self, stage: str, done: int, total: int) -> None:
        """Report a stage; its begin and its end are always written."""
        with self._lock:
            begins = self._latest is None or self._latest[0] != stage
            self._latest = (stage, done, total)
            if begins or done == total or self._is_due():
                self._write()

    def _repeat(self) -> None:
        while not self._ended.wait(LINE_EACH_S / 4):
            with self._lock:
                if self._latest is not None and self._is_due():
                    self._write()

    def _is_due(self) -> bool:
        now_s = self._clock()
        if now_s - self._written_s < LINE_EACH_S:
            return False
        often = now_s - self._start_s < FIRST_S or self._is_compiling()
        return often or now_s - self._written_s >= LATER_EACH_S

    def _is_compiling(self) -> bool:
        """Whether kernels were added within the last `COMPILING_S`, or there are none yet."""
        before, self._kernels = self._kernels, count_kernels()
        if self._kernels > before:
            self._compiled_s = self._clock()
        return not self._kernels or self._clock() - self._compiled_s < COMPILING_S

    def _write(self) -> None:
        stage, done, total = cast("tuple[str, int, int]", self._latest)
        self._written_s = self._clock()
        line = f"{stage} {done}/{total}, {self._written_s - self._start_s:.0f} s"
        if done < total and self._is_compiling():
            new = self._kernels - self._kernels_at_start
            line += f"; compiling kernels, once per installation, {new} so far"
        complain(line)
