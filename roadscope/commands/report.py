"""`roadscope report`."""

from __future__ import annotations

from pathlib import Path

from roadscope.commands import options
from roadscope.commands.options import argument, flag, option
from roadscope.commands.terminal import complain, open_page, say


def report(
    folder: Path = argument("DIR", "A folder that roadscope leaderboard --out wrote"),
    *,
    out: Path | None = option("FILE", "The page; report.html in DIR if left out"),
    browse: bool = flag("--open", "Show the page in a browser"),
    quiet: bool = options.QUIET,
) -> None:
    """Write one HTML page of the boards in a folder: tables, plots, replay of the worst moments.

    The page is one file that loads nothing from elsewhere. It sorts and filters boards, draws
    metrics against time, breakdowns and paired differences to a chosen entry, shows failures with
    what was printed, and replays where an entry missed an object, raised a false alarm, switched
    an identity, drifted or collided.
    """
    from roadscope.benchmarks.cache import usable_file
    from roadscope.benchmarks.report.page import PAGE, read_runs, save_page

    runs = read_runs(folder)
    path = usable_file(folder / PAGE if out is None else out, (".html", ".htm"), "a page")
    for text in save_page(runs, path):
        complain(f"warning: {text}")
    if not quiet:
        say(f"written: {path}")
    if browse:
        open_page(path)
