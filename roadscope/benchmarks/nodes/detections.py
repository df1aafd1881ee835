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
from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.kinds import DETECTOR
from roadscope.benchmarks.loop import CallInput, RunOptions, run_plugin
from roadscope.benchmarks.nodes.traffic import TrafficNode
from roadscope.benchmarks.noisy import NoisyDetections
from roadscope.benchmarks.parked import parked_centres, parked_owners
from roadscope.benchmarks.records import CallTimes, EpisodeDetections, without_sources
from roadscope.benchmarks.references import made_from_truth
from roadscope.core import Detections, Frame, Spec, Truth
from roadscope.core.answers import check_detections, check_masses, same_stamp
from roadscope.core.spec import ORACLE


@dataclass(frozen=True)
class DetectionNode(Node):
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

    def sources(self) -> tuple[Node, ...]:
        """Return the traffic."""
        return (TrafficNode.of(self.episode),)

    def compute(self, options: RunOptions) -> EpisodeDetections:
        """Run the detector over the scans of the episode."""
        parked: set[int] = set()
        inputs = _inputs(self.frames(), parked)
        if made_from_truth(self.source):
            truths = tuple(each.context for each in inputs)
            detections = tuple(map(self._from_truth(), truths))
            times, delays_s = CallTimes.zero(len(truths)), np.zeros(len(truths))
        else:
            replies = run_plugin(self.source, DETECTOR, inputs, _check_of(), options=options)
            truths, times = replies.contexts, replies.times
            answers = [answer for answer in replies.answers if answer is not None]
            detections, delays_s = _by_frame(self.source, answers, truths)
        if not truths:
            raise ValueError("the episode is shorter than one sweep of the LiDAR")
        centres = parked_centres(self.episode, parked)
        return EpisodeDetections(detections, truths, times, centres, delays_s)

    def frames(self) -> Iterable[tuple[Frame, Truth]]:
        """Return the frames with scans of the episode, and their truth."""
        return sensed(self.episode)

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


def _check_of() -> Callable[[Any, CallInput[Truth]], Detections]:
    """Return a check of consecutive answers, each of which may be for any frame so far."""
    stamps_s: list[float] = []
    columns: set[int] = set()

    def check(answer: Any, call_input: CallInput[Truth]) -> Detections:
        stamps_s.append(call_input.context.stamp_s)
        detections = check_detections(answer, stamps_s=stamps_s)
        check_masses(detections.masses, columns)
        return detections

    return check


def _by_frame(
    source: Spec, answers: Sequence[Detections], truths: Sequence[Truth]
) -> tuple[tuple[Detections, ...], np.ndarray]:
    """Return the answers, frame `world`, ordered by the frames with their stamps, and delays."""
    detections = [Detections.empty(truth.stamp_s, "world") for truth in truths]
    delays_s = np.full(len(truths), np.nan)
    for now, row in enumerate(_frames_answered(source, answers, truths)):
        if row is not None:
            detections[row] = _in_world(answers[now], truths[row])
            delays_s[row] = truths[now].stamp_s - truths[row].stamp_s
    return tuple(detections), delays_s


def _frames_answered(
    source: Spec, answers: Sequence[Detections], truths: Sequence[Truth]
) -> list[int | None]:
    """Return the frame that each answer is for; None if a later answer replaces it.

    A late detector may first give an empty answer for a frame, which a later one replaces. A
    second answer for a frame that has detections raises `PluginError`.
    """
    rows: list[int | None] = []
    answer_of: dict[int, int] = {}
    for now, answer in enumerate(answers):
        row = next(k for k in range(now, -1, -1) if same_stamp(answer.stamp_s, truths[k].stamp_s))
        before = answer_of.get(row)
        if before is not None and len(answers[before]):
            raise PluginError(
                str(source),
                f"two answers to the frame at {truths[row].stamp_s:.6g} s, the second in the "
                f"frame at {truths[now].stamp_s:.6g} s",
            )
        if before is not None:
            rows[before] = None
        answer_of[row] = now
        rows.append(row)
    return rows


def _in_world(detections: Detections, truth: Truth) -> Detections:
    if detections.frame == "world":
        return detections
    return detections.moved(truth.world_from_ego, "world")
