"""`roadscope view`."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import typer

from roadscope.commands import completion, options
from roadscope.commands.options import argument, is_given, option
from roadscope.commands.terminal import complain, printable, progress_bars, say

FOLDER = "For a folder of results"

OF_SCENARIO = (
    "rig",
    "weather",
    "light",
    "faults",
    "tracker",
    "odometry",
    "camera_detector",
    "seconds",
)
OF_RESULTS = ("board", "entry", "scenario", "condition")
"""Parameters that have a meaning for a scenario alone, and for a folder alone."""


def view(
    context: typer.Context,
    source: str = argument(
        "SCENARIO|DIR",
        "See roadscope list scenarios; or a folder of results",
        names=completion.scenarios,
    ),
    *,
    save: Path | None = option("FILE", "Write a .rrd file, and open no viewer"),
    seed: int | None = option("N", "Seed of the episode; for a scenario, 0 if left out", min=0),
    rig: str = options.RIG,
    seconds: float | None = options.SECONDS,
    returns: options.ReturnColours = options.RETURNS,
    detector: str = options.DETECTOR,
    tracker: str = options.TRACKER,
    odometry: str | None = options.ODOMETRY,
    camera_detector: str | None = options.CAMERA_DETECTOR,
    weather: str = options.WEATHER,
    light: str = options.LIGHT,
    faults: str = options.FAULTS,
    board: str | None = option(
        "NAME", "The board; for driving see roadscope report", FOLDER, names=completion.boards
    ),
    entry: str | None = option(
        "SPEC", "The entry; the best one if left out", FOLDER, names=completion.entries_of_runs
    ),
    scenario: str | None = option(
        "NAME", "The scenario or sequence", FOLDER, names=completion.scenarios
    ),
    condition: str | None = option("NAME", "Weather, light and faults, such as rain-3", FOLDER),
    quiet: bool = options.QUIET,
) -> None:
    """Show an episode in Rerun: world, sensors, truth, detections, tracks and scores over time.

    A scenario is run as roadscope run does; of a folder, the stored answers of an entry are shown.
    Needs: pip install 'roadscope[view]'. The viewer listens on this machine alone.
    """
    from roadscope.benchmarks.cache import usable_file
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.viewing.program import rerun_module, show
    from roadscope.benchmarks.viewing.recording import ENDING, save_recording
    from roadscope.benchmarks.viewing.stored_answers import EpisodeChoice, view_of_results
    from roadscope.benchmarks.viewing.view import view_of_scenario
    from roadscope.envs.sensors.faults import faults_of
    from roadscope.envs.traffic.scenarios import SCENARIOS

    if save is not None:
        usable_file(save, (ENDING,), "a recording")
    rerun_module()
    of_results = source not in SCENARIOS and Path(source).is_dir()
    _refuse(context, OF_SCENARIO if of_results else OF_RESULTS)
    with tempfile.TemporaryDirectory(prefix="roadscope-view-") as scratch:
        path = Path(scratch) / f"episode{ENDING}" if save is None else save
        with progress_bars(quiet=quiet) as progress:
            if of_results:
                inputs = detector if is_given(context, "detector") else None
                choice = EpisodeChoice(board, entry, scenario, seed, condition, inputs)
                shown = view_of_results(source, choice)
            else:
                fault_names = tuple(map(str, faults_of(faults)))
                shown = view_of_scenario(
                    Episode(
                        _scenario(source), seed or 0, rig, seconds, weather, light, fault_names
                    ),
                    detector=detector,
                    tracker=tracker,
                    odometry=odometry,
                    camera_detector=camera_detector,
                    progress=progress,
                )
            save_recording(shown, path, returns=returns, progress=progress)
        if not quiet:
            for line in (shown.title, *shown.notes):
                say(printable(line))
        if save is None:
            if status := show(path):
                complain(f"the viewer ended with status {status}; without a display, use --save")
                raise typer.Exit(1)
        elif not quiet:
            say(f"written: {path}")


def _scenario(name: str) -> str:
    """Return the name of a scenario; raise `ScenarioError` if it is none."""
    from roadscope.envs.traffic.scenarios import ScenarioError, find

    try:
        return find(name).name
    except ScenarioError as error:
        raise ScenarioError(f"{error}; or a folder of roadscope leaderboard --out") from error


def _refuse(context: typer.Context, names: Sequence[str]) -> None:
    """Refuse options that have no meaning for what is shown."""
    refused = [f"--{name.replace('_', '-')}" for name in names if is_given(context, name)]
    if refused:
        kind = "a folder of results" if names is OF_SCENARIO else "a scenario"
        raise typer.BadParameter(f"{', '.join(refused)} has no meaning for {kind}")
