"""Options that several commands have; they mean the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from roadscope.commands import completion

Jobs = Annotated[int, typer.Option(min=0, help="Worker processes; 0: one for each core.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]
JsonFile = Annotated[Path | None, typer.Option("--out", help="Write the JSON to this file, too.")]
Every = Annotated[bool, typer.Option("--all", help="Show all metrics.")]
Rig = Annotated[
    str, typer.Option(help="Sensors: a name or a .toml file.", autocompletion=completion.rigs)
]
Rate = Annotated[
    float, typer.Option(help="Scans per second, if neither times.txt nor their names have stamps.")
]
Topics = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="NAME",
        help="Topic of a bag, if it has several of one type; can be given several times.",
    ),
]
Layout = Annotated[
    str,
    typer.Option(
        metavar="COLUMNS",
        help="Columns of .bin and .npy files, such as x,y,z,intensity,ring,time; _: not used. If "
        "left out, what is in them decides.",
    ),
]


def workers(jobs: int) -> int:
    """Return the number of processes for --jobs: 0 stands for one on each core."""
    from joblib import cpu_count

    return jobs or int(cpu_count())
