"""`roadscope run`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadscope.commands.terminal import headline, progress_bars, show

if TYPE_CHECKING:
    from roadscope.benchmarks.single import Summary


def run_scenario(
    scenario: Annotated[str, typer.Argument(help="Traffic, see: roadscope list scenarios.")],
    *,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another episode.")] = 0,
    rig: Annotated[str, typer.Option(help="Sensors: a name or a .toml file.")] = "lux",
    weather: Annotated[str, typer.Option(help="Such as rain-2, see: roadscope list weathers.")] = (
        "clear"
    ),
    light: Annotated[str, typer.Option(help="For a camera, see: roadscope list lights.")] = "day",
    faults: Annotated[
        str, typer.Option(help="Such as 'fog:3 + dropped-scans:2', see: roadscope list faults.")
    ] = "clear",
    detector: Annotated[
        str, typer.Option(help="A name, module:Class or file.py:Class, with ?argument=value.")
    ] = "distance-l-shape",
    tracker: Annotated[str, typer.Option(help="Likewise.")] = "existence",
    picture: Annotated[
        Path | None, typer.Option(help="Write a bird's-eye view of the middle frame here.")
    ] = None,
    image: Annotated[
        Path | None,
        typer.Option(help="Write the camera's middle image here, with boxes found in it."),
    ] = None,
    camera_detector: Annotated[
        str, typer.Option(help="Whose boxes, see: roadscope list camera-detectors; or oracle.")
    ] = "network",
    seconds: Annotated[
        float | None, typer.Option(help="Length of the episode; the scenario's own if left out.")
    ] = None,
) -> None:
    """Run one episode through one detector and one tracker."""
    from roadscope.benchmarks.camera_view import LEAST_SCORE, check_view, save_view
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.single import picture_path, run_episode, save_picture
    from roadscope.envs.sensors.faults import faults_of

    told = tuple(map(str, faults_of(faults)))
    episode = Episode(scenario, seed, rig, seconds, weather, light, told)
    if picture is not None:
        picture_path(picture)
    if image is not None:
        check_view(episode, camera_detector, image)
    with progress_bars() as progress:
        summary = run_episode(episode, detector=detector, tracker=tracker, progress=progress)
        if picture is not None:
            progress("picture", 0, 1)
            save_picture(summary, picture)
    _show(summary, detector, tracker)
    if picture is not None:
        typer.echo(f"picture: {picture}")
    if image is not None:
        count = save_view(episode, camera_detector, image)
        sure = f"boxes of {camera_detector} with a score of {LEAST_SCORE:g} or more"
        typer.echo(f"image: {image}, {count} {sure}")


def _show(summary: Summary, detector: str, tracker: str) -> None:
    from roadscope.benchmarks.jobs.stack import offline
    from roadscope.benchmarks.oracle import is_fused
    from roadscope.benchmarks.tables import score_table
    from roadscope.envs.sensors.faults import of_camera_alone

    episode = summary.episode
    condition = "" if episode.condition == "clear" else f", {episode.condition}"
    where = f"{episode.scenario}, seed {episode.seed}, {episode.rig}{condition}"
    typer.echo(f"{where}: {len(summary.tracks)} frames, vehicles within 60 m")
    dark = (episode.light,) if episode.light != "day" else ()
    idle = "" if is_fused(detector) else ", ".join(dark + of_camera_alone(episode.faults))
    if idle:
        typer.echo(f"without effect on LiDAR detectors: {idle}")
    headline(f"detector {detector}")
    show(score_table(summary.detection))
    late = " (offline)" if offline(tracker) else ""
    headline(f"tracker {tracker}{late}")
    show(score_table(summary.tracking))
