"""`roadscope submit`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from roadscope.commands import completion, options
from roadscope.commands.options import RECORDED, argument, option
from roadscope.commands.terminal import complain, console, printable, progress_bars, say

if TYPE_CHECKING:
    from roadscope.benchmarks.results import Results
    from roadscope.benchmarks.submissions import Submission


def submit(
    folder: Path = argument(
        "DIR",
        "tracking/SEQ.txt, odometry/SEQ.txt, detection/SEQ/FRAME.txt, camera/SEQ/FRAME.txt; "
        "or SEQ.txt",
    ),
    *,
    suite: Path | None = option("DIR", "Folder of roadscope export; DIR if left out"),
    name: str | None = option("NAME", "Name of the entry; DIR's if left out", name="--name"),
    beside: Path | None = option(
        "PATH", "Show it as a row of this board: leaderboard.json or its folder"
    ),
    inputs: str | None = option(
        "SPEC",
        "The suite's detector whose detections were tracked, to compare with its trackers",
        names=completion.detectors,
    ),
    out: Path | None = options.JSON_FILE,
    kitti: Path | None = option("DIR", "Score on KITTI's tracking data in DIR", RECORDED),
    mot: Path | None = option("DIR", "Score on MOTChallenge's data in DIR", RECORDED),
    every: bool = options.EVERY,
    width: int | None = options.WIDTH,
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Score results of another program by the rules of a suite's board.

    Tracks are in KITTI's format with boxes in space (with --mot in MOTChallenge's), detections in
    KITTI's, a file for each scan or image, poses of the LiDAR in KITTI's or TUM's. The JSON is for
    roadscope compare.

    Exit status: 1 if a file is malformed or a sequence has no results.
    """
    from roadscope.benchmarks.cache import write_text
    from roadscope.benchmarks.submissions import OWN, SubmitError, submit_kitti, submit_mot
    from roadscope.benchmarks.submissions import submit as submit_suite

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
        _show(submission, every, width) if results is None else _show_board(results, width)
        if out is not None:
            say(f"written: {out}")
    missing = [e for e in submission.episodes if e.reason is not None]
    for e in missing:
        complain(f"failed: {submission.name} on {e.board}, {e.scenario}, seed {e.seed}: {e.reason}")
    if missing:
        raise typer.Exit(1)


def _show(submission: Submission, every: bool, width: int | None) -> None:
    from rich.text import Text

    from roadscope.benchmarks.boards import board_named
    from roadscope.benchmarks.metrics.breakdown import split_name
    from roadscope.benchmarks.results.statistics import merged
    from roadscope.benchmarks.tables import score_table

    screen = console(width=width)
    for board_name in submission.boards():
        board = board_named(board_name)
        of_board = [e for e in submission.episodes if e.board == board_name]
        sound = [e.scores for e in of_board if e.reason is None]
        title = f"{submission.name} on {board_name}: {len(sound)} of {len(of_board)} sequences"
        screen.print(Text(printable(title), style="bold"))
        if not sound:
            continue
        names = [metric for metric in sound[0] if not split_name(metric)[1]]
        if not every:
            first = (column.metric for column in board.columns)
            names = [metric for metric in first if metric in names] or names
        screen.print(score_table({name: merged(board.pooled(name, sound)) for name in names}))


def _show_board(results: Results, width: int | None) -> None:
    from rich.text import Text

    from roadscope.benchmarks.report.tables import board_table, comparison, footnote

    screen = console(width=width)
    for name in results.boards():
        screen.print(Text(f"{name} board", style="bold"))
        screen.print(board_table(results, name, screen.width))
        if text := comparison(results, name):
            screen.print(text)
        screen.print(footnote(results, name, screen.width), style="dim")
