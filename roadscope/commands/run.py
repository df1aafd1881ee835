"""`roadscope run`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from roadscope.commands import completion, options
from roadscope.commands.options import PICTURES, argument, is_given, option
from roadscope.commands.terminal import headline, print_json, progress_bars, say, show

if TYPE_CHECKING:
    from roadscope.benchmarks.single import Summary

NEEDED_OPTIONS = {
    "returns": ("picture", "video"),
    "video_width": ("video",),
    "video_every": ("video",),
    "camera_detector": ("picture", "video", "image"),
}
"""Options that change pictures -> those that ask for a picture; one of these has to be used too."""


def run_scenario(
    context: typer.Context,
    scenario: str = argument(
        "SCENARIO", "Traffic: see roadscope list scenarios", names=completion.scenarios
    ),
    *,
    seed: int = option("N", "Another seed is another episode", min=0, default=0),
    rig: str = options.RIG,
    seconds: float | None = options.SECONDS,
    picture: Path | None = option("FILE", "Draw the middle scan, all answers: .png, .jpg, .webp"),
    video: Path | None = option("FILE", "Draw all scans, as .gif, or .mp4 (roadscope[video])"),
    image: Path | None = option(
        "FILE", "Draw the middle image with boxes: .png, .jpg, .webp", PICTURES
    ),
    returns: options.ReturnColours = options.RETURNS,
    video_width: int = option("PX", "320 to 1280", PICTURES, min=320, max=1280, default=1280),
    video_every: int = option("N", "Draw every n-th scan", PICTURES, min=1, default=1),
    detector: str = options.DETECTOR,
    tracker: str = options.TRACKER,
    odometry: str | None = options.ODOMETRY,
    camera_detector: str | None = options.CAMERA_DETECTOR,
    weather: str = options.WEATHER,
    light: str = options.LIGHT,
    faults: str = options.FAULTS,
    every: bool = options.EVERY,
    quiet: bool = options.QUIET,
    json: bool = options.JSON,
) -> None:
    """Run one episode through one detector and one tracker, and an odometry if one is named.

    Exit status: 1 if a name is unknown or a plug-in fails.
    """
    _refuse_without_effect(context)
    from roadscope.benchmarks import run_pictures
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.single import run_episode
    from roadscope.benchmarks.tables import explained_table, score_table
    from roadscope.envs.sensors.faults import faults_of

    fault_names = tuple(map(str, faults_of(faults)))
    episode = Episode(scenario, seed, rig, seconds, weather, light, fault_names)
    if picture is not None:
        run_pictures.picture_path(picture)
    if video is not None:
        run_pictures.check_video(episode, video, every=video_every)
    if camera_detector is not None:
        run_pictures.check_camera_detector(episode, camera_detector)
    image_detector = camera_detector or "network"
    if image is not None:
        run_pictures.check_view(episode, image_detector, image)
    with progress_bars(quiet=quiet) as progress:
        summary = run_episode(
            episode, detector=detector, tracker=tracker, odometry=odometry, progress=progress
        )
        if picture is not None:
            progress("picture", 0, 1)
            run_pictures.save_picture(
                summary, picture, colour_by=returns, camera_detector=camera_detector
            )
        if video is not None:
            run_pictures.save_video(
                summary,
                video,
                colour_by=returns,
                camera_detector=camera_detector,
                width=video_width,
                every=video_every,
                progress=progress,
            )
        boxes = 0 if image is None else run_pictures.save_view(episode, image_detector, image)
    names = {"detector": detector, "tracker": tracker}
    if json:
        print_json({**summary.to_json(), **names, **({"odometry": odometry} if odometry else {})})
    elif not quiet:
        _show(summary, detector, tracker, every=every)
        if odometry is not None:
            headline(f"odometry {odometry}")
            figures = summary.odometry
            show(score_table(figures) if every else explained_table("odometry", figures))
        if not every:
            show("--all shows all figures, with their numbers of samples.", dim=True)
        if picture is not None:
            say(f"picture: {picture}")
        if video is not None:
            say(f"video: {video}")
        if image is not None:
            say(
                f"image: {image}, {boxes} boxes of {image_detector} with a score of "
                f"{run_pictures.LEAST_SCORE:g} or more"
            )


def _refuse_without_effect(context: typer.Context) -> None:
    """Refuse options of pictures if no picture is asked for that they change."""
    for name, needed in NEEDED_OPTIONS.items():
        if is_given(context, name) and all(context.params[each] is None for each in needed):
            options = " or ".join(f"--{each}" for each in needed)
            raise typer.BadParameter(
                f"--{name.replace('_', '-')} has no effect without {options}", ctx=context
            )


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
    say(f"{title}: {len(summary.tracks)} frames, vehicles within 60 m")
    dark = (episode.light,) if episode.light != "day" else ()
    no_effect = (
        ""
        if detection_source(detector).kind == FUSED
        else ", ".join(dark + of_camera_alone(episode.faults))
    )
    if no_effect:
        say(f"without effect on LiDAR detectors: {no_effect}")
    headline(f"detector {detector}")
    detection, tracking = summary.detection, summary.tracking
    show(score_table(detection) if every else explained_table("detector", detection))
    label = " (offline)" if is_offline(TRACKERS.resolve(tracker)) else ""
    headline(f"tracker {tracker}{label}")
    show(score_table(tracking) if every else explained_table("tracker", tracking))
