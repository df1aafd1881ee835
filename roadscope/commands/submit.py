"""`roadscope submit`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadscope.commands.options import Json, JsonFile, Quiet
from roadscope.commands.terminal import complain, console, printable, progress_bars

if TYPE_CHECKING:
    from roadscope.benchmarks.results import Results
    from roadscope.benchmarks.submit import Submission


Folder = Annotated[
    Path,
    typer.Argument(
        help="Folder of results: tracking/SEQ.txt, odometry/SEQ.txt, detection/SEQ/FRAME.txt; with "
        "--kitti or --mot SEQ.txt.",
        metavar="DIR",
    ),
]
Exported = Annotated[
    Path | None,
    typer.Option(
        "--suite", help="Folder that roadscope export wrote for the suite; DIR if left out."
    ),
]
Kitti = Annotated[Path | None, typer.Option(help="Score on this folder of KITTI tracking data.")]
Mot = Annotated[Path | None, typer.Option(help="Score on this folder of MOTChallenge data.")]
Name = Annotated[str | None, typer.Option(help="Name of the entry; that of DIR if left out.")]
Inputs = Annotated[
    str | None,
    typer.Option(
        help="The detector whose detections were tracked, by its name in the suite; the board then "
        "compares the tracker with those that got the same detections."
    ),
]
Beside = Annotated[
    Path | None,
    typer.Option(
        help="Show the entry as a row of this board: leaderboard.json of the suite, or its folder."
    ),
]
Every = Annotated[bool, typer.Option("--all", help="Show all metrics.")]


def submit(
    folder: Folder,
    *,
    suite: Exported = None,
    kitti: Kitti = None,
    mot: Mot = None,
    name: Name = None,
    inputs: Inputs = None,
    beside: Beside = None,
    every: Every = False,
    out: JsonFile = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Score results of another program by the rules of a suite's board.

    Tracks: KITTI tracking results with 3-D boxes (with --mot, MOTChallenge's). Detections: KITTI
    object results, a file for each scan. Poses: of the LiDAR, KITTI's 12 numbers a line or TUM's.
    The JSON can be read by roadscope compare.

    Exit status: 1 if a file is malformed or a sequence has no results.
    """
    from roadscope.benchmarks.cache import write_text
    from roadscope.benchmarks.submit import OWN, SubmitError, submit_kitti, submit_mot
    from roadscope.benchmarks.submit import submit as submit_suite

    if sum(each is not None for each in (suite, kitti, mot)) > 1:
        raise SubmitError("--suite, --kitti and --mot exclude one another; use one of them")
    if inputs is not None and (kitti or mot):
        raise SubmitError("--inputs is for an exported suite")
    with progress_bars(quiet=quiet) as progress:
        if kitti is not None:
            submission = submit_kitti(folder, kitti, name=name)
        elif mot is not None:
            submission = submit_mot(folder, mot, name=name)
        else:
            submission = submit_suite(
                folder, suite=suite, name=name, inputs=inputs or OWN, progress=progress
            )
    results = None if beside is None else submission.beside(beside)
    if out is not None:
        write_text(out, submission.to_json())
    if json:
        typer.echo(submission.to_json(), nl=False)
    elif not quiet:
        _show(submission, every) if results is None else _show_board(results)
        if out is not None:
            typer.echo(f"written: {out}")
    missing = [e for e in submission.episodes if e.reason is not None]
    for e in missing:
        complain(f"failed: {submission.name} on {e.board}, {e.scenario}, seed {e.seed}: {e.reason}")
    if missing:
        raise typer.Exit(1)


def _show(submission: Submission, every: bool) -> None:
    from rich.text import Text

    from roadscope.benchmarks.boards import board_named
    from roadscope.benchmarks.metrics.breakdown import split_name
    from roadscope.benchmarks.results.statistics import merged
    from roadscope.benchmarks.tables import score_table

    screen = console()
    for board in submission.boards():
        of_board = [e for e in submission.episodes if e.board == board]
        sound = [e.scores for e in of_board if e.reason is None]
        title = f"{submission.name} on {board}: {len(sound)} of {len(of_board)} sequences"
        screen.print(Text(printable(title), style="bold"))
        if not sound:
            continue
        names = [metric for metric in sound[0] if not split_name(metric)[1]]
        if not every:
            first = (column.metric for column in board_named(board).columns)
            names = [metric for metric in first if metric in names] or names
        screen.print(score_table({n: merged([s[n] for s in sound]) for n in names}))


def _show_board(results: Results) -> None:
    from rich.text import Text

    from roadscope.benchmarks.report.tables import board_table, comparison, footnote

    screen = console()
    for name in results.boards():
        screen.print(Text(f"{name} board", style="bold"))
        screen.print(board_table(results, name, screen.width))
        if text := comparison(results, name):
            screen.print(text)
        screen.print(footnote(results, name, screen.width), style="dim")
