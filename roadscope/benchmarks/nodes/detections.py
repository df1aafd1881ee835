"""Detections in space: of a LiDAR detector, or made from truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.fingerprints import fingerprint
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.kinds import DETECTOR
from roadscope.benchmarks.loop import CallInput, Replies, RunOptions, run_plugin
from roadscope.benchmarks.nodes.traffic import SensingNode
from roadscope.benchmarks.noisy import NoisyDetections
from roadscope.benchmarks.parked import parked_centres, parked_owners
from roadscope.benchmarks.records import CallTimes, EpisodeDetections, without_sources
from roadscope.benchmarks.references import made_from_truth
from roadscope.core import Detections, Frame, Spec, Truth
from roadscope.core.answers import same_stamp
from roadscope.core.spec import ORACLE


@dataclass(frozen=True)
class DetectionNode(SensingNode):
    """The detections of a LiDAR detector, the oracle or a noise model on an episode.

    rule: which objects are eligible; only detections made from truth depend on it.
    """

    source: Spec
    episode: Episode
    rule: Eligibility

    stage = "detections"
    folder = "detections"
    record = EpisodeDetections

    def content(self) -> Mapping[str, Any]:
        """Return what the detections depend on."""
        rule = fingerprint(self.rule) if made_from_truth(self.source) else None
        return {**super().content(), "rule": rule}

    def compute(self, options: RunOptions) -> EpisodeDetections:
        """Run the detector over the scans of the episode."""
        parked: set[int] = set()
        inputs = _inputs(sensed(self.episode), parked)
        if made_from_truth(self.source):
            truths = tuple(each.context for each in inputs)
            detections = tuple(map(self._from_truth(), truths))
            times, delays_s = CallTimes.zero(len(truths)), np.zeros(len(truths))
        else:
            replies: Replies[Truth, Detections]
            replies = run_plugin(self.source, DETECTOR, inputs, options=options)
            truths, times = replies.contexts, replies.times
            answers = [answer for answer in replies.answers if answer is not None]
            detections, delays_s = _by_frame(self.source, answers, truths)
        if not truths:
            raise ValueError("the episode is shorter than one sweep of the LiDAR")
        centres = parked_centres(self.episode, parked)
        return EpisodeDetections(detections, truths, times, centres, delays_s)

    def _from_truth(self) -> Callable[[Truth], Detections]:
        """Return a function that makes the detections of consecutive frames from their truth."""
        if self.source.kind == ORACLE:
            return partial(oracle_detections, rule=self.rule)
        return NoisyDetections(self.source.make(), self.episode, self.rule).of


def oracle_detections(truth: Truth, rule: Eligibility) -> Detections:
    """Return the true boxes of all eligible objects, frame `world`."""
    return true_boxes(truth, rule.of(truth))


def true_boxes(truth: Truth, chosen: np.ndarray) -> Detections:
    """Return the boxes of objects in (M,) bool as detections with score 1, frame `world`."""
    rows = np.flatnonzero(chosen)
    return Detections(
        truth.centres[rows],
        truth.sizes[rows],
        truth.yaws[rows],
        truth.categories[rows],
        np.ones(len(rows)),
        "world",
        truth.stamp_s,
    )


def _inputs(frames: Iterable[tuple[Frame, Truth]], parked: set[int]) -> Iterator[CallInput[Truth]]:
    """Yield scans with their truth, and add the numbers of parked cars to `parked`."""
    for frame, truth in frames:
        parked |= parked_owners(truth)
        yield CallInput((frame,), without_sources(truth))


def _by_frame(
    source: Spec, answers: Sequence[Detections], truths: Sequence[Truth]
) -> tuple[tuple[Detections, ...], np.ndarray]:
    """Return the answers, frame `world`, ordered by the frames with their stamps, and delays.

    A late detector may first give an empty answer for a frame, which a later one replaces. A
    second answer for a frame that has detections raises `PluginError`.
    """
    detections = [Detections.empty(truth.stamp_s, "world") for truth in truths]
    delays_s = np.full(len(truths), np.nan)
    for now, answer in enumerate(answers):
        row = next(k for k in range(now, -1, -1) if same_stamp(answer.stamp_s, truths[k].stamp_s))
        if len(detections[row]):
            raise PluginError(
                str(source),
                f"two answers to the frame at {truths[row].stamp_s:.6g} s, the second in the "
                f"frame at {truths[now].stamp_s:.6g} s",
            )
        detections[row] = in_world(answer, truths[row])
        delays_s[row] = truths[now].stamp_s - truths[row].stamp_s
    return tuple(detections), delays_s


def in_world(detections: Detections, truth: Truth) -> Detections:
    """Return the detections of a scan in the frame `world`."""
    if detections.frame == "world":
        return detections
    return detections.moved(truth.world_from_ego, "world")
