"""What the studies of this folder share: options of the command line and tables."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from roadscope.benchmarks.papers.printed_tables import reproduction_tables
from roadscope.benchmarks.papers.reproduction import FigureKey, Figures, ReproductionRow, by_figure
from roadscope.benchmarks.speed.measure import run_steps, write_speed
from roadscope.benchmarks.speed.rows import SpeedStep
from roadscope.benchmarks.tables import speed_table
from roadscope.benchmarks.workers import in_parallel


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
    measure: Callable[[int], Figures], first_seed: int, options: argparse.Namespace
) -> dict[FigureKey, list[float]]:
    """Run a study with the seeds that the options ask for, and say how far it is.

    Return one value a seed for each figure, NaN for a seed without it.
    """
    seeds = range(first_seed, first_seed + options.seeds)
    of_seeds: list[Figures] = [{} for _ in seeds]
    for done, (index, figures) in enumerate(in_parallel(measure, seeds, options.jobs), start=1):
        of_seeds[index] = figures
        print(f"seed {done} of {len(seeds)}")
    return by_figure(of_seeds)


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
        text = json.dumps([asdict(row) for row in rows], indent=1, allow_nan=False)
        options.out.write_text(text + "\n", encoding="utf-8")


def run_speed_study(
    module: str,
    description: str | None,
    parts: Mapping[str, Callable[[], list[SpeedStep]]],
    arguments: Sequence[str] | None,
) -> None:
    """Measure the parts that the arguments name, all by default, and print a table.

    module: its name below `research`. parts: by name, what returns the steps.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m research.{module}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(parts))
    parser.add_argument("--out", type=Path, help="JSON file for the rows")
    options = parser.parse_args(arguments)
    if unknown := [part for part in options.parts if part not in parts]:
        parser.error(f"no part {', '.join(unknown)}; known: {', '.join(parts)}")
    steps = [step for part in options.parts or parts for step in parts[part]()]
    rows = run_steps(steps, lambda name, done, of: print(f"{done + 1} of {of}: {name}"))
    Console().print(speed_table(rows))
    if options.out is not None:
        write_speed(rows, options.out)
