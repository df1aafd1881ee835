"""The command line. Everything it does is a function of `roadscope.benchmarks`.

Imports beyond typer and rich happen inside the commands, so that `--help` answers at once.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

USAGE, FAILED, INTERRUPTED = 2, 1, 130
DEFAULT_SUITE = "quick"

app = typer.Typer(
    name="roadscope",
    help="Compare LiDAR detectors and trackers on simulated traffic with perfect truth.",
    epilog="Start with:  roadscope leaderboard",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Jobs = Annotated[int, typer.Option(min=0, help="Worker processes; 0: one for each core.")]
Entries = Annotated[
    list[str] | None,
    typer.Option(
        help="Your detector or tracker, beside the suite's own: a name, module:Class or "
        "file.py:Class, with ?argument=value. Can be given several times."
    ),
]
Breakdown = Annotated[
    str | None,
    typer.Option(
        help="Show it by this too: range, category, occlusion, points or score (detection), "
        "weather or scenario (both boards)."
    ),
]


def _version(asked: bool) -> None:
    if asked:
        from roadscope import __version__

        typer.echo(f"roadscope {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Options before the command."""


@app.command("list", epilog="Example:  roadscope list detectors")
def list_names(
    kind: Annotated[
        str | None,
        typer.Argument(
            help="detectors, stages (of detectors), trackers, scenarios, suites, rigs, sensors or "
            "weathers; all if left out."
        ),
    ] = None,
) -> None:
    """Show what can be named."""
    from roadscope.benchmarks.listing import KINDS, names_of
    from roadscope.benchmarks.tables import name_table

    for each in [kind] if kind else KINDS:
        _print(name_table(each, names_of(each)))


@app.command("run", epilog="Example:  roadscope run roundabout --seed 3 --picture scene.png")
def run_scenario(
    scenario: Annotated[str, typer.Argument(help="Traffic, see: roadscope list scenarios.")],
    *,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another episode.")] = 0,
    rig: Annotated[str, typer.Option(help="Sensors: a name or a .toml file.")] = "lux",
    weather: Annotated[str, typer.Option(help="Such as rain-2, see: roadscope list weathers.")] = (
        "clear"
    ),
    detector: Annotated[
        str, typer.Option(help="A name, module:Class or file.py:Class, with ?argument=value.")
    ] = "distance-l-shape",
    tracker: Annotated[str, typer.Option(help="Likewise.")] = "nearest-q-confirmed",
    picture: Annotated[
        Path | None, typer.Option(help="Write a bird's-eye view of the middle frame here.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Length of the episode; the scenario's own if left out.")
    ] = None,
) -> None:
    """Run one episode through one detector and one tracker."""
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.single import picture_path, run_episode, save_picture
    from roadscope.benchmarks.tables import score_table

    episode = Episode(scenario, seed, rig, seconds, weather)
    if picture is not None:
        picture_path(picture)
    with _progress() as progress:
        summary = run_episode(episode, detector=detector, tracker=tracker, progress=progress)
        if picture is not None:
            progress("picture", 0, 1)
            save_picture(summary, picture)
    frames = len(summary.tracks)
    where = f"{scenario}, seed {seed}, {rig}" + (f", {weather}" if weather != "clear" else "")
    typer.echo(f"{where}: {frames} frames, vehicles within 60 m")
    _print(score_table(summary.detection, f"detector {detector}"))
    _print(score_table(summary.tracking, f"tracker {tracker}"))
    if picture is not None:
        typer.echo(f"picture: {picture}")


@app.command(epilog='Example:  roadscope leaderboard --entry "my_tracker.py:Mine?gate_m=2.5"')
def leaderboard(
    board: Annotated[
        str | None, typer.Argument(help="detection or tracking; both if left out.")
    ] = None,
    *,
    suite: Annotated[
        str, typer.Option(help="Conditions: a name (roadscope list suites) or a .toml file.")
    ] = DEFAULT_SUITE,
    entry: Entries = None,
    only: Annotated[bool, typer.Option("--only", help="Run the given entries alone.")] = False,
    by: Breakdown = None,
    jobs: Jobs = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for leaderboard.json, .csv, .md and the results database."),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Do again what an earlier run has done.")
    ] = False,
    kitti: Annotated[
        Path | None,
        typer.Option(
            help="Rank trackers on your folder of KITTI tracking data: label_02, calib, "
            "det_NAME/Car, ego_pose or oxts."
        ),
    ] = None,
) -> None:
    """Rank detectors and trackers on a suite of traffic.

    What an earlier run has finished is not done again; a stopped run goes on where it was.

    An entry that fails becomes a row with its reason.
    """
    from roadscope.benchmarks.plan import BOARDS
    from roadscope.benchmarks.recorded import KITTI_BOARDS
    from roadscope.benchmarks.results import check_breakdown
    from roadscope.benchmarks.runner import run

    boards = BOARDS if board is None else (board,)
    conditions = _conditions(suite, kitti)
    if by is not None and set(boards) <= set(BOARDS):
        check_breakdown(by, boards if kitti is None else KITTI_BOARDS)
    with _progress() as progress:
        results = run(
            conditions,
            entry or (),
            boards=boards,
            only=only,
            jobs=jobs or _cores(),
            out_dir=out,
            fresh=fresh,
            progress=progress,
        )
    _show(results, conditions, by)
    if out is not None:
        typer.echo(f"written: {out / 'leaderboard.json'}")
    if results.barren():
        raise typer.Exit(FAILED)


