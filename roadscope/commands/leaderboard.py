"""`roadscope leaderboard`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from roadscope.commands import completion
from roadscope.commands.options import (
    OUTPUT,
    RECORDED,
    RUNNING,
    Jobs,
    Quiet,
    Width,
    flag,
    option,
    workers,
)
from roadscope.commands.terminal import complain, console, open_page, printable, progress_bars

if TYPE_CHECKING:
    from roadscope.benchmarks import Results, Suite
    from roadscope.benchmarks.boards import Board
    from roadscope.benchmarks.loop import RunOptions
    from roadscope.benchmarks.workers import WorkerSettings

DEFAULT_SUITE = "quick"

CHOICE = "What is ranked"

BoardName = Annotated[
    str | None,
    typer.Argument(
        metavar="BOARD",
        help="See roadscope list boards; all of the suite if left out.",
        autocompletion=completion.boards,
    ),
]
Entry = Annotated[
    list[str] | None,
    option(
        "SPEC",
        "NAME or file.py:Class?arg=value to rank; repeatable",
        autocompletion=completion.entries,
    ),
]
SuiteName = Annotated[
    str | None,
    option(
        "NAME",
        "Episodes, entries: see roadscope list suites, or a .toml",
        autocompletion=completion.suites,
    ),
]
Seeds = Annotated[
    int | None, option("N", "First N seeds; thresholds are tuned on N train seeds", min=1)
]
Out = Annotated[Path | None, option("DIR", "Write JSON, CSV, Markdown, LaTeX, replays there")]
Open = Annotated[bool, flag("--open", "Show the results as a page in a browser")]
Only = Annotated[bool, flag("--only", "Rank only what --entry names", CHOICE)]
By = Annotated[
    list[str] | None, option("NAME", "Break down by scenario, condition, ...; repeatable", CHOICE)
]
Detections = Annotated[
    list[str] | None,
    option(
        "SPEC",
        "Detector whose detections trackers get, or stack (DETECTOR + TRACKER) of drivers; "
        "repeatable",
        CHOICE,
        autocompletion=completion.detectors,
    ),
]
Calibration = Annotated[
    Path | None, option("FILE", "Calibration for fusions, by roadscope calibrate", CHOICE)
]
Kitti = Annotated[
    Path | None, option("DIR", "KITTI's data, in place of simulated traffic", RECORDED)
]
LidarHeight = Annotated[
    float | None,
    option("M", "Height of KITTI's LiDAR above the road; 1.73 if left out", RECORDED, min=0.1),
]
Mot = Annotated[Path | None, option("DIR", "MOTChallenge's data, for trackers", RECORDED)]
Tracks = Annotated[
    Path | None, option("DIR", "With --kitti or --mot: write all tracks there", RECORDED)
]
Fresh = Annotated[bool, flag("--fresh", "Compute all again, also results of earlier runs", RUNNING)]
Deadline = Annotated[
    float,
    option(
        "S",
        "Time limit of a plug-in for one episode; else 300 s",
        RUNNING,
        min=1,
        show_default=False,
    ),
]
Trust = Annotated[
    bool, flag("--trust", "Run plug-ins in this process, where they can cheat", RUNNING)
]
Sandbox = Annotated[
    bool, flag("--sandbox", "No network, read-only files; needs bubblewrap", RUNNING)
]
Backend = Annotated[
    str,
    option(
        "NAME",
        "Workers: loky (this machine), ray, dask",
        RUNNING,
        show_default=False,
        autocompletion=completion.backends,
    ),
]
Address = Annotated[
    str | None, option("URL", "Address of a ray or dask cluster, as tcp://HOST:8786", RUNNING)
]
Json = Annotated[bool, flag("--json", "Print leaderboard.json and nothing else", OUTPUT)]


def leaderboard(
    board: BoardName = None,
    *,
    entry: Entry = None,
    suite: SuiteName = None,
    seeds: Seeds = None,
    out: Out = None,
    browse: Open = False,
    only: Only = False,
    by: By = None,
    detections: Detections = None,
    calibration: Calibration = None,
    kitti: Kitti = None,
    lidar_height: LidarHeight = None,
    mot: Mot = None,
    tracks: Tracks = None,
    jobs: Jobs = 0,
    fresh: Fresh = False,
    deadline: Deadline = 300.0,
    trust: Trust = False,
    sandbox: Sandbox = False,
    backend: Backend = "loky",
    address: Address = None,
    width: Width = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Rank methods on a suite's episodes; exit status 1 if an entry fails or is missing."""
    from roadscope.benchmarks.boards import chosen_boards
    from roadscope.benchmarks.cache import cache_dir
    from roadscope.benchmarks.isolation import Limits
    from roadscope.benchmarks.loop import RunOptions
    from roadscope.benchmarks.report.page import PAGE
    from roadscope.benchmarks.results.results import check_breakdown
    from roadscope.benchmarks.run import leaderboard as run
    from roadscope.benchmarks.workers import WorkerSettings

    recorded = _RecordedData(kitti, mot, lidar_height)
    loaded = _suite(suite, board, recorded)
    loaded = loaded if seeds is None else _with_fewer_seeds(loaded, seeds)
    boards = chosen_boards(loaded, None if board is None else [board])
    loaded = _with_detections(loaded, boards, detections) if detections else loaded
    _check_tracks(tracks, kitti or mot, boards)
    if calibration is not None:
        _boards_for("--calibration", boards, lambda each: each.uses_calibration)
    for each in by or ():
        check_breakdown(each, boards)
    page = (out or cache_dir()) / PAGE if browse else None
    settings = WorkerSettings(jobs if address else workers(jobs), backend, address)
    with progress_bars(quiet=quiet) as progress:
        results = run(
            loaded,
            entry or (),
            boards=None if board is None else [board],
            only=only,
            jobs=settings.jobs,
            out_dir=out,
            fresh=fresh,
            progress=progress,
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
            left_out = _save_tracks(
                loaded,
                entry or (),
                tracks,
                only=only,
                settings=settings,
                options=RunOptions(
                    Limits(episode_s=deadline),
                    trust,
                    sandbox,
                    hidden=() if out is None else (out,),
                    data=tuple(path for path in (kitti, mot) if path is not None),
                ),
                progress=progress,
            )
    if page is not None:
        open_page(page)
    if json:
        typer.echo(results.to_json(), nl=False)
    if json or quiet:
        _complain_of_failures(results)
    else:
        shown = _BoardPrinter(results, loaded, console(width=width), tuple(dict.fromkeys(by or ())))
        shown.show()
        if suite is None and not (kitti or mot):
            options = [*_repeated("--entry", entry), *["--only"] * only]
            options += _repeated("--detections", detections)
            options += [] if calibration is None else ["--calibration", str(calibration)]
            _name_full_suite(board, [*options, *["--sandbox"] * sandbox])
        if left_out:
            typer.echo(f"no tracks were written of {', '.join(left_out)}")
        _name_written(out and out / "leaderboard.json", page, tracks)
        for line in _log_lines(results):
            typer.echo(line)
        _name_earlier_boards(out)
    if results.failed_entries or any(map(results.not_installed, entry or ())):
        raise typer.Exit(1)


@dataclass(frozen=True, slots=True)
class _BoardPrinter:
    """Prints the boards of a run on a terminal."""

    results: Results
    suite: Suite
    screen: Any
    by: tuple[str, ...]

    def show(self) -> None:
        """Print every board with its remarks."""
        from rich.text import Text

        from roadscope.benchmarks.boards import board_named
        from roadscope.benchmarks.report.tables import (
            agreement_lines,
            board_table,
            comparison,
            explanation,
            failure_lines,
            footnote,
            prediction_lines,
        )

        results, screen = self.results, self.screen
        marked = any(place.mark for place in results.standings)
        bounded = any(row.low is not None and row.low != row.high for row in results.rows)
        text = explanation(self.suite, results.boards(), marks=marked, intervals=bounded)
        introduction = printable(f": {self.suite.summary_with_seeds}. {text}")
        screen.print(Text.assemble((printable(self.suite.title), "bold"), introduction))
        for name in results.boards():
            board = board_named(name)
            screen.print(Text(f"\n{name} board", style="bold"))
            screen.print(board_table(results, name, screen.width))
            for line in failure_lines(results, name):
                # Each failure is one line, however long, so that it can be searched for.
                screen.print(line, soft_wrap=True)
            lines = [
                comparison(results, name),
                *agreement_lines(results, name),
                *prediction_lines(results, name),
            ]
            lines.append(board.remark(results.manifest.get("calibration", "")))
            if results.nothing_eligible(name):
                lines.insert(0, "No object in any episode is eligible: nothing is scored.")
            for line in filter(None, lines):
                screen.print(line)
            if text := footnote(results, name, screen.width):
                screen.print(text, style="dim")
            if board.always_by is not None and board.always_by[0] not in self.by:
                by, metric = board.always_by
                self._show_breakdown(name, by, (metric,))
            for by in self.by:
                self._show_breakdown(name, by)

    def _show_breakdown(self, board: str, by: str, metrics: tuple[str, ...] = ()) -> None:
        from rich.text import Text

        from roadscope.benchmarks.boards import board_named
        from roadscope.benchmarks.report.breakdowns import breakdown_tables, note

        if by not in [each.by for each in board_named(board).breakdowns]:
            return
        screen = self.screen
        for table in breakdown_tables(self.results, board, by, screen.width, metrics=metrics):
            # A title within the table would be broken at the table's width.
            screen.print(Text(f"\n{table.title}", style="bold"))
            table.title = None
            screen.print(table)
        if text := note(board, by):
            screen.print(text, style="dim")


def _save_tracks(
    suite: Suite,
    entries: Sequence[str],
    folder: Path,
    *,
    only: bool,
    settings: WorkerSettings,
    options: RunOptions,
    progress: Any,
) -> list[str]:
    """Write the tracks of the run to files; return the entries that have none."""
    from roadscope.benchmarks.report.track_files import save_tracks
    from roadscope.benchmarks.run import plan

    with options.probing():
        run_plan = plan(suite, entries, only=only)
    return save_tracks(run_plan.jobs, folder, workers=settings, options=options, progress=progress)


def _name_written(*paths: Path | None) -> None:
    for path in paths:
        if path is not None:
            typer.echo(f"written: {path}")


def _name_earlier_boards(out: Path | None) -> None:
    """Print the names of the boards of other suites in the folder."""
    from roadscope.benchmarks.report.board_files import earlier_boards

    if out is not None and (boards := earlier_boards(out)):
        typer.echo(f"boards of earlier runs there: {', '.join(path.name for path in boards)}")


def _repeated(name: str, values: list[str] | None) -> list[str]:
    return [word for value in values or () for word in (name, value)]


def _name_full_suite(board: str | None, options: Sequence[str]) -> None:
    """Print the command for the full suite of a board that was shown on the quick one."""
    from shlex import join

    from roadscope.benchmarks.suite_files import SUITES

    if board in SUITES and _usual_suite(board) != board:
        command = join(["roadscope", "leaderboard", board, "--suite", board, *options])
        typer.echo(f"A quick look. In full: {command}")


def _usual_suite(board: str | None) -> str:
    from roadscope.benchmarks.boards import BOARDS

    registered = BOARDS.get(board) if board else None
    return registered.default_suite if registered else DEFAULT_SUITE


def _with_detections(suite: Suite, boards: Sequence[Board], detections: list[str]) -> Suite:
    """Return the suite with other detections for the boards whose entries get detections."""
    if suite.recorded:
        raise ValueError("--detections is for simulated traffic; recorded data have their own")
    for board in _boards_for("--detections", boards, lambda each: bool(each.detections_field)):
        suite = suite.with_settings(board.name, **{board.detections_field: tuple(detections)})
    return suite


def _with_fewer_seeds(suite: Suite, seeds: int) -> Suite:
    """Return the suite with only its first seeds, so that earlier results of them count."""
    from dataclasses import replace

    if suite.recorded:
        raise ValueError("--seeds is for simulated traffic; recorded sequences have none")
    if seeds > len(suite.seeds):
        raise ValueError(
            f"--seeds {seeds}: suite {suite.title} has {len(suite.seeds)}; a suite of your own, a "
            ".toml file, may have more"
        )
    return replace(suite, seeds=suite.seeds[:seeds])


@dataclass(frozen=True, slots=True)
class _RecordedData:
    """The folders of recorded data that were named, and the height of KITTI's LiDAR."""

    kitti: Path | None
    mot: Path | None
    lidar_height_m: float | None


def _suite(suite: str | None, board: str | None, recorded: _RecordedData) -> Suite:
    """Return the suite of that name, or one of a folder of recorded data."""
    from roadscope.benchmarks.recorded.kitti_drive import LIDAR_HEIGHT_M
    from roadscope.benchmarks.recorded.mot import MOT, mot_suite
    from roadscope.benchmarks.recorded.suite import KITTI
    from roadscope.benchmarks.suite_files import load_suite
    from roadscope.benchmarks.suite_folders import kitti_suite

    kitti, mot = recorded.kitti, recorded.mot
    if kitti is not None and mot is not None:
        raise ValueError("--kitti and --mot are suites of their own; give one of them")
    if kitti is None and recorded.lidar_height_m is not None:
        raise ValueError("--lidar-height is of KITTI's LiDAR: name its folder with --kitti DIR")
    for name, folder in ((KITTI, kitti), (MOT, mot)):
        if folder is None and suite == name:
            raise ValueError(f"suite {name} is of recorded data: name its folder with --{name} DIR")
        if folder is not None and suite not in (None, name, DEFAULT_SUITE):
            raise ValueError(f"--{name} is a suite of its own; leave --suite {suite} out")
    if kitti is not None:
        boards = None if board is None else [board]
        height_m = LIDAR_HEIGHT_M if recorded.lidar_height_m is None else recorded.lidar_height_m
        return kitti_suite(kitti, boards, lidar_height_m=height_m, notice=complain)
    return load_suite(suite or _usual_suite(board)) if mot is None else mot_suite(mot)


def _boards_for(option: str, boards: Sequence[Board], uses: Callable[[Board], bool]) -> list[Board]:
    """Return the boards of the run that use an option; refuse it if none does."""
    from roadscope.benchmarks.boards import BOARDS

    using = [board for board in boards if uses(board)]
    if not using:
        possible = [board.name for board in BOARDS.values() if uses(board)]
        word = "board" if len(possible) == 1 else "boards"
        names = " and ".join(board.name for board in boards)
        raise ValueError(f"{option} is for the {word} {' and '.join(possible)}, not {names}")
    return using


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
    _boards_for("--tracks", boards, lambda each: each.kind.name == TRACKER.name)
    usable_folder(tracks)


def _complain_of_failures(results: Results) -> None:
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
