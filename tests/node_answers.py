"""What single entries answer on an episode, computed anew; the one place that names nodes."""

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.nodes.fusions import FusedDetectionNode, FusionNode
from roadscope.benchmarks.nodes.images import ImageNode
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.benchmarks.records import (
    EpisodeDetections,
    EpisodeFusions,
    EpisodeImageDetections,
    EpisodePoses,
)
from roadscope.benchmarks.references import detection_source, image_source, pose_source


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