@app.command("check", epilog="Example:  roadscope check my_tracker.py:Mine")
def check_one(
    spec: Annotated[
        str, typer.Argument(help="A tracker or LiDAR detector: module:Class or file.py:Class.")
    ],
    deadline: Annotated[
        float, typer.Option(min=1, help="Seconds for each item; what takes longer hangs.")
    ] = 120.0,
) -> None:
    """Look at a plug-in of your own: its contract, item by item, and two seconds of traffic."""
    from roadscope.benchmarks.check import broken, check_plugin, line

    items = check_plugin(spec, deadline_s=deadline, told=lambda item: typer.echo(line(item)))
    if count := broken(items):
        typer.echo(f"{spec}: {count} {'item' if count == 1 else 'items'} wrong")
        raise typer.Exit(FAILED)
    typer.echo(f"{spec}: all right")


@app.command(epilog="Example:  roadscope reproduce lu2018 --out results")
def reproduce(
    paper: Annotated[str, typer.Argument(help="lu2018 or zhang2017.")],
    seeds: Annotated[int, typer.Option(min=1, help="Episodes behind each interval.")] = 30,
    jobs: Jobs = 0,
    everything: Annotated[
        bool, typer.Option("--all", help="Show every method in full, as in PAPER.json.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for PAPER.json.")] = None,
) -> None:
    """Repeat a paper's experiments and print its figures beside ours."""
    from roadscope.benchmarks.cache import usable_folder
    from roadscope.benchmarks.papers import note_of, reproduction_of
    from roadscope.benchmarks.papers.reproduction import write_rows
    from roadscope.benchmarks.papers.reproduction_tables import reproduction_tables

    experiments = reproduction_of(paper)
    folder = None if out is None else usable_folder(out)
    with _progress() as progress:
        rows = experiments(
            seeds, lambda done, of: progress("seeds", done, of), jobs=jobs or _cores()
        )
    for experiment in dict.fromkeys(row.experiment for row in rows):
        _print(f"\n[bold]{experiment}[/]")
        shown = [row for row in rows if row.experiment == experiment]
        for table in reproduction_tables(shown, everything=everything):
            _print("")
            _print(table)
        if note := note_of(paper, experiment):
            _console().print(note, style="dim")
    if folder is not None:
        write_rows(rows, folder / f"{paper}.json")
        typer.echo(f"written: {folder / f'{paper}.json'}")


