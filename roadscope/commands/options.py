"""Options that several commands have; they mean the same everywhere."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import typer

from roadscope.commands import completion

RUNNING, OUTPUT, RECORDED = "Running", "Output", "Recorded data"
PICTURES, METHODS, CONDITIONS = "Pictures", "Methods", "Conditions"
"""Headings of groups of options."""


def argument(
    metavar: str,
    text: str,
    *,
    names: Callable[..., Any] | None = None,
    default: Any = ...,
    show_default: bool = True,
) -> Any:
    """Return an argument, as the default of a parameter; it is required if it has no default.

    metavar, text, names: as in `option`. show_default: whether the help shows the default.
    """
    return typer.Argument(
        default, metavar=metavar, help=text, autocompletion=names, show_default=show_default
    )


def option(
    metavar: str,
    text: str,
    group: str | None = None,
    *,
    name: str | None = None,
    names: Callable[..., Any] | None = None,
    default: Any = None,
    **settings: Any,
) -> Any:
    """Return an option with a value, as the default of a parameter.

    metavar: stands for the value in the help.
    text: says what the option does.
    group: its heading in the help; None: the first one.
    name: `--NAME`, if not the parameter's.
    names: what a shell offers to complete, see `completion`.
    settings: other arguments of `typer.Option`.
    """
    settings |= {"help": text, "rich_help_panel": group, "autocompletion": names}
    return typer.Option(default, *([name] if name else []), metavar=metavar, **settings)


def flag(name: str, text: str, group: str | None = None) -> Any:
    """Return an option without a value, false if it is left out. name: `--NAME`."""
    return typer.Option(False, name, help=text, rich_help_panel=group)


JOBS: int = option(
    "N", "Worker processes; 0: one for each core", RUNNING, min=0, show_default=False, default=0
)
JSON: bool = flag("--json", "Print JSON and nothing else", OUTPUT)
QUIET: bool = flag("--quiet", "Print nothing but errors", OUTPUT)
JSON_FILE: Path | None = option("FILE", "Write the JSON to this file, too")
WIDTH: int | None = option("N", "Width of the tables, characters", OUTPUT, min=40)
EVERY: bool = flag("--all", "Show all metrics, not only the main ones", OUTPUT)
RIG: str = option(
    "NAME", "roadscope list rigs, or a .toml file", names=completion.rigs, default="lux"
)
ReturnColours = Literal["object", "intensity"]
RETURNS: ReturnColours = option("NAME", "Colour by object or intensity", PICTURES, default="object")
SECONDS: float | None = option("S", "Length, 3600 at most; the scenario's if left out")
DETECTOR: str = option(
    "SPEC",
    "NAME or file.py:Class, with ?argument=value",
    METHODS,
    names=completion.detectors,
    default="distance-l-shape",
)
TRACKER: str = option(
    "SPEC", "NAME or file.py:Class", METHODS, names=completion.trackers, default="existence"
)
ODOMETRY: str | None = option(
    "SPEC",
    "Run an odometry too; see roadscope list odometries",
    METHODS,
    names=completion.odometries,
)
CAMERA_DETECTOR: str | None = option(
    "SPEC", "Camera detector whose boxes are drawn", METHODS, names=completion.camera_detectors
)
WEATHER: str = option(
    "NAME", "See roadscope list weathers", CONDITIONS, names=completion.weathers, default="clear"
)
LIGHT: str = option(
    "NAME", "See roadscope list lights", CONDITIONS, names=completion.lights, default="day"
)
FAULTS: str = option("LIST", "Such as 'fog:3 + glare:1'", CONDITIONS, default="clear")
LIDAR_MOUNTING: str | None = option(
    "POSE", "Pose of the LiDAR in the vehicle: x,y,z,roll,pitch,yaw; only angles count", RECORDED
)
RATE: float | None = option("HZ", "Scans per second if nothing has stamps; else 10", RECORDED)
TOPICS: list[str] | None = option(
    "NAME", "Topic of a bag; can be repeated", RECORDED, name="--topic"
)
LAYOUT: str = option(
    "COLUMNS",
    "Columns of .bin and .npy files, such as x,y,z,intensity; write _ for a column to skip",
    RECORDED,
    default="",
)


def workers(jobs: int) -> int:
    """Return the number of worker processes for `--jobs`: 0 stands for one on each core."""
    from joblib import cpu_count

    return jobs or int(cpu_count())


def is_given(context: typer.Context, name: str) -> bool:
    """Return whether the option of a parameter stands on the command line, not its default."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"
