"""`roadscope submit`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadscope.commands.terminal import complain, console, progress_bars

if TYPE_CHECKING:
    from roadscope.benchmarks.results import Results
    from roadscope.benchmarks.submit import Submission


def submit(
    folder: Annotated[
        Path,
        typer.Argument(
            help="Results: tracking/SEQ.txt, odometry/SEQ.txt; with --kitti or --mot SEQ.txt.",
            metavar="DIR",
        ),
    ],
    *,
    suite: Annotated[
        Path | None,
        typer.Option(help="Folder of roadscope export that they are of; DIR if left out."),
    ] = None,
    kitti: Annotated[
        Path | None, typer.Option(help="They are of this folder of KITTI tracking data.")
    ] = None,
    mot: Annotated[
        Path | None, typer.Option(help="They are of this folder of MOTChallenge data.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="What the entry is called; as DIR if left out.")
    ] = None,
    inputs: Annotated[
        str | None,
        typer.Option(
            help="Whose detections were tracked, as the suite calls it, to compare the tracker "
            "with those that got the same."
        ),
    ] = None,
    beside: Annotated[
        Path | None,
        typer.Option(
            help="Show it as a row of this board: leaderboard.json of the suite, or its folder."
        ),
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Show all metrics.")] = False,
    json: Annotated[
        Path | None, typer.Option(help="Write the scores to this file, for roadscope compare.")
    ] = None,
) -> None:
    """Score results that were made elsewhere under the rules of a suite's board.

    Tracks are KITTI tracking results with 3-D boxes (MOTChallenge's with --mot), poses of the LiDAR
    are KITTI's 12 numbers a line or TUM's. Ends with status 1 if a sequence has no results.
    """
    from roadscope.benchmarks.submit import OWN, SubmitError, submit_kitti, submit_mot
    from roadscope.benchmarks.submit import submit as submit_results

    if sum(each is not None for each in (suite, kitti, mot)) > 1:
        raise SubmitError("--suite, --kitti and --mot exclude one another; give one of them")
    if inputs is not None and (kitti or mot):
        raise SubmitError("--inputs is for an exported suite")
    if kitti is not None:
        found = submit_kitti(folder, kitti, name=name)
    elif mot is not None:
        found = submit_mot(folder, mot, name=name)
    else:
        with progress_bars() as progress:
            found = submit_results(
                folder, name=name, suite=suite, inputs=inputs or OWN, progress=progress
            )
    if beside is None:
        _show(found, every)
    else:
        _show_board(found.beside(beside))
    if json is not None:
        _write(found, json)
    missing = [e for e in found.episodes if e.reason is not None]
    for e in missing:
        complain(f"failed: {found.name} on {e.board}, {e.scenario}, seed {e.seed}: {e.reason}")
    if missing:
        raise typer.Exit(1)


FIRST = {
    "tracking": ("hota", "mota", "idf1", "id_switches", "recall", "precision", "position_rmse_m"),
    "odometry": ("t_rel", "r_rel", "end", "false_motion"),
}
"""Metrics that are shown first; of recorded data those of tracking."""


def _show(found: Submission, every: bool) -> None:
    from rich.text import Text

    from roadscope.benchmarks.metrics.breakdown import split_name
    from roadscope.benchmarks.results.statistics import merged
    from roadscope.benchmarks.tables import score_table

    screen = console()
    for board in found.boards():
        of_board = [e for e in found.episodes if e.board == board]
        sound = [e.scores for e in of_board if e.reason is None]
        title = f"{found.name} on {board}: {len(sound)} of {len(of_board)} sequences"
        screen.print(Text(title, style="bold"))
        if not sound:
            continue
        names = [metric for metric in sound[0] if not split_name(metric)[1]]
        if not every:
            first = FIRST.get(board, FIRST["tracking"])
            names = [metric for metric in first if metric in names] or names
        screen.print(score_table({n: merged([s[n] for s in sound]) for n in names}))


def _show_board(results: Results) -> None:
    from roadscope.benchmarks.report.tables import board_table, comparison, footnote

    screen = console()
    for name in results.boards():
        screen.print(f"[bold]{name} board[/]")
        screen.print(board_table(results, name, screen.width))
        if text := comparison(results, name):
            screen.print(text, markup=False)
        screen.print(footnote(results, name, screen.width), style="dim", markup=False)


def _write(found: Submission, path: Path) -> None:
    from roadscope.benchmarks.cache import write_atomically

    def write(part: Path) -> None:
        part.write_text(found.to_json(), encoding="utf-8")

    write_atomically(path, write)
    typer.echo(f"written: {path}")
