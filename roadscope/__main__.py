"""The command line: its commands, and how it ends."""

from __future__ import annotations

import inspect
import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from roadscope.commands.cache import cache
from roadscope.commands.calibrate import calibrate
from roadscope.commands.check import check
from roadscope.commands.compare import compare
from roadscope.commands.detect import detect
from roadscope.commands.doctor import doctor
from roadscope.commands.export import export
from roadscope.commands.leaderboard import leaderboard
from roadscope.commands.list import list_names
from roadscope.commands.new import new
from roadscope.commands.report import report
from roadscope.commands.reproduce import reproduce
from roadscope.commands.run import run_scenario
from roadscope.commands.run_odometry import run_odometry
from roadscope.commands.speed import speed
from roadscope.commands.submit import submit
from roadscope.commands.terminal import complain
from roadscope.commands.train import train
from roadscope.commands.view import view

USAGE, FAILED, INTERRUPTED = 2, 1, 130

app = typer.Typer(
    name="roadscope",
    help="Compare detectors, trackers, odometries and fusions on simulated traffic with perfect "
    "truth.\n\nExit status: 0 if all went well, 1 if the input was wrong or for what a command's "
    "help says, 2 for unknown commands and options, 130 if interrupted.",
    epilog="Start with:  roadscope leaderboard",
    pretty_exceptions_enable=False,
    # Help that rich draws costs twice the processor time.
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)

COMMANDS: Mapping[str, tuple[Callable[..., None], str]] = {
    "list": (list_names, "roadscope list detectors"),
    "run": (run_scenario, "roadscope run roundabout --seed 3 --picture scene.png"),
    "leaderboard": (leaderboard, 'roadscope leaderboard --entry "my_tracker.py:Mine?gate_m=2.5"'),
    "report": (report, "roadscope report results --open"),
    "view": (view, "roadscope view roundabout --rig wide --seconds 5 --save scene.rrd"),
    "new": (new, "roadscope new tracker my_tracker.py"),
    "check": (check, "roadscope check my_tracker.py:MyTracker"),
    "compare": (compare, "roadscope compare before after --fail-on-regression"),
    "submit": (submit, "roadscope submit results --suite exported --name mine"),
    "export": (export, "roadscope export quick exported --seeds 1"),
    "calibrate": (calibrate, "roadscope calibrate --rig li2021 --poses 20 --out calibration.json"),
    "detect": (detect, "roadscope detect scans --out detections --pictures pictures"),
    "run-odometry": (run_odometry, "roadscope run-odometry scans --out poses.txt"),
    "reproduce": (reproduce, "roadscope reproduce lu2018 --out results"),
    "speed": (speed, "roadscope speed detectors --out results"),
    "train": (train, "roadscope train camera --out my_network.safetensors"),
    "doctor": (doctor, "roadscope doctor"),
}
"""What each is, and an example of it."""


def _help(command: Callable[..., None]) -> str:
    """Return a docstring of which each paragraph is one line: terminals break them themselves."""
    paragraphs = inspect.cleandoc(command.__doc__ or "").split("\n\n")
    return "\n\n".join(" ".join(each.split()) for each in paragraphs)


class _Command(TyperCommand):
    """A command, before which the Gymnasium ids are registered: `--help` does without Gymnasium."""

    def invoke(self, ctx: Any) -> Any:
        """Register the ids, then run the command."""
        from roadscope.envs.gym.registration import register

        register()
        return super().invoke(ctx)


for _name, (_command, _example) in COMMANDS.items():
    _text = _help(_command)
    app.command(
        _name,
        cls=_Command,
        help=_text,
        short_help=_text.partition("\n")[0],
        epilog=f"Example:  {_example}",
    )(_command)
app.add_typer(
    cache,
    name="cache",
    help="Show or remove files that are computed once and read again.",
    epilog="Example:  roadscope cache clear --kind detections",
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
    """Run the command line; bad input ends in one line on stderr and a non-zero exit."""
    warnings.showwarning = _warn
    try:
        status = app(prog_name="roadscope", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        status = INTERRUPTED
    except Exception as error:
        status = _report(error)
    if status == INTERRUPTED:
        kept = sys.argv[1:2] == ["leaderboard"]
        complain(f"interrupted{'; finished results are kept, run again to go on' * kept}")
    sys.exit(status)


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    complain(f"warning: {message}")


def _report(error: Exception) -> int:
    """Say in one line what was wrong with the input; anything else is a fault of ours."""
    if hasattr(error, "format_message"):
        complain(f"error: {error.format_message()} (help: {_command_of(error)} --help)")
        return USAGE
    if isinstance(error, ValueError | RuntimeError | OSError):
        complain(f"error: {error}")
        return FAILED
    raise error


def _command_of(error: Any) -> str:
    context = getattr(error, "ctx", None)
    named = context.info_name if context is not None and context.parent is not None else None
    return f"roadscope {named}" if named else "roadscope"


if __name__ == "__main__":
    main()
