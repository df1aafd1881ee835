"""Options that several commands have; they mean the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from roadscope.commands import completion

RUNNING, OUTPUT, RECORDED = "Running", "Output", "Recorded data"
PICTURES, METHODS, CONDITIONS = "Pictures", "Methods", "Conditions"
"""Headings of groups of options."""


def option(
    metavar: str, text: str, group: str | None = None, *, name: str | None = None, **settings: Any
) -> Any:
    """Return an option with a value.

    metavar: stands for the value in the help. text: says what the option does.
    group: its heading in the help; None: the first one. name: `--NAME`, if not the parameter's.
    """
    names = () if name is None else (name,)
    return typer.Option(*names, metavar=metavar, help=text, rich_help_panel=group, **settings)


def flag(name: str, text: str, group: str | None = None) -> Any:
    """Return an option without a value; arguments are those of `option`."""
    return typer.Option(name, help=text, rich_help_panel=group)


Jobs = Annotated[
    int, option("N", "Worker processes; 0: one for each core", RUNNING, min=0, show_default=False)
]
Json = Annotated[bool, flag("--json", "Print JSON and nothing else", OUTPUT)]
Quiet = Annotated[bool, flag("--quiet", "Print nothing but errors", OUTPUT)]
JsonFile = Annotated[Path | None, option("FILE", "Write the JSON to this file, too", name="--out")]
Width = Annotated[int | None, option("N", "Width of the tables, characters", OUTPUT, min=40)]
Every = Annotated[bool, flag("--all", "Show all metrics, not only the main ones", OUTPUT)]
Rig = Annotated[
    str, option("NAME", "roadscope list rigs, or a .toml file", autocompletion=completion.rigs)
]
ReturnColours = Annotated[
    Literal["object", "intensity"],
    option("NAME", "Colour returns by object or intensity", PICTURES, name="--returns"),
]
Seconds = Annotated[float | None, option("S", "Length, 3600 at most; the scenario's if left out")]
Detector = Annotated[
    str,
    option(
        "SPEC",
        "NAME or file.py:Class, with ?argument=value",
        METHODS,
        autocompletion=completion.detectors,
    ),
]
Tracker = Annotated[
    str, option("SPEC", "NAME or file.py:Class", METHODS, autocompletion=completion.trackers)
]
Odometry = Annotated[
    str | None,
    option(
        "SPEC",
        "Run an odometry too; see roadscope list odometries",
        METHODS,
        autocompletion=completion.odometries,
    ),
]
CameraDetector = Annotated[
    str | None,
    option(
        "SPEC",
        "Camera detector whose boxes are drawn",
        METHODS,
        autocompletion=completion.camera_detectors,
    ),
]
Weather = Annotated[
    str,
    option("NAME", "See roadscope list weathers", CONDITIONS, autocompletion=completion.weathers),
]
Light = Annotated[
    str, option("NAME", "See roadscope list lights", CONDITIONS, autocompletion=completion.lights)
]
Faults = Annotated[str, option("LIST", "Such as 'fog:3 + glare:1'", CONDITIONS)]
LidarMounting = Annotated[
    str | None,
    option(
        "POSE",
        "Pose of the LiDAR in the vehicle: x,y,z,roll,pitch,yaw; only angles count",
        RECORDED,
    ),
]
Rate = Annotated[
    float, option("HZ", "Scans per second, if times.txt and names have no stamps", RECORDED)
]
Topics = Annotated[
    list[str] | None, option("NAME", "Topic of a bag; can be repeated", RECORDED, name="--topic")
]
Layout = Annotated[
    str,
    option(
        "COLUMNS",
        "Columns of .bin and .npy files, such as x,y,z,intensity; write _ for a column to skip",
        RECORDED,
    ),
]


def workers(jobs: int) -> int:
    """Return the number of processes for --jobs: 0 stands for one on each core."""
    from joblib import cpu_count

    return jobs or int(cpu_count())


def is_given(context: typer.Context, name: str) -> bool:
    """Return whether the command line has the option of a parameter."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"
