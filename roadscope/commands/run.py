"""`roadscope run`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadscope.commands import completion
from roadscope.commands.options import Json, Quiet, Rig
from roadscope.commands.terminal import headline, print_json, progress_bars, show

if TYPE_CHECKING:
    from roadscope.benchmarks.single import Summary


Scenario = Annotated[
    str,
    typer.Argument(
        help="Traffic scenario, see: roadscope list scenarios.", autocompletion=completion.scenarios
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Another seed is another episode.")]
Weather = Annotated[
    str,
    typer.Option(
        help="Weather, such as rain-2, see: roadscope list weathers.",
        autocompletion=completion.weathers,
    ),
]
Light = Annotated[
    str,
    typer.Option(
        help="Light, for a rig with a camera, see: roadscope list lights.",
        autocompletion=completion.lights,
    ),
]
Faults = Annotated[
    str, typer.Option(help="Faults, such as 'fog:3 + dropped-scans:2', see: roadscope list faults.")
]
Detector = Annotated[
    str,
    typer.Option(
        help="A name, module:Class or file.py:Class, with ?argument=value.",
        autocompletion=completion.detectors,
    ),
]
Tracker = Annotated[
    str,
    typer.Option(
        help="A name, module:Class or file.py:Class, with ?argument=value.",
        autocompletion=completion.trackers,
    ),
]
Picture = Annotated[
    Path | None, typer.Option(help="Write a bird's-eye view of the middle frame here.")
]
Image = Annotated[
    Path | None,
    typer.Option(help="Write the camera's middle image here, with the boxes detected in it."),
]
CameraDetector = Annotated[
    str,
    typer.Option(
        help="Camera detector whose boxes --image shows, see: roadscope list "
        "camera-detectors; or oracle.",
        autocompletion=completion.camera_detectors,
    ),
]
Seconds = Annotated[
    float | None,
    typer.Option(help="Length of the episode, 3600 at most; the scenario's own if left out."),
]
Every = Annotated[bool, typer.Option("--all", help="Show all metrics, not only the ten main ones.")]


def run_scenario(
    scenario: Scenario,
    *,
    seed: Seed = 0,
    rig: Rig = "lux",
    weather: Weather = "clear",
    light: Light = "day",
    faults: Faults = "clear",
    detector: Detector = "distance-l-shape",
    tracker: Tracker = "existence",
    picture: Picture = None,
    image: Image = None,
    camera_detector: CameraDetector = "network",
    seconds: Seconds = None,
    every: Every = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run one episode through one detector and one tracker.

    Exit status: 1 if a name is unknown or a plug-in fails.
    """
    from roadscope.benchmarks.camera_view import check_view, save_view
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.single import picture_path, run_episode, save_picture
    from roadscope.envs.sensors.faults import faults_of

    fault_names = tuple(map(str, faults_of(faults)))
    episode = Episode(scenario, seed, rig, seconds, weather, light, fault_names)
    if picture is not None:
        picture_path(picture)
    if image is not None:
        check_view(episode, camera_detector, image)
    with progress_bars(quiet=quiet) as progress:
        summary = run_episode(episode, detector=detector, tracker=tracker, progress=progress)
        if picture is not None:
            progress("picture", 0, 1)
            save_picture(summary, picture)
        boxes = 0 if image is None else save_view(episode, camera_detector, image)
    if json:
        print_json({**summary.to_json(), "detector": detector, "tracker": tracker})
    elif not quiet:
        _show(summary, detector, tracker, every=every)
        if picture is not None:
            typer.echo(f"picture: {picture}")
        if image is not None:
            typer.echo(f"image: {image}, {_boxes_in_words(boxes, camera_detector)}")


def _boxes_in_words(count: int, detector: str) -> str:
    from roadscope.benchmarks.camera_view import LEAST_SCORE

    return f"{count} boxes of {detector} with a score of {LEAST_SCORE:g} or more"


def _show(summary: Summary, detector: str, tracker: str, *, every: bool) -> None:
    from roadscope.benchmarks.nodes.tracks import is_offline
    from roadscope.benchmarks.references import detection_source
    from roadscope.benchmarks.tables import explained_table, score_table
    from roadscope.core.spec import FUSED
    from roadscope.envs.sensors.faults import of_camera_alone
    from roadscope.trackers import TRACKERS

    episode = summary.episode
    condition = "" if episode.condition == "clear" else f", {episode.condition}"
    title = f"{episode.scenario}, seed {episode.seed}, {episode.rig}{condition}"
    typer.echo(f"{title}: {len(summary.tracks)} frames, vehicles within 60 m")
    dark = (episode.light,) if episode.light != "day" else ()
    no_effect = (
        ""
        if detection_source(detector).kind == FUSED
        else ", ".join(dark + of_camera_alone(episode.faults))
    )
    if no_effect:
        typer.echo(f"without effect on LiDAR detectors: {no_effect}")
    headline(f"detector {detector}")
    detection, tracking = summary.detection, summary.tracking
    show(score_table(detection) if every else explained_table("detector", detection))
    label = " (offline)" if is_offline(TRACKERS.resolve(tracker)) else ""
    headline(f"tracker {tracker}{label}")
    show(score_table(tracking) if every else explained_table("tracker", tracking))
    if not every:
        show("--all shows all figures, with their numbers of samples.", dim=True)
