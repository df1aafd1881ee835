"""`roadscope reproduce`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from roadscope.commands import options
from roadscope.commands.options import OUTPUT, argument, flag, option, workers
from roadscope.commands.terminal import console, headline, print_json, progress_bars, say, show

if TYPE_CHECKING:
    from roadscope.benchmarks.papers.reproduction import Reproduction


def reproduce(
    paper: str = argument("PAPER", "lu2018, zhang2017, li2021 or zhang2022"),
    seeds: int = option("N", "Episodes of each experiment", min=1, default=30),
    jobs: int = options.JOBS,
    everything: bool = flag("--all", "Show every method in full, as in PAPER.json", OUTPUT),
    figures: Path | None = option("DIR", "Draw a picture for every figure of the paper"),
    out: Path | None = option("DIR", "Write PAPER.json there"),
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Repeat a paper's experiments: which of its claims hold, and its figures beside ours.

    With --seeds 1 a paper takes one to five minutes on two cores; each further seed about as long.
    What an earlier run has measured is not measured again: a stopped run continues.
    """
    from dataclasses import asdict

    from roadscope.benchmarks.cache import usable_folder
    from roadscope.benchmarks.papers import draw_figures, module_of
    from roadscope.benchmarks.papers import reproduce as repeat
    from roadscope.benchmarks.papers.reproduction import write_reproduction

    module_of(paper)
    folder = None if out is None else usable_folder(out)
    pictures = None if figures is None else usable_folder(figures)
    drawn: list[Path] = []
    with progress_bars(quiet=quiet) as progress:
        result = repeat(
            paper, seeds, lambda done, total: progress("parts", done, total), jobs=workers(jobs)
        )
        if pictures is not None:
            drawn = draw_figures(
                paper, pictures, lambda done, total: progress("figures", done, total)
            )
    if folder is not None:
        write_reproduction(result, folder / f"{paper}.json")
    if json:
        print_json(asdict(result))
    elif not quiet:
        _show(paper, result, everything=everything)
        written = [] if folder is None else [folder / f"{paper}.json"]
        for path in (*written, *drawn):
            say(f"written: {path}")


def _show(paper: str, result: Reproduction, *, everything: bool) -> None:
    """Print the verdicts, then the tables of each experiment with its notes."""
    from roadscope.benchmarks.papers import note_of
    from roadscope.benchmarks.papers.printed_tables import (
        VERDICT_NOTE,
        reproduction_tables,
        verdict_table,
    )
    from roadscope.benchmarks.papers.reproduction import FAILS, HOLDS, OPEN

    counts = Counter(each.verdict for each in result.verdicts)
    plurals = {HOLDS: "hold", FAILS: "do not hold", OPEN: "open"}
    headline(f"{paper}: {', '.join(f'{counts[v]} {plural}' for v, plural in plurals.items())}")
    show("")
    show(verdict_table(result.verdicts))
    console().print(VERDICT_NOTE, style="dim")
    for experiment in dict.fromkeys(row.experiment for row in result.rows):
        show("")
        headline(experiment)
        shown = [row for row in result.rows if row.experiment == experiment]
        for table in reproduction_tables(shown, everything=everything):
            show("")
            show(table)
        if note := note_of(paper, experiment):
            console().print(note, style="dim")
