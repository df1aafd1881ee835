"""`roadscope reproduce`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadscope.commands.options import Jobs, Json, Quiet, workers
from roadscope.commands.terminal import console, headline, print_json, progress_bars, show

if TYPE_CHECKING:
    from roadscope.benchmarks.papers.reproduction import ReproductionRow


def reproduce(
    paper: Annotated[
        str, typer.Argument(help="The paper: lu2018, zhang2017, li2021 or zhang2022.")
    ],
    seeds: Annotated[
        int, typer.Option(min=1, help="Number of episodes, from which intervals are computed.")
    ] = 30,
    jobs: Jobs = 0,
    everything: Annotated[
        bool, typer.Option("--all", help="Show every method in full, as in PAPER.json.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for PAPER.json.")] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Repeat a paper's experiments and print its figures beside ours.

    This takes minutes on two cores; zhang2022 has long drives and takes an hour or two, with
    --seeds 3 a quarter of an hour.
    """
    from dataclasses import asdict

    from roadscope.benchmarks.cache import usable_folder
    from roadscope.benchmarks.papers import reproduction_of
    from roadscope.benchmarks.papers.reproduction import write_rows

    experiments = reproduction_of(paper)
    folder = None if out is None else usable_folder(out)
    with progress_bars(quiet=quiet) as progress:
        rows = experiments(seeds, lambda done, of: progress("seeds", done, of), jobs=workers(jobs))
    if folder is not None:
        write_rows(rows, folder / f"{paper}.json")
    if json:
        print_json([asdict(row) for row in rows])
    elif not quiet:
        _show(paper, rows, everything=everything)
        if folder is not None:
            typer.echo(f"written: {folder / f'{paper}.json'}")


def _show(paper: str, rows: Sequence[ReproductionRow], *, everything: bool) -> None:
    """Print the tables of each experiment, with what must be said of it."""
    from roadscope.benchmarks.papers import note_of
    from roadscope.benchmarks.papers.reproduction import reproduction_tables

    for experiment in dict.fromkeys(row.experiment for row in rows):
        show("")
        headline(experiment)
        shown = [row for row in rows if row.experiment == experiment]
        for table in reproduction_tables(shown, everything=everything):
            show("")
            show(table)
        if note := note_of(paper, experiment):
            console().print(note, style="dim")
