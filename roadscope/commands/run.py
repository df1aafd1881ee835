"""`roadscope run`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from roadscope.commands import completion
from roadscope.commands.terminal import headline, progress_bars, show

if TYPE_CHECKING:
    from roadscope.benchmarks.single import Summary


def run_scenario(
    scenario: Annotated[
        str,
        typer.Argument(
            help="Traffic, see: roadscope list scenarios.", autocompletion=completion.scenarios
        ),
    ],
    *,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another episode.")] = 0,
    rig: Annotated[
        str,
        typer.Option(help="Sensors: a name or a .toml file.", autocompletion=completion.rigs),
    ] = "lux",
    weather: Annotated[
        str,
        typer.Option(
            help="Such as rain-2, see: roadscope list weathers.",
            autocompletion=completion.weathers,
        ),
    ] = "clear",
    light: Annotated[
        str,
        typer.Option(
            help="For a rig with a camera, see: roadscope list lights.",
            autocompletion=completion.lights,
        ),
    ] = "day",
    faults: Annotated[
        str, typer.Option(help="Such as 'fog:3 + dropped-scans:2', see: roadscope list faults.")
    ] = "clear",
    detector: Annotated[
        str,
        typer.Option(
            help="A name, module:Class or file.py:Class, with ?argument=value.",
            autocompletion=completion.detectors,
        ),
    ] = "distance-l-shape",
    tracker: Annotated[
        str, typer.Option(help="Likewise.", autocompletion=completion.trackers)
    ] = "existence",
    picture: Annotated[
        Path | None, typer.Option(help="Write a bird's-eye view of the middle frame here.")
    ] = None,
    image: Annotated[
        Path | None,
        typer.Option(help="Write the camera's middle image here, with boxes found in it."),
    ] = None,
    camera_detector: Annotated[
        str,
        typer.Option(
            help="Whose boxes, see: roadscope list camera-detectors; or oracle.",
            autocompletion=completion.camera_detectors,
        ),
    ] = "network",
    seconds: Annotated[
        float | None,
        typer.Option(help="Length of the episode, 3600 at most; the scenario's own if left out."),
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Show all figures, not the ten main ones of each.")
    ] = False,
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
    _show(summary, detector, tracker, everything=everything)
    if picture is not None:
        typer.echo(f"picture: {picture}")
    if image is not None:
        count = save_view(episode, camera_detector, image)
        sure = f"boxes of {camera_detector} with a score of {LEAST_SCORE:g} or more"
        typer.echo(f"image: {image}, {count} {sure}")


def _show(summary: Summary, detector: str, tracker: str, *, everything: bool) -> None:
    from roadscope.benchmarks.nodes.tracks import is_offline
    from roadscope.benchmarks.references import detection_source
    from roadscope.benchmarks.tables import explained_table, score_table
    from roadscope.core.spec import FUSED
    from roadscope.envs.sensors.faults import of_camera_alone
    from roadscope.trackers import TRACKERS

    episode = summary.episode
    condition = "" if episode.condition == "clear" else f", {episode.condition}"
    where = f"{episode.scenario}, seed {episode.seed}, {episode.rig}{condition}"
    typer.echo(f"{where}: {len(summary.tracks)} frames, vehicles within 60 m")
    dark = (episode.light,) if episode.light != "day" else ()
    idle = (
        ""
        if detection_source(detector).kind == FUSED
        else ", ".join(dark + of_camera_alone(episode.faults))
    )
    if idle:
        typer.echo(f"without effect on LiDAR detectors: {idle}")
    headline(f"detector {detector}")
    detection, tracking = summary.detection, summary.tracking
    show(score_table(detection) if everything else explained_table("detector", detection))
    late = " (offline)" if is_offline(TRACKERS.resolve(tracker)) else ""
    headline(f"tracker {tracker}{late}")
    show(score_table(tracking) if everything else explained_table("tracker", tracking))
    if not everything:
        show("--all shows all figures, with their numbers of samples.", dim=True)
