"""Detections that are made from truth, and the marks of a board, which are shown apart."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.noisy import NOISES, NoisyDetections
from roadscope.core import Detections, Truth
from roadscope.core.registry import split_spec

ORACLE = "oracle"
"""It is no plug-in."""
FUSED = "fused"
"""Names a LiDAR's and a camera's detections joined: `fused?lidar=...&camera=...&fusion=...`."""
CLUSTER_BOXES = "cluster-boxes"
SUITES_ONLY: Mapping[str, str] = {
    CLUSTER_BOXES: "roadscope.fusion.cluster_boxes:ClusterBoxes",
}
"""Detectors that suites and `fused` name beside those of `DETECTORS`, made to be joined with a
camera's: its boxes are in steps of 5 degrees and completed to usual sizes."""
ONE_CLUSTER = "one-cluster"
"""All returns above the ground are one cluster, and the cluster is one box; with a shape that
divides clusters into lines, vehicles would be told apart again."""
MARKS: Mapping[str, str] = {ORACLE: "upper mark", ONE_CLUSTER: "lower mark"}
MARK_SPECS: Mapping[str, str] = {
    ORACLE: ORACLE,
    ONE_CLUSTER: "cluster?clustering=one&shape=rectangle",
}
"""The detectors of the marks, which are on every detection board."""


def mark_of(entry: str, tracker: str | None) -> str | None:
    """Say which mark an entry is; what trackers make of the oracle's detections is an upper one.

    entry: how the board calls it.
    tracker: its spec; None on the detection board.
    """
    if tracker is None:
        return MARKS.get(entry)
    return MARKS[ORACLE] if entry == f"{tracker} on {ORACLE}" else None


def is_fused(detector: str) -> bool:
    """Say whether a spec names a LiDAR's and a camera's detections joined."""
    return split_spec(detector)[0] == FUSED


def full_name(detector: str) -> str:
    """Return the spec by which a detector of `DETECTORS` or `SUITES_ONLY` is made."""
    name, mark, arguments = detector.partition("?")
    return SUITES_ONLY.get(name, name) + mark + arguments


def made_from_truth(detector: str) -> bool:
    """Say whether a spec names no plug-in but the oracle or a noise model."""
    return detector == ORACLE or split_spec(detector)[0] in NOISES


def from_truth(
    detector: str, episode: Episode, eligibility: Eligibility
) -> Callable[[Truth], Detections]:
    """Return what makes detections of the frames of an episode, one after the other."""
    if detector == ORACLE:
        return lambda truth: oracle_detections(truth, eligibility)
    return NoisyDetections(NOISES.make(detector), episode, eligibility).of


def oracle_detections(truth: Truth, eligibility: Eligibility) -> Detections:
    """Return the true boxes of all eligible objects, world frame."""
    rows = np.flatnonzero(eligibility.of(truth))
    return Detections(
        truth.centres[rows], truth.sizes[rows], truth.yaws[rows], truth.categories[rows],
        np.ones(len(rows)), "world", truth.stamp_s,
    )  # fmt: skip
