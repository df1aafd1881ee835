"""`roadscope leaderboard`."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any

import typer

from roadscope.commands.options import Jobs, workers
from roadscope.commands.terminal import complain, console, progress_bars

DEFAULT_SUITE = "quick"


Board = Annotated[
    str | None,
    typer.Argument(
        help="detection, tracking, camera, fusion or odometry; all that the suite has if left out."
    ),
]
Suite = Annotated[
    str | None,
    typer.Option(
        help="Conditions: a name (roadscope list suites) or a .toml file; quick if left out, for "
        "the boards camera, fusion and odometry the suite of that name."
    ),
]
Entry = Annotated[
    list[str] | None,
    typer.Option(
        help="Your detector, tracker, fusion or odometry, beside the suite's own: a name, "
        "module:Class or file.py:Class, with ?argument=value. Can be given several times."
    ),
]
Only = Annotated[bool, typer.Option("--only", help="Run the given entries alone.")]
By = Annotated[
    list[str] | None,
    typer.Option(
        help="Show it by this too: range, category, occlusion, points or score (detection), "
        "detector or alpha (tracking), family, size, range, category or score (camera), family, "
        "range, crowd, score or inputs (fusion), distance (odometry), condition, weather or "
        "scenario (all), alpha or sequence (--kitti, --mot). Can be given several times."
    ),
]
Seeds = Annotated[
    int | None,
    typer.Option(min=1, help="So many of the suite's seeds, the first, for a quick look."),
]
Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder for leaderboard.json, .csv, .md, .tex and the results database; boards of "
        "other suites in it are kept as leaderboard-SUITE-BOARD, with the calibration's name if "
        "one was given."
    ),
]
Fresh = Annotated[bool, typer.Option("--fresh", help="Do again what an earlier run has done.")]
Kitti = Annotated[
    Path | None,
    typer.Option(
        help="Rank trackers on your folder of KITTI tracking data: SEQ.txt in label_02, calib, "
        "ego_pose (12 numbers a line) or oxts, and det_NAME/Car (Pedestrian, Cyclist), whose "
        "lines are, with commas, frame class left top right bottom score height width length "
        "x y z rotation_y alpha; class 1 pedestrian, 2 car, 3 cyclist."
    ),
]
Mot = Annotated[
    Path | None,
    typer.Option(
        help="Rank trackers on your folder of MOTChallenge data: SEQ/det/det.txt, SEQ/gt/gt.txt, "
        "SEQ/seqinfo.ini; lines are, with commas, frame id left top width height confidence, in "
        "gt also class visibility."
    ),
]
Tracks = Annotated[
    Path | None,
    typer.Option(
        help="With --kitti or --mot: folder for every tracker's tracks, SEQ.txt in kitti/TRACKER "
        "and motchallenge/TRACKER/CLASS."
    ),
]
Detections = Annotated[
    list[str] | None,
    typer.Option(
        help="Whose detections trackers get, in place of the suite's: a detector or "
        "fused?lidar=A&camera=B&fusion=C (can be given several times)."
    ),
]
Calibration = Annotated[
    Path | None,
    typer.Option(help="What fusions believe of the sensors: a file of roadscope calibrate."),
]
Deadline = Annotated[
    float,
    typer.Option(
        min=1, help="Seconds for a camera detector, fusion or odometry of yours on one episode."
    ),
]


def leaderboard(
    board: Board = None,
    *,
    suite: Suite = None,
    entry: Entry = None,
    only: Only = False,
    by: By = None,
    seeds: Seeds = None,
    jobs: Jobs = 0,
    out: Out = None,
    fresh: Fresh = False,
    kitti: Kitti = None,
    mot: Mot = None,
    tracks: Tracks = None,
    detections: Detections = None,
    calibration: Calibration = None,
    deadline: Deadline = 300.0,
) -> None:
    """Rank detectors, trackers, camera detectors, fusions, odometries on a suite of traffic.

    What an earlier run has finished is not done again; a stopped run goes on where it was.

    An entry that fails becomes a row with its reason.
    """
    from roadscope.benchmarks.boards.results import check_breakdown
    from roadscope.benchmarks.jobs.entries import ALL_BOARDS
    from roadscope.benchmarks.jobs.plan import boards_of
    from roadscope.benchmarks.runner import run

    conditions = _conditions(suite or _usual(board), kitti, mot)
    conditions = _given(conditions, detections) if detections else conditions
    conditions = conditions if seeds is None else _fewer(conditions, seeds)
    boards = boards_of(conditions) if board is None else (board,)
    _check_tracks(tracks, kitti or mot)
    _refuse_idle(boards, calibration, detections)
    for each in by or () if set(boards) <= set(ALL_BOARDS) else ():
        check_breakdown(each, _recorded_boards(kitti, mot) or boards)
    with progress_bars() as progress:
        results = run(
            conditions, entry or (), boards=boards, only=only, jobs=workers(jobs), out_dir=out,
            fresh=fresh, progress=progress, calibration=calibration, deadline_s=deadline,
        )  # fmt: skip
        lost = [] if tracks is None else _save_tracks(
            (conditions, entry or (), boards, only), tracks, workers(jobs), progress
        )  # fmt: skip
    _show(results, conditions, dict.fromkeys(by or ()))
    if suite is None and not (kitti or mot):
        _tell_more(board)
    if lost:
        typer.echo(f"no tracks were written of {', '.join(lost)}")
    _tell_written(out and out / "leaderboard.json", tracks)
    _tell_kept(out)
    if results.barren():
        raise typer.Exit(1)


def _save_tracks(asked: Any, folder: Path, jobs: int, progress: Any) -> list[str]:
    """Write the tracks of what was asked: conditions, entries, boards, and whether these alone."""
    from roadscope.benchmarks.boards.track_files import save_tracks
    from roadscope.benchmarks.jobs.plan import plan

    conditions, entries, boards, only = asked
    done = plan(conditions, entries, boards, only=only).tracking
    return save_tracks(done, folder, workers=jobs, progress=progress)


def _tell_written(*paths: Path | None) -> None:
    for path in paths:
        if path is not None:
            typer.echo(f"written: {path}")


def _tell_kept(out: Path | None) -> None:
    """Name boards of other suites in the folder."""
    from roadscope.benchmarks.boards.kept import kept_boards

    if out is not None and (kept := kept_boards(out)):
        typer.echo(f"kept beside it: {', '.join(path.name for path in kept)}")


def _tell_more(board: str | None) -> None:
    """Name the suite of a board that was shown on the quick one."""
    from roadscope.benchmarks.suite import SUITES

    if board in SUITES and _usual(board) != board:
        typer.echo(f"A quick look. In full: roadscope leaderboard {board} --suite {board}")


def _usual(board: str | None) -> str:
    from roadscope.benchmarks.jobs.entries import ODOMETRY, SENSOR_BOARDS

    return board if board in (*SENSOR_BOARDS, ODOMETRY) else DEFAULT_SUITE


def _given(suite: Any, detections: list[str]) -> Any:
    """Return the suite with other detections for its trackers."""
    from dataclasses import replace

    from roadscope.benchmarks.recorded.suite import RecordedSuite

    if isinstance(suite, RecordedSuite):
        raise ValueError("--detections is for simulated traffic; recorded data have their own")
    return replace(suite, public_detectors=tuple(dict.fromkeys(detections)))


def _recorded_boards(kitti: Path | None, mot: Path | None) -> tuple[str, ...]:
    from roadscope.benchmarks.recorded.recording import KITTI_BOARDS, MOT_BOARDS

    return (KITTI_BOARDS if kitti else ()) + (MOT_BOARDS if mot else ())


def _fewer(suite: Any, seeds: int) -> Any:
    """Return the suite with its first seeds alone; what is done of these need not be done again."""
    from dataclasses import replace

    from roadscope.benchmarks.recorded.suite import RecordedSuite

    if isinstance(suite, RecordedSuite):
        raise ValueError("--seeds is for simulated traffic; recorded sequences have none")
    if seeds > len(suite.seeds):
        raise ValueError(
            f"--seeds {seeds}: suite {suite.title} has {len(suite.seeds)}; a suite of your own, a "
            ".toml file, may have more"
        )
    return replace(suite, seeds=suite.seeds[:seeds])


def _conditions(suite: str, kitti: Path | None, mot: Path | None) -> Any:
    """Return the suite that is meant; a folder of recorded data is one of its own."""
    from roadscope.benchmarks.recorded.mot import MOT, mot_suite
    from roadscope.benchmarks.recorded.suite import KITTI, kitti_suite
    from roadscope.benchmarks.suite import load_suite

    if kitti is not None and mot is not None:
        raise ValueError("--kitti and --mot are suites of their own; give one of them")
    for name, folder, make in ((KITTI, kitti, kitti_suite), (MOT, mot, mot_suite)):
        if folder is None and suite == name:
            raise ValueError(f"suite {name} is of recorded data: name its folder with --{name} DIR")
        if folder is None:
            continue
        if suite not in (name, DEFAULT_SUITE):
            raise ValueError(f"--{name} is a suite of its own; leave --suite {suite} out")
        return make(folder)
    return load_suite(suite)


def _refuse_idle(boards: Any, calibration: Path | None, detections: list[str] | None) -> None:
    """Refuse options that no board of the run would heed."""
    if calibration is not None and "fusion" not in boards:
        raise ValueError(f"--calibration is for the board fusion, not {' and '.join(boards)}")
    if detections and "tracking" not in boards:
        raise ValueError(f"--detections is for the board tracking, not {' and '.join(boards)}")


def _check_tracks(tracks: Path | None, kitti: Path | None) -> None:
    """Refuse a folder for tracks that nothing would be written to, before anything runs."""
    from roadscope.benchmarks.cache import usable_folder

    if tracks is not None and kitti is None:
        raise ValueError(
            "--tracks writes tracks of recorded data: name its folder with --kitti or --mot"
        )
    if tracks is not None:
        usable_folder(tracks)


def _show(results: Any, loaded: Any, by: Collection[str]) -> None:
    from roadscope.benchmarks.boards.columns import footnote
    from roadscope.benchmarks.boards.tables import (
        agreement_lines,
        believed_lines,
        board_table,
        comparison,
        conditions,
    )
    from roadscope.benchmarks.jobs.entries import SENSOR_BOARDS

    screen, jobs = console(), results.manifest["jobs"]
    summary = f": {loaded.summary}" if loaded.summary else ""
    screen.print(f"[bold]{loaded.title}[/]{summary}. {conditions(loaded, results.boards())}")
    for name in results.boards():
        screen.print(f"\n[bold]{name} board[/]")
        screen.print(board_table(results, name, screen.width))
        if results.nothing_eligible(name):
            screen.print("No object in any episode was to be found: there is nothing to score.")
        if text := comparison(results, name):
            screen.print(text)
        for text in (*agreement_lines(results, name), *believed_lines(results, name)):
            screen.print(text)
        screen.print(footnote(name, screen.width, jobs), style="dim")
        if name in SENSOR_BOARDS and "family" not in by:
            _show_breakdown(screen, results, name, "family", ("detection_rate",))
        for each in by:
            _show_breakdown(screen, results, name, each)
    _complain_of_failures(results)


def _show_breakdown(
    screen: Any, results: Any, board: str, by: str, metrics: tuple[str, ...] = ()
) -> None:
    from roadscope.benchmarks.boards.breakdown_tables import breakdown_tables, note
    from roadscope.benchmarks.boards.results import BREAKDOWNS

    if by not in BREAKDOWNS[board]:
        return
    for table in breakdown_tables(results, board, by, screen.width, metrics):
        # A title within the table would be broken at the table's width.
        screen.print(f"\n[bold]{table.title}[/]")
        table.title = None
        screen.print(table)
    if text := note(board, by):
        screen.print(text, style="dim")


def _complain_of_failures(results: Any) -> None:
    from roadscope.benchmarks.boards.results import reason_alone

    for name, count, reason in results.reasons():
        told = reason_alone(name, reason)
        if results.not_installed(name):
            complain(f"left out: {name}: {told}")
            continue
        counted = results.row(results.board_of(name), name, "failed_episodes")
        complain(f"failed: {name} in {count} of {counted.n} episodes: {told}")
