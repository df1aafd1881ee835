"""`roadscope leaderboard`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from roadscope.commands import completion, options
from roadscope.commands.options import OUTPUT, RECORDED, RUNNING, argument, flag, option, workers
from roadscope.commands.terminal import complain, console, open_page, printable, progress_bars, say

if TYPE_CHECKING:
    from roadscope.benchmarks import Results, Suite
    from roadscope.benchmarks.boards import Board

DEFAULT_SUITE = "quick"

CHOICE = "What is ranked"
"""Heading of a group of options."""


def leaderboard(
    board: str | None = argument(
        "BOARD",
        "See roadscope list boards; all of the suite if left out.",
        names=completion.boards,
        default=None,
    ),
    *,
    entry: list[str] | None = option(
        "SPEC", "NAME or file.py:Class?arg=value to rank; repeatable", names=completion.entries
    ),
    suite: str | None = option(
        "NAME", "Episodes, entries: see roadscope list suites, or a .toml", names=completion.suites
    ),
    seeds: int | None = option("N", "First N seeds; thresholds are tuned on N train seeds", min=1),
    out: Path | None = option("DIR", "Write JSON, CSV, Markdown, LaTeX, replays there"),
    browse: bool = flag("--open", "Show the results as a page in a browser"),
    only: bool = flag("--only", "Rank only what --entry names", CHOICE),
    by: list[str] | None = option(
        "NAME",
        "Break down by scenario, condition, ...; repeatable",
        CHOICE,
        names=completion.breakdowns,
    ),
    detections: list[str] | None = option(
        "SPEC",
        "Detector whose detections trackers get, or stack (DETECTOR + TRACKER [+ N ms]) of "
        "drivers; repeatable",
        CHOICE,
        names=completion.detectors,
    ),
    calibration: Path | None = option(
        "FILE", "Calibration for fusions, by roadscope calibrate", CHOICE
    ),
    kitti: Path | None = option("DIR", "KITTI's data, in place of simulated traffic", RECORDED),
    lidar_height: float | None = option(
        "M", "Height of KITTI's LiDAR above the road; 1.73 if left out", RECORDED, min=0.1
    ),
    mot: Path | None = option("DIR", "MOTChallenge's data, for trackers", RECORDED),
    tracks: Path | None = option("DIR", "With --kitti or --mot: write all tracks there", RECORDED),
    jobs: int = options.JOBS,
    fresh: bool = flag("--fresh", "Compute all again, also results of earlier runs", RUNNING),
    deadline: float = option(
        "S",
        "Time limit of a plug-in for one episode; else 300 s",
        RUNNING,
        min=1,
        show_default=False,
        default=300.0,
    ),
    trust: bool = flag("--trust", "Run plug-ins in this process, where they can cheat", RUNNING),
    sandbox: bool = flag("--sandbox", "No network, read-only files; needs bubblewrap", RUNNING),
    backend: str = option(
        "NAME",
        "Workers: loky (this machine), ray, dask",
        RUNNING,
        show_default=False,
        names=completion.backends,
        default="loky",
    ),
    address: str | None = option(
        "URL", "Address of a ray or dask cluster, as tcp://HOST:8786", RUNNING
    ),
    width: int | None = options.WIDTH,
    quiet: bool = options.QUIET,
    json: bool = flag("--json", "Print leaderboard.json and nothing else", OUTPUT),
) -> None:
    """Rank methods on episodes; exit status 1 if an entry fails or is missing."""
    from roadscope.benchmarks.boards import chosen_boards
    from roadscope.benchmarks.cache import cache_dir
    from roadscope.benchmarks.graph import trusted_files_removed
    from roadscope.benchmarks.isolation import Limits
    from roadscope.benchmarks.loop import RunOptions
    from roadscope.benchmarks.report.page import PAGE
    from roadscope.benchmarks.report.track_files import save_tracks
    from roadscope.benchmarks.results.results import check_breakdown
    from roadscope.benchmarks.run import leaderboard as run
    from roadscope.benchmarks.run import plan
    from roadscope.benchmarks.workers import WorkerSettings

    loaded = _suite(suite, board, kitti=kitti, mot=mot, lidar_height_m=lidar_height)
    if seeds is not None:
        loaded = _with_fewer_seeds(loaded, seeds)
    board_names = None if board is None else [board]
    boards = chosen_boards(loaded, board_names)
    if detections:
        loaded = _with_detections(loaded, boards, detections)
    _check_tracks(tracks, kitti or mot, boards)
    if calibration is not None:
        _check_used("--calibration", boards, lambda each: each.uses_calibration)
    for each in by or ():
        check_breakdown(each, boards)
    page = (out or cache_dir()) / PAGE if browse else None
    settings = WorkerSettings(jobs if address else workers(jobs), backend, address)
    with progress_bars(quiet=quiet) as progress:
        results = run(
            loaded,
            entry or (),
            boards=board_names,
            only=only,
            jobs=settings.jobs,
            out_dir=out,
            fresh=fresh,
            progress=progress,
            kitti=kitti,
            mot=mot,
            calibration=calibration,
            deadline_s=deadline,
            trust=trust,
            sandbox=sandbox,
            notice=complain,
            backend=backend,
            address=address,
            page=page,
        )
        left_out: list[str] = []
        if tracks is not None:
            run_options = RunOptions(
                Limits(episode_s=deadline),
                trust,
                sandbox,
                hidden=() if out is None else (out,),
                data=tuple(path for path in (kitti, mot) if path is not None),
            )
            with run_options.probing():
                run_plan = plan(loaded, entry or (), only=only)
            with trusted_files_removed(run_plan.jobs, run_options):
                left_out = save_tracks(
                    run_plan.jobs, tracks, workers=settings, options=run_options, progress=progress
                )
    if page is not None:
        open_page(page)
    if json:
        typer.echo(results.to_json(), nl=False)
    if json or quiet:
        _complain_of_failures(results)
    else:
        _show_boards(results, loaded, console(width=width), list(dict.fromkeys(by or ())))
        if suite is None and not (kitti or mot):
            words = _repeated("--entry", entry)
            words += ["--only"] if only else []
            words += _repeated("--detections", detections)
            words += [] if calibration is None else ["--calibration", str(calibration)]
            words += ["--sandbox"] if sandbox else []
            _name_full_suite(board, words)
        if left_out:
            say(f"no tracks were written of {', '.join(left_out)}")
        for path in filter(None, (out and out / "leaderboard.json", page, tracks)):
            say(f"written: {path}")
        for line in _log_lines(results):
            say(line)
        _name_earlier_boards(out)
    if results.failed_entries or any(map(results.not_installed, entry or ())):
        raise typer.Exit(1)


def _show_boards(results: Results, suite: Suite, screen: Any, breakdowns: Sequence[str]) -> None:
    """Print every board with its remarks and breakdowns."""
    from rich.text import Text

    from roadscope.benchmarks.boards import board_named
    from roadscope.benchmarks.report import tables

    has_intervals = any(row.low is not None and row.low != row.high for row in results.rows)
    text = tables.explanation(
        suite, results.boards(), standings=results.standings, intervals=has_intervals
    )
    introduction = printable(f": {suite.summary_with_seeds}. {text}")
    screen.print(Text.assemble((printable(suite.title), "bold"), introduction))
    for name in results.boards():
        board = board_named(name)
        screen.print(Text(f"\n{name} board", style="bold"))
        screen.print(tables.board_table(results, name, screen.width))
        for line in tables.failure_lines(results, name):
            # Each failure is one line, however long, so that it can be searched for.
            screen.print(line, soft_wrap=True)
        lines = [
            tables.comparison(results, name),
            *tables.agreement_lines(results, name),
            board.remark(results.manifest.get("calibration", "")),
        ]
        if results.nothing_eligible(name):
            lines.insert(0, "No object in any episode is eligible: nothing is scored.")
        for line in filter(None, lines):
            screen.print(line)
        if note := tables.prediction_note(results, name):
            screen.print(f"\n{note}")
            screen.print(tables.prediction_table(results, name))
        if text := tables.footnote(results, name, screen.width):
            screen.print(text, style="dim")
        if board.always_by is not None and board.always_by[0] not in breakdowns:
            by, metric = board.always_by
            _show_breakdown(results, board, by, screen, (metric,))
        for by in breakdowns:
            _show_breakdown(results, board, by, screen)


def _show_breakdown(
    results: Results, board: Board, by: str, screen: Any, metrics: tuple[str, ...] = ()
) -> None:
    from rich.text import Text

    from roadscope.benchmarks.report.breakdowns import breakdown_tables, note

    if by not in [each.by for each in board.breakdowns]:
        return
    for table in breakdown_tables(results, board.name, by, screen.width, metrics=metrics):
        # A title within the table would be broken at the table's width.
        screen.print(Text(f"\n{table.title}", style="bold"))
        table.title = None
        screen.print(table)
    if text := note(board.name, by):
        screen.print(text, style="dim")


def _name_earlier_boards(out: Path | None) -> None:
    """Print the names of the boards of other suites in the folder."""
    from roadscope.benchmarks.report.board_files import earlier_boards

    if out is not None and (boards := earlier_boards(out)):
        names = ", ".join(printable(path.name) for path in boards)
        say(f"boards of earlier runs there: {names}")


def _repeated(name: str, values: list[str] | None) -> list[str]:
    """Return the words of an option that is repeated for each of its values."""
    return [word for value in values or () for word in (name, value)]


def _name_full_suite(board: str | None, words: Sequence[str]) -> None:
    """Print the command for the full suite of a board that was shown on the quick one."""
    from shlex import join

    from roadscope.benchmarks.suite_files import SUITES

    if board in SUITES and _usual_suite(board) != board:
        command = join(["roadscope", "leaderboard", board, "--suite", board, *words])
        say(f"A quick look. In full: {command}")


def _usual_suite(board: str | None) -> str:
    """Return the suite of a run without `--suite`; an unknown board is refused later."""
    from roadscope.benchmarks.boards import BOARDS

    registered = BOARDS.get(board) if board else None
    return registered.default_suite if registered else DEFAULT_SUITE


def _with_detections(suite: Suite, boards: Sequence[Board], detections: list[str]) -> Suite:
    """Return the suite with other detections for the boards whose entries get detections."""
    if suite.recorded:
        raise ValueError("--detections is for simulated traffic; recorded data have their own")
    _check_used("--detections", boards, lambda each: bool(each.detections_field))
    for board in filter(lambda each: each.detections_field, boards):
        suite = suite.with_settings(board.name, **{board.detections_field: tuple(detections)})
    return suite


def _with_fewer_seeds(suite: Suite, seeds: int) -> Suite:
    """Return the suite with only its first seeds; results that are stored for these are used."""
    from dataclasses import replace

    if suite.recorded:
        raise ValueError("--seeds is for simulated traffic; recorded sequences have none")
    if seeds > len(suite.seeds):
        raise ValueError(
            f"--seeds {seeds}: suite {suite.title} has {len(suite.seeds)}; a suite of your own, a "
            ".toml file, may have more"
        )
    return replace(suite, seeds=suite.seeds[:seeds])


def _suite(
    suite: str | None,
    board: str | None,
    *,
    kitti: Path | None,
    mot: Path | None,
    lidar_height_m: float | None,
) -> Suite:
    """Return the suite of that name, or one of a folder of recorded data."""
    from roadscope.benchmarks.recorded.kitti_drive import LIDAR_HEIGHT_M
    from roadscope.benchmarks.recorded.mot import MOT, mot_suite
    from roadscope.benchmarks.recorded.suite import KITTI
    from roadscope.benchmarks.suite_files import load_suite
    from roadscope.benchmarks.suite_folders import kitti_suite

    if kitti is not None and mot is not None:
        raise ValueError("--kitti and --mot are suites of their own; give one of them")
    if kitti is None and lidar_height_m is not None:
        raise ValueError("--lidar-height is of KITTI's LiDAR: name its folder with --kitti DIR")
    for name, folder in ((KITTI, kitti), (MOT, mot)):
        if folder is None and suite == name:
            raise ValueError(f"suite {name} is of recorded data: name its folder with --{name} DIR")
        if folder is not None and suite not in (None, name, DEFAULT_SUITE):
            raise ValueError(f"--{name} is a suite of its own; leave --suite {suite} out")
    if kitti is not None:
        boards = None if board is None else [board]
        height_m = LIDAR_HEIGHT_M if lidar_height_m is None else lidar_height_m
        return kitti_suite(kitti, boards, lidar_height_m=height_m, notice=complain)
    if mot is not None:
        return mot_suite(mot)
    return load_suite(suite or _usual_suite(board))


def _check_used(option: str, boards: Sequence[Board], uses: Callable[[Board], bool]) -> None:
    """Refuse an option that no board of the run uses."""
    from roadscope.benchmarks.boards import BOARDS

    if any(map(uses, boards)):
        return
    possible = [board.name for board in BOARDS.values() if uses(board)]
    word = "board" if len(possible) == 1 else "boards"
    names = " and ".join(board.name for board in boards)
    raise ValueError(f"{option} is for the {word} {' and '.join(possible)}, not {names}")


def _check_tracks(tracks: Path | None, recorded: Path | None, boards: Sequence[Board]) -> None:
    """Refuse a folder for tracks that nothing would be written to, before anything runs."""
    from roadscope.benchmarks.cache import usable_folder
    from roadscope.benchmarks.kinds import TRACKER

    if tracks is None:
        return
    if recorded is None:
        raise ValueError(
            "--tracks writes tracks of recorded data: name its folder with --kitti or --mot"
        )
    _check_used("--tracks", boards, lambda each: each.kind.name == TRACKER.name)
    usable_folder(tracks)


def _complain_of_failures(results: Results) -> None:
    """Print failed entries, and the files with their output, as errors."""
    from roadscope.benchmarks.report.tables import failure_lines

    for board in results.boards():
        for line in failure_lines(results, board):
            complain(line)
    for line in _log_lines(results):
        complain(line)


def _log_lines(results: Results) -> list[str]:
    """Return a line for each file that holds the output of a failed entry."""
    files = {(f.entry, f.log_file): None for f in results.failures if f.log_file}
    return [printable(f"output of {entry}: {path}") for entry, path in files]
