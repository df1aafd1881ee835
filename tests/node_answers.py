"""What single entries answer on an episode, computed anew; the one place that names nodes."""

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
