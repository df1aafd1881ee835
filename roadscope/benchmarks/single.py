"""Runs one episode through one detector and one tracker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from roadscope.benchmarks.boards.detection import detection_scores
from roadscope.benchmarks.boards.odometry import pose_scores
from roadscope.benchmarks.boards.tracking import missing_requirement, track_node, tracking_scores
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, check_episode, timeline_of
from roadscope.benchmarks.kinds import DETECTOR, TRACKER, check_plugin_spec, traits_of
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.nodes.fusions import detection_node
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.benchmarks.nodes.tuned import is_tuned
from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.records import EpisodeDetections, EpisodePoses
from roadscope.benchmarks.references import (
    check_detection_source,
    check_ego,
    check_pose_source,
    made_from_truth,
    missing_for_poses,
)
from roadscope.core import NotInstalledError, Spec, Tracks
from roadscope.core.loading import SpecError


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
    """The detections, tracks and scores of an episode.

    detections: frame by frame, with the truth, frame `world`.
    tracks: frame by frame, frame `world`.
    detection, tracking: scores by metric.
    rule: which objects are eligible.
    poses: of the odometry, or of that which the tracker gets poses from; None: there is none.
    odometry: scores of the odometry by metric; empty without one.
    """

    episode: Episode
    detections: EpisodeDetections
    tracks: tuple[Tracks, ...]
    detection: Mapping[str, Score]
    tracking: Mapping[str, Score]
    rule: Eligibility
    poses: EpisodePoses | None = None
    odometry: Mapping[str, Score] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return the episode and its scores as a dictionary that JSON can hold."""
        kinds = {"detection": self.detection, "tracking": self.tracking}
        if self.odometry:
            kinds["odometry"] = self.odometry
        return {
            "episode": asdict(self.episode),
            "frames": len(self.tracks),
            **{
                kind: {name: score.to_json() for name, score in scores.items()}
                for kind, scores in kinds.items()
            },
        }


def run_episode(
    episode: Episode,
    *,
    detector: str = "distance-l-shape",
    tracker: str = "existence",
    odometry: str | None = None,
    eligibility: Eligibility | None = None,
    progress: Progress | None = None,
    options: RunOptions | None = None,
) -> Summary:
    """Run a detector and a tracker over one episode.

    Unknown names, and what is not installed (`NotInstalledError`), raise before anything runs.

    odometry: one to run too; it does not give poses to the tracker (`tracker?ego=` does).
    progress: called with the stage, steps done and steps in all.
    options: how plug-ins that are not part of roadscope are run; `PluginError` if one fails.
    """
    source, tracker_spec = check_detection_source(detector), _checked_tracker(tracker)
    pose_spec = None if odometry is None else check_pose_source(odometry)
    if missing := _missing(source, tracker_spec, pose_spec):
        raise NotInstalledError(missing)
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
    node = track_node(tracker_spec, source, episode, rule)
    ego_poses = None if node.ego is None else node.ego.compute(options)
    answers = node.track(detections, ego_poses, options)
    report("tracking", 1, 1)
    pose_figures: Mapping[str, Score] = {}
    if pose_spec is not None:
        report("odometry", 0, 1)
        ego_poses = PoseNode(pose_spec, episode).compute(options)
        pose_figures = pose_scores(ego_poses)
        report("odometry", 1, 1)
    return Summary(
        episode,
        detections,
        answers.tracks,
        detection_scores(detections, rule, timed=not made_from_truth(source)),
        tracking_scores(answers, detections, rule),
        rule,
        ego_poses,
        pose_figures,
    )


def _checked_tracker(text: str) -> Spec:
    spec = Spec.parse(text)
    if is_tuned(spec):
        raise SpecError(f"{text}: a board chooses thresholds, one episode cannot")
    resolved = check_plugin_spec(spec, TRACKER)
    if resolved.ego is not None:
        check_ego(resolved.ego)
    return resolved


def _missing(source: Spec, tracker: Spec, odometry: Spec | None) -> str:
    """Return what is needed and not installed; empty if nothing."""
    missing = missing_requirement(tracker)
    if not missing and odometry is not None:
        missing = missing_for_poses(odometry)
    if not missing and source.kind == DETECTOR.name:
        missing = traits_of(source).requires
    return missing