@app.command(epilog="Example:  roadscope speed detectors --out results")
def speed(
    parts: Annotated[
        list[str] | None,
        typer.Argument(help="casting, detectors, metrics, trackers; all by default."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for speed.json.")] = None,
) -> None:
    """Measure ray casting, detectors, metrics, trackers, beside others where installed."""
    from roadscope.benchmarks.cache import usable_folder
    from roadscope.benchmarks.speed import PARTS, measure_speed, write_speed
    from roadscope.benchmarks.tables import speed_table

    folder = None if out is None else usable_folder(out)
    with _progress() as progress:
        rows = measure_speed(
            parts=parts or PARTS, progress=lambda _, done, of: progress("speed", done, of)
        )
    _print(speed_table(rows))
    if folder is not None:
        write_speed(rows, folder / "speed.json")
        typer.echo(f"written: {folder / 'speed.json'}")


def _conditions(suite: str, kitti: Path | None) -> Any:
    """Return the suite that is meant; a folder of recorded data is one of its own."""
    from roadscope.benchmarks.recorded_suite import KITTI, kitti_suite
    from roadscope.benchmarks.suite import load_suite

    if kitti is None and suite == KITTI:
        raise ValueError("suite kitti is of recorded data: name its folder with --kitti DIR")
    if kitti is None:
        return load_suite(suite)
    if suite not in (KITTI, DEFAULT_SUITE):
        raise ValueError(f"--kitti is a suite of its own; leave --suite {suite} out")
    return kitti_suite(kitti)


def _show(results: Any, loaded: Any, by: str | None) -> None:
    from roadscope.benchmarks.tables import (
        agreement_lines,
        board_table,
        comparison,
        conditions,
        footnote,
    )

    console, jobs = _console(), results.manifest["jobs"]
    summary = f": {loaded.summary}" if loaded.summary else ""
    console.print(f"[bold]{loaded.title}[/]{summary}. {conditions(loaded)}")
    for name in results.boards():
        console.print(f"\n[bold]{name} board[/]")
        console.print(board_table(results, name, console.width))
        if results.nothing_eligible(name):
            console.print("No object in any episode was to be found: there is nothing to score.")
        if text := comparison(results, name):
            console.print(text)
        for text in agreement_lines(results, name):
            console.print(text)
        console.print(footnote(name, console.width, jobs), style="dim")
        if by is not None:
            _show_breakdown(console, results, name, by)
    _complain_of_failures(results)


def _show_breakdown(console: Any, results: Any, board: str, by: str) -> None:
    from roadscope.benchmarks.breakdown_tables import NOTES, breakdown_tables, left_out
    from roadscope.benchmarks.results import BREAKDOWNS

    if by not in BREAKDOWNS[board]:
        return
    for table in breakdown_tables(results, board, by, console.width):
        console.print()
        console.print(table)
    if by in NOTES:
        console.print(NOTES[by], style="dim")
    if count := left_out(results, board, by, console.width):
        console.print(f"{count} more on a wider terminal; all with --out.", style="dim")


def _complain_of_failures(results: Any) -> None:
    for name, count, reason in results.reasons():
        spec, _, rest = reason.partition(": ")
        told = rest if name == spec or name.startswith(f"{spec} on ") else reason
        counted = results.row(results.board_of(name), name, "failed_episodes")
        _complain(f"failed: {name} in {count} of {counted.n} episodes: {told}")


def _console(stderr: bool = False) -> Any:
    from rich.console import Console

    return Console(stderr=stderr, highlight=False)


def _print(thing: Any) -> None:
    _console().print(thing)


def _complain(text: str) -> None:
    typer.echo(" ".join(text.split()), err=True)


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int], None]]:
    """Show one bar for each stage, with time spent and left."""
    from rich import progress as bars

    columns = (
        bars.SpinnerColumn(),
        bars.TextColumn("{task.description:9}"),
        bars.BarColumn(),
        bars.MofNCompleteColumn(),
        bars.TimeElapsedColumn(),
        bars.TimeRemainingColumn(),
    )
    shown = bars.Progress(*columns, console=_console(stderr=True))
    tasks: dict[str, bars.TaskID] = {}

    def tell(stage: str, done: int, total: int) -> None:
        # Started late, so that an error in the input is the only line there is.
        shown.start()
        if stage not in tasks:
            tasks[stage] = shown.add_task(stage, total=total)
        shown.update(tasks[stage], completed=done, total=total)

    try:
        yield tell
        for task in shown.tasks:
            shown.update(task.id, completed=task.total)
    finally:
        if tasks:
            shown.stop()


def _cores() -> int:
    from joblib import cpu_count

    return int(cpu_count())


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    _complain(f"warning: {message}")


def main() -> None:
    """Run the command line; bad input ends in one line on stderr and a non-zero exit."""
    warnings.showwarning = _warn
    try:
        status = app(standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        status = INTERRUPTED
    except Exception as error:
        status = _report(error)
    if status == INTERRUPTED:
        kept = sys.argv[1:2] == ["leaderboard"]
        _complain(f"interrupted{'; finished results are kept, run again to go on' * kept}")
    sys.exit(status)


def _report(error: Exception) -> int:
    """Say in one line what was wrong with the input; anything else is a fault of ours."""
    if hasattr(error, "format_message"):
        # Without a message help itself was shown: nothing was asked for.
        if text := error.format_message():
            _complain(f"error: {text} (help: {_command_of(error)} --help)")
        return USAGE
    if isinstance(error, ValueError | RuntimeError | OSError):
        _complain(f"error: {error}")
        return FAILED
    raise error


def _command_of(error: Any) -> str:
    context = getattr(error, "ctx", None)
    named = context.info_name if context is not None and context.parent is not None else None
    return f"roadscope {named}" if named else "roadscope"


if __name__ == "__main__":
    main()
