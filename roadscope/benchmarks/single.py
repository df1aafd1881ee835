"""Runs one episode through one detector and one tracker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.benchmarks.boards.detection import detection_scores
from roadscope.benchmarks.boards.tracking import track_node, tracking_scores
from roadscope.benchmarks.cache import usable_file, write_atomically
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, check_episode, sensing_of, timeline_of
from roadscope.benchmarks.kinds import TRACKER, check_plugin_spec
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.nodes.fusions import detection_node
from roadscope.benchmarks.nodes.poses import start_from_ego
from roadscope.benchmarks.nodes.tracks import track
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.records import EpisodeDetections
from roadscope.benchmarks.references import (
    check_detection_source,
    check_ego,
    made_from_truth,
)
from roadscope.core import Spec, Tracks

PICTURES = (".png", ".jpg", ".webp")


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
    """The detections, tracks and scores of an episode.

    detections: frame by frame, with the truth, frame `world`.
    tracks: frame by frame, frame `world`.
    detection, tracking: scores by metric.
    """

    episode: Episode
    detections: EpisodeDetections
    tracks: tuple[Tracks, ...]
    detection: Mapping[str, Score]
    tracking: Mapping[str, Score]

    def to_json(self) -> dict[str, Any]:
        """Return the episode and its scores as a dictionary that JSON can hold."""
        return {
            "episode": asdict(self.episode),
            "frames": len(self.tracks),
            "detection": {name: score.to_json() for name, score in self.detection.items()},
            "tracking": {name: score.to_json() for name, score in self.tracking.items()},
        }


def run_episode(
    episode: Episode,
    *,
    detector: str = "distance-l-shape",
    tracker: str = "existence",
    eligibility: Eligibility | None = None,
    progress: Progress | None = None,
    options: RunOptions | None = None,
) -> Summary:
    """Run a detector and a tracker over one episode; unknown names raise before anything runs.

    progress: called with the stage, steps done and steps in all.
    options: how plug-ins that are not part of roadscope are run; `PluginError` if one fails.
    """
    source = check_detection_source(detector)
    tracker_spec = check_plugin_spec(Spec.parse(tracker), TRACKER)
    if tracker_spec.ego is not None:
        check_ego(tracker_spec.ego)
    check_episode(episode)
    rule = Eligibility() if eligibility is None else eligibility
    options = options or RunOptions()
    report = progress or silent
    report("traffic", 0, 1)
    timeline_of(episode)
    report("traffic", 1, 1)
    report("detection", 0, 1)
    detections = detection_node(source, episode, rule).compute(options)
    assert isinstance(detections, EpisodeDetections)
    report("detection", 1, 1)
    report("tracking", 0, 1)
    node = track_node(tracker_spec, detector, episode, rule)
    poses = None
    if node.ego is not None:
        stamps_s = [truth.stamp_s for truth in detections.truths]
        poses = start_from_ego(node.ego.compute(options), episode, stamps_s)
    no_poses = [None] * len(detections.truths)
    answers = track(
        tracker_spec, detections, poses=poses if node.posed else no_poses, options=options
    )
    report("tracking", 1, 1)
    return Summary(
        episode,
        detections,
        answers.tracks,
        detection_scores(detections, rule, timed=not made_from_truth(source)),
        tracking_scores(answers, detections, rule),
    )


def picture(summary: Summary, index: int | None = None) -> np.ndarray:
    """Return a bird's-eye view of one frame, the middle one by default: (H, W, 3) uint8."""
    from roadscope.envs.gym.render import birds_eye

    episode = summary.episode
    index = len(summary.tracks) // 2 if index is None else index
    timeline = timeline_of(episode)
    frame, truth = sensing_of(episode).sense(timeline, index)
    ego_from_world = truth.world_from_ego.inverse()
    return birds_eye(
        frame,
        truth,
        timeline,
        tracks=summary.tracks[index],
        detections=summary.detections.detections[index].moved(ego_from_world, "ego"),
    )


def picture_path(path: Path | str) -> Path:
    """Return the path; raise `FolderError` if no picture can be written there."""
    return usable_file(path, PICTURES, "a picture")


def save_picture(summary: Summary, path: Path | str) -> None:
    """Write the bird's-eye view to an image file, in the format of its ending."""
    from matplotlib.image import imsave

    path = picture_path(path)
    image = picture(summary)
    write_atomically(path, lambda part: imsave(part, image, format=path.suffix[1:].lower()))
