"""What single entries answer on an episode, computed anew; the one place that names nodes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from roadscope.benchmarks import (
    Eligibility,
    Episode,
    EpisodeDetections,
    EpisodeFusions,
    EpisodeImageDetections,
    EpisodePoses,
    RunOptions,
    detection_source,
    image_source,
    pose_source,
)
from roadscope.benchmarks.nodes import (
    DetectionNode,
    FusedDetectionNode,
    FusionNode,
    ImageNode,
    PoseNode,
)


def poses_of(spec: str, episode: Episode) -> EpisodePoses:
    return PoseNode(pose_source(spec), episode).compute(RunOptions())


@dataclass(frozen=True)
class _PosesOnScans(PoseNode):
    """The poses of an odometry on scans that are there."""

    scans: tuple[Any, ...] = ()

    def steps(self) -> tuple[Any, ...]:
        return self.scans


def poses_of_each(specs: Sequence[str], episode: Episode) -> dict[str, EpisodePoses]:
    """Return the poses of several odometries, for which the episode is sensed once."""
    sources = {spec: pose_source(spec) for spec in specs}
    scans = tuple(PoseNode(sources[specs[0]], episode).steps())
    return {
        spec: _PosesOnScans(source, episode, scans).compute(RunOptions())
        for spec, source in sources.items()
    }


def detections_of(spec: str, episode: Episode, rule: Eligibility) -> EpisodeDetections:
    return DetectionNode(detection_source(spec), episode, rule).compute(RunOptions())


def images_of(spec: str, episode: Episode, every_s: float) -> EpisodeImageDetections:
    return ImageNode(image_source(spec), episode, every_s).compute(RunOptions())


def fusion_node(
    spec: str, episode: Episode, rule: Eligibility, *, every_s: float = 0.0, alone: str = ""
) -> FusionNode:
    return FusionNode.of(detection_source(spec), episode, rule, every_s=every_s, alone=alone)


def fusions_of(
    spec: str, episode: Episode, rule: Eligibility, *, every_s: float = 0.0, alone: str = ""
) -> EpisodeFusions:
    return fusion_node(spec, episode, rule, every_s=every_s, alone=alone).compute(RunOptions())


def fused_detections_of(spec: str, episode: Episode, rule: Eligibility) -> EpisodeDetections:
    return FusedDetectionNode(fusion_node(spec, episode, rule)).compute(RunOptions())
