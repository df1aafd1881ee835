"""One episode through one detector and one tracker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.cache import usable_file, write_atomically
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, check_episode, sensing_of, timeline_of
from roadscope.benchmarks.jobs.ego_poses import track_told
from roadscope.benchmarks.jobs.entries import check_detector, check_tracker
from roadscope.benchmarks.jobs.job import detection_scores, perceived_by, tracking_scores
from roadscope.benchmarks.jobs.stack import prints_aside
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.perceived import Perceived
from roadscope.benchmarks.progress import Progress, silent
from roadscope.core import Tracks

PICTURES = (".png", ".jpg", ".webp")


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
    """What came of an episode.

    perceived: detections and truth, frame by frame, world frame.
    tracks: tracks, frame by frame, world frame.
    detection, tracking: scores by metric.
    """

    episode: Episode
    perceived: Perceived
    tracks: tuple[Tracks, ...]
    detection: Mapping[str, Score]
    tracking: Mapping[str, Score]


@prints_aside()
def run_episode(
    episode: Episode,
    *,
    detector: str = "distance-l-shape",
    tracker: str = "existence",
    eligibility: Eligibility | None = None,
    progress: Progress | None = None,
) -> Summary:
    """Run one stack over one episode; unknown names raise before anything runs.

    progress: told the stage, steps done and steps in all.
    """
    check_detector(detector)
    check_tracker(tracker)
    check_episode(episode)
    rule = Eligibility() if eligibility is None else eligibility
    tell = progress or silent
    tell("traffic", 0, 1)
    timeline_of(episode)
    tell("traffic", 1, 1)
    tell("detection", 0, 1)
    perceived = perceived_by(detector, episode, rule)
    tell("detection", 1, 1)
    tell("tracking", 0, 1)
    tracks, calls_ms = track_told(tracker, perceived, episode)
    tell("tracking", 1, 1)
    return Summary(
        episode,
        perceived,
        tuple(tracks),
        detection_scores(detector, perceived, rule),
        tracking_scores(tracks, calls_ms, perceived, rule),
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
        detections=summary.perceived.detections[index].moved(ego_from_world, "ego"),
    )


def picture_path(path: Path | str) -> Path:
    """Refuse a path that no picture can be written to, before anything is computed."""
    return usable_file(path, PICTURES, "a picture")


def save_picture(summary: Summary, path: Path | str) -> None:
    """Write the bird's-eye view to an image file; its ending says the format."""
    from matplotlib.image import imsave

    path = picture_path(path)
    image = picture(summary)
    write_atomically(path, lambda part: imsave(part, image, format=path.suffix[1:].lower()))
