"""The command line: its commands, and how it ends."""

from __future__ import annotations

import signal
import sys
import warnings
from collections.abc import Mapping
from typing import Annotated, Any

import typer

from roadscope.commands.help import CommandEntry, GroupedCommands
from roadscope.commands.terminal import complain

USAGE, FAILED, INTERRUPTED, TERMINATED = 2, 1, 130, 143

START, OWN, RECORDED = "See it work", "Your own method", "Your own recordings"
MORE, HERE = "Papers, sensors, networks", "This installation"

COMMANDS: Mapping[str, CommandEntry] = {
    "run": CommandEntry(
        "Run one detector and one tracker on one episode",
        START,
        (
            "roadscope run roundabout",
            "roadscope run merge --seed 3 --faults rain:4 --picture scene.png",
            "roadscope run street --rig wide --seconds 3 --video street.gif",
        ),
        function="run_scenario",
    ),
    "leaderboard": CommandEntry(
        "Rank methods on the episodes of a suite, yours among them",
        START,
        (
            "roadscope leaderboard tracking --seeds 1 --out results --open",
            "roadscope leaderboard tracking --seeds 1 --entry my_tracker.py:MyTracker --out mine",
        ),
    ),
    "report": CommandEntry(
        "Write one HTML page of results: plots and worst moments",
        START,
        ("roadscope report results --open",),
    ),
    "view": CommandEntry(
        "Show an episode or a run over time, in the viewer Rerun",
        START,
        ("roadscope view roundabout --seconds 2 --save scene.rrd",),
    ),
    "list": CommandEntry(
        "List the names that other commands take",
        START,
        ("roadscope list trackers", "roadscope list scenarios --json"),
        function="list_names",
    ),
    "new": CommandEntry(
        "Write a plug-in or a suite that works, for you to change",
        OWN,
        ("roadscope new tracker my_tracker.py", "roadscope new suite"),
    ),
    "check": CommandEntry(
        "Check a plug-in against its contract, item by item",
        OWN,
        ("roadscope check my_tracker.py:MyTracker", "roadscope check gnn"),
    ),
    "compare": CommandEntry(
        "Compare two runs, or two entries of one run",
        OWN,
        ("roadscope compare results --entry nearest --entry existence",),
    ),
    "export": CommandEntry(
        "Write a suite's scans, images and truth in KITTI's layout",
        OWN,
        ("roadscope export quick exported --seeds 1 --scenario roundabout",),
    ),
    "submit": CommandEntry(
        "Score result files of a program that is not a plug-in",
        OWN,
        ("roadscope submit answers --suite exported --name mine",),
    ),
    "detect": CommandEntry(
        "Detect road users in a folder of scans, images or both",
        RECORDED,
        ("roadscope detect exported/velodyne/0000 --height 0.55 --pictures pictures",),
    ),
    "run-odometry": CommandEntry(
        "Estimate the poses of a LiDAR from a folder of its scans",
        RECORDED,
        ("roadscope run-odometry exported/velodyne/0000 --out poses.txt",),
    ),
    "reproduce": CommandEntry(
        "Repeat a paper's experiments: which of its claims hold",
        MORE,
        ("roadscope reproduce lu2018 --seeds 1 --out papers",),
    ),
    "calibrate": CommandEntry(
        "Calibrate LiDAR and camera with a target (Li 2021)",
        MORE,
        ("roadscope calibrate --poses 8 --out calibration.json",),
    ),
    "train": CommandEntry(
        "Train the camera detector or a driver",
        MORE,
        (
            "roadscope train camera --recipe trial --out my_network.safetensors",
            "roadscope train driver --scenario merge --steps 1024 --out my_agent.safetensors",
        ),
    ),
    "speed": CommandEntry(
        "Measure how long methods, sensors and environments take",
        HERE,
        ("roadscope speed casting",),
    ),
    "doctor": CommandEntry(
        "Show versions, extras, cache, and what does not work", HERE, ("roadscope doctor",)
    ),
    "cache": CommandEntry(
        "Show or remove files that are computed once",
        HERE,
        ("roadscope cache show", "roadscope cache clear --kind detections"),
    ),
}
"""What each is; examples run one after the other in one folder."""


class _Root(GroupedCommands):
    entries = COMMANDS
    examples = ("roadscope run roundabout", "roadscope leaderboard tracking --seeds 1")


app = typer.Typer(
    name="roadscope",
    cls=_Root,
    help="Compare detectors, trackers, odometries, fusions and drivers on simulated traffic with "
    "perfect truth. Exit status: 1 for wrong input or a failure, 2 for unknown "
    "options, 130 if interrupted, 143 if ended by SIGTERM.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def _version(requested: bool) -> None:
    if requested:
        from roadscope import __version__

        typer.echo(f"roadscope {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Show the help where no command is given."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main() -> None:
    """Run the command line; bad input ends in errors on stderr and a non-zero exit."""
    warnings.showwarning = _warn
    terminated = False

    def end(*_: Any) -> None:
        """End as after Ctrl-C, which closes workers; a second SIGTERM ends at once."""
        nonlocal terminated
        terminated = True
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, end)
    try:
        status = app(prog_name="roadscope", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        status = INTERRUPTED
    except Exception as error:
        status = _report(error)
    if terminated:
        status = TERMINATED
    elif status == INTERRUPTED:
        resumable = sys.argv[1:2] == ["leaderboard"]
        complain(f"interrupted{'; finished results are kept, run again to go on' * resumable}")
    sys.exit(status)


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    complain(f"warning: {message}")


def _report(error: Exception) -> int:
    """Say what was wrong with the input, one line a problem; anything else is a fault of ours."""
    if hasattr(error, "format_message"):
        complain(f"error: {error.format_message()} (help: {_command_of(error)} --help)")
        return USAGE
    if isinstance(error, ValueError | RuntimeError | OSError):
        problems = getattr(error, "problems", ())
        lines = [f"- {problem}" for problem in problems] if len(problems) > 1 else []
        text = str(error).removesuffix("".join(f"\n{line}" for line in lines))
        for line in (f"error: {text}", *lines):
            complain(line)
        return FAILED
    raise error


def _command_of(error: Any) -> str:
    context = getattr(error, "ctx", None)
    return "roadscope" if context is None else str(context.command_path)


if __name__ == "__main__":
    main()
