"""What the studies of this folder share: options of the command line and tables."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from rich.console import Console

from roadscope.benchmarks.papers.reproduction import (
    FigureKey,
    ReproductionRow,
    over_seeds,
    reproduction_tables,
    write_rows,
)


def study_parser(module: str, description: str | None, *, seeds: int) -> argparse.ArgumentParser:
    """Return a parser with the options of a study that is repeated over seeds.

    module: its name below `research`. seeds: how many are measured by default.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m research.{module}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seeds", type=int, default=seeds, help="default: %(default)s")
    parser.add_argument("--jobs", type=int, default=1, help="processes that share the seeds")
    parser.add_argument("--out", type=Path, help="JSON file for the rows")
    return parser


def measured_over_seeds(
    measure: Callable[[int], dict[FigureKey, float]], first_seed: int, options: argparse.Namespace
) -> dict[FigureKey, list[float]]:
    """Run a study with the seeds that the options ask for, and say how far it is."""
    seeds = range(first_seed, first_seed + options.seeds)
    return over_seeds(
        measure, seeds, lambda done, of: print(f"seed {done} of {of}"), jobs=options.jobs
    )


def show(
    rows: Sequence[ReproductionRow], notes: Mapping[str, str], options: argparse.Namespace
) -> None:
    """Print the rows as tables, and write them where the options ask for it.

    notes: by a part of the name of an experiment, what a reader must know of it.
    """
    console = Console()
    for experiment in dict.fromkeys(row.experiment for row in rows):
        console.print(f"\n[bold]{experiment}[/]")
        for table in reproduction_tables(
            [row for row in rows if row.experiment == experiment], everything=True
        ):
            console.print()
            console.print(table)
        for part, note in notes.items():
            if part in experiment:
                console.print(note, style="dim")
    if options.out is not None:
        write_rows(rows, options.out)
