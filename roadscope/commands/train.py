"""`roadscope train`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from roadscope.commands.options import Jobs, Quiet, workers
from roadscope.commands.terminal import headline, progress_bars, show


def train(
    what: Annotated[str, typer.Argument(metavar="WHAT", help="camera")],
    recipe: Annotated[
        str,
        typer.Option(metavar="NAME", help="full (half an hour on two cores), small or trial"),
    ] = "full",
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Of all random draws")] = 0,
    jobs: Jobs = 0,
    work: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="For pictures (up to 5 GB) and checkpoints; else the cache"
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="The weights; a .toml comes beside it")
    ] = Path("network.safetensors"),
    quiet: Quiet = False,
) -> None:
    """Train the camera detector from simulated pictures.

    Pictures and checkpoints of an earlier run are used: a stopped run continues.
    """
    from roadscope.benchmarks.train.camera import train_camera

    if what != "camera":
        raise ValueError(f"'{what}' cannot be trained; possible: camera")
    with progress_bars(quiet=quiet) as progress:
        result = train_camera(
            out, recipe=recipe, seed=seed, work=work, jobs=workers(jobs), progress=progress
        )
    if quiet:
        return
    from roadscope.benchmarks.tables import score_table

    for name, scores in {"validation seeds": result.scores, **result.held_out}.items():
        headline(f"{name.replace('_', ' ')}: {scores.ap50.n} road users")
        show(score_table(scores.named()))
    typer.echo(f"written: {result.weights}, {result.record}")
