"""An episode with everything that a viewer shows of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, check_episode, timeline_of
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.nodes.images import ImageNode
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.records import EpisodeImageDetections, EpisodePoses
from roadscope.benchmarks.references import check_image_source
from roadscope.benchmarks.run_pictures import check_camera_detector
from roadscope.benchmarks.single import run_episode
from roadscope.benchmarks.viewing.curves import Curve, running_scores
from roadscope.core import Detections, Tracks, Truth
from roadscope.envs.sensors.rigs import rig
from roadscope.envs.traffic.timeline import Timeline

CAMERA_DETECTOR = "network"
"""The camera detector whose boxes are shown if none is named."""


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeView:
    """What is known of an episode; all but the title may be missing.

    episode: to make sensor data of; None if they cannot be made again.
    timeline: its traffic, for the road and the size of the ego.
    truths: at the stamps of the scans.
    detections: of a LiDAR detector or a fusion, in frame `world` or `ego`.
    tracks: in frame `world`.
    scores: of the whole episode, by board and metric. curves: scores over time.
    notes: what is not shown, and why.
    """

    title: str
    episode: Episode | None = None
    timeline: Timeline | None = None
    truths: Sequence[Truth] = ()
    detections: Sequence[Detections] = ()
    tracks: Sequence[Tracks] = ()
    poses: EpisodePoses | None = None
    images: EpisodeImageDetections | None = None
    scores: Mapping[str, Mapping[str, Score]] = field(default_factory=dict)
    curves: Sequence[Curve] = ()
    notes: Sequence[str] = ()


def view_of_scenario(
    episode: Episode,
    *,
    detector: str,
    tracker: str,
    odometry: str | None = None,
    camera_detector: str | None = None,
    progress: Progress | None = None,
) -> EpisodeView:
    """Run plug-ins on an episode as `run_episode` does; unknown names raise before anything runs.

    odometry: source of poses, which are shown beside the true ones; trackers do not get them. None:
        the poses that the tracker gets are shown, if they are of an odometry.
    camera_detector: for a rig with a camera, others are refused; None: `network` if there is one.
    """
    report = progress or silent
    check_episode(episode)
    if camera_detector is None and rig(episode.rig).camera is not None:
        camera_detector = CAMERA_DETECTOR
    if camera_detector is not None:
        check_camera_detector(episode, camera_detector)
    summary = run_episode(
        episode, detector=detector, tracker=tracker, odometry=odometry, progress=report
    )
    images: EpisodeImageDetections | None = None
    scores = {"detection": summary.detection, "tracking": summary.tracking}
    if summary.odometry:
        scores["odometry"] = summary.odometry
    if camera_detector is not None:
        report("images", 0, 1)
        node = ImageNode(check_image_source(camera_detector), episode, 0.0)
        images = node.compute(RunOptions())
        report("images", 1, 1)
    named = [detector, tracker, *([odometry] if odometry else [])]
    return EpisodeView(
        title=f"{episode.scenario}, seed {episode.seed}, {episode.rig}: {', '.join(named)}",
        episode=episode,
        timeline=timeline_of(episode),
        truths=summary.detections.truths,
        detections=summary.detections.detections,
        tracks=summary.tracks,
        poses=summary.poses,
        images=images,
        scores=scores,
        curves=running_scores(Eligibility(), summary.detections, summary.tracks, summary.poses),
    )
