"""Options that several commands have; they mean the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from roadscope.commands import completion

RUNNING, OUTPUT, RECORDED = "Running", "Output", "Recorded data"
PICTURES, METHODS, CONDITIONS = "Pictures", "Methods", "Conditions"
"""Headings of groups of options."""

Jobs = Annotated[
    int,
    typer.Option(
        min=0,
        metavar="N",
        help="Worker processes; 0: one for each core",
        show_default=False,
        rich_help_panel=RUNNING,
    ),
]
Json = Annotated[
    bool,
    typer.Option("--json", help="Print JSON and nothing else", rich_help_panel=OUTPUT),
]
Quiet = Annotated[
    bool,
    typer.Option("--quiet", help="Print nothing but errors", rich_help_panel=OUTPUT),
]
JsonFile = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="Write the JSON to this file, too")
]
Every = Annotated[
    bool,
    typer.Option("--all", help="Show all metrics, not only the main ones", rich_help_panel=OUTPUT),
]
Rig = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="roadscope list rigs, or a .toml file",
        autocompletion=completion.rigs,
    ),
]
ReturnColours = Annotated[
    Literal["object", "intensity"],
    typer.Option(
        "--returns",
        metavar="NAME",
        help="Colour returns by object or intensity",
        rich_help_panel=PICTURES,
    ),
]
Seconds = Annotated[
    float | None,
    typer.Option(metavar="S", help="Length, 3600 at most; the scenario's if left out"),
]
Detector = Annotated[
    str,
    typer.Option(
        metavar="SPEC",
        help="NAME or file.py:Class, with ?argument=value",
        autocompletion=completion.detectors,
        rich_help_panel=METHODS,
    ),
]
Tracker = Annotated[
    str,
    typer.Option(
        metavar="SPEC",
        help="NAME or file.py:Class",
        autocompletion=completion.trackers,
        rich_help_panel=METHODS,
    ),
]
Odometry = Annotated[
    str | None,
    typer.Option(
        metavar="SPEC",
        help="Run one too; see roadscope list odometries",
        autocompletion=completion.odometries,
        rich_help_panel=METHODS,
    ),
]
CameraDetector = Annotated[
    str | None,
    typer.Option(
        metavar="SPEC",
        help="Camera detector whose boxes are drawn",
        autocompletion=completion.camera_detectors,
        rich_help_panel=METHODS,
    ),
]
Weather = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="See roadscope list weathers",
        autocompletion=completion.weathers,
        rich_help_panel=CONDITIONS,
    ),
]
Light = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="See roadscope list lights",
        autocompletion=completion.lights,
        rich_help_panel=CONDITIONS,
    ),
]
Faults = Annotated[
    str,
    typer.Option(
        metavar="LIST",
        help="Such as 'fog:3 + glare:1'",
        rich_help_panel=CONDITIONS,
    ),
]
LidarMounting = Annotated[
    str | None,
    typer.Option(
        metavar="POSE",
        help="Pose of the LiDAR in the vehicle: x,y,z,roll,pitch,yaw; only angles count",
        rich_help_panel=RECORDED,
    ),
]
Rate = Annotated[
    float,
    typer.Option(
        metavar="HZ",
        help="Scans per second, if times.txt and names have no stamps",
        rich_help_panel=RECORDED,
    ),
]
Topics = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="NAME",
        help="Topic of a bag; can be repeated",
        rich_help_panel=RECORDED,
    ),
]
Layout = Annotated[
    str,
    typer.Option(
        metavar="COLUMNS",
        help="Columns of .bin and .npy files, such as x,y,z,intensity; "
        "write _ for a column to skip",
        rich_help_panel=RECORDED,
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
