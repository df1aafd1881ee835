"""Detections in space: a LiDAR detector's, those made from truth, or fused ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.fingerprint import fingerprint
from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.kinds import DETECTOR
from roadscope.benchmarks.loop import CallInput, RunOptions, run_plugin
from roadscope.benchmarks.nodes.traffic import TrafficNode
from roadscope.benchmarks.noisy import NoisyDetections
from roadscope.benchmarks.parked import parked_centres, parked_owners
from roadscope.benchmarks.records import CallTimes, EpisodeDetections, without_sources
from roadscope.benchmarks.references import made_from_truth
from roadscope.core import Detections, Spec, Truth
from roadscope.core.answers import check_detections, check_masses, same_stamp
from roadscope.core.spec import ORACLE


@dataclass(frozen=True)
class DetectionNode(Node):
    """The detections of a LiDAR detector, the oracle or a noise model on an episode.

    rule: what is to be found; only what is made from truth depends on it.
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
        if made_from_truth(self.source):
            return _from_truth(self.source, self.episode, self.rule)
        return _detected(self.source, self.episode, options)


def oracle_detections(truth: Truth, rule: Eligibility) -> Detections:
    """Return the true boxes of all eligible objects, frame `world`."""
    rows = np.flatnonzero(rule.of(truth))
    return Detections(
        truth.centres[rows],
        truth.sizes[rows],
        truth.yaws[rows],
        truth.categories[rows],
        np.ones(len(rows)),
        "world",
        truth.stamp_s,
    )


def _from_truth(source: Spec, episode: Episode, rule: Eligibility) -> EpisodeDetections:
    """Make detections from the truth of every frame."""
    make: Callable[[Truth], Detections]
    if source.kind == ORACLE:
        make = lambda truth: oracle_detections(truth, rule)  # noqa: E731
    else:
        make = NoisyDetections(source.make(), episode, rule).of
    detections: list[Detections] = []
    truths: list[Truth] = []
    parked: set[int] = set()
    for _, truth in sensed(episode):
        truths.append(without_sources(truth))
        parked |= parked_owners(truth)
        detections.append(make(truth))
    _refuse_empty(truths)
    return EpisodeDetections(
        tuple(detections),
        tuple(truths),
        CallTimes.zero(len(truths)),
        parked_centres(episode, parked),
        np.zeros(len(truths)),
    )


def _detected(source: Spec, episode: Episode, options: RunOptions) -> EpisodeDetections:
    """Run a detector; every answer is filed under the frame whose stamp it has."""
    parked: set[int] = set()
    stamps_s: list[float] = []
    columns: set[int] = set()

    def ticks() -> Any:
        for frame, truth in sensed(episode):
            parked.update(parked_owners(truth))
            yield CallInput((frame,), without_sources(truth))

    def check(answer: Any, tick: CallInput[Truth]) -> Detections:
        stamps_s.append(tick.context.stamp_s)
        detections = check_detections(answer, stamps_s=stamps_s)
        check_masses(detections.masses, columns)
        return detections

    replies = run_plugin(source, DETECTOR, ticks(), check, options=options)
    truths = replies.contexts
    _refuse_empty(truths)
    answers = [answer for answer in replies.answers if answer is not None]
    rows = _frames_answered(source, answers, truths)
    detections = [Detections.empty(truth.stamp_s, "world") for truth in truths]
    delays_s = np.full(len(truths), np.nan)
    for now, row in enumerate(rows):
        if row is not None:
            detections[row] = _in_world(answers[now], truths[row])
            delays_s[row] = truths[now].stamp_s - truths[row].stamp_s
    return EpisodeDetections(
        tuple(detections), truths, replies.times, parked_centres(episode, parked), delays_s
    )


def _frames_answered(
    source: Spec, answers: Sequence[Detections], truths: Sequence[Truth]
) -> list[int | None]:
    """Return the frame that each answer is filed under; None: another answer takes its place.

    An empty answer leaves its frame open: a detector that answers late has none to give yet. A
    second answer to a frame that has detections is refused.
    """
    rows: list[int | None] = []
    filed: dict[int, int] = {}
    for now, answer in enumerate(answers):
        row = next(k for k in range(now, -1, -1) if same_stamp(answer.stamp_s, truths[k].stamp_s))
        before = filed.get(row)
        if before is not None and len(answers[before]):
            raise PluginError(
                str(source),
                f"two answers to the frame at {truths[row].stamp_s:.6g} s, the second in the "
                f"frame at {truths[now].stamp_s:.6g} s",
            )
        if before is not None:
            rows[before] = None
        filed[row] = now
        rows.append(row)
    return rows


def _in_world(detections: Detections, truth: Truth) -> Detections:
    if detections.frame == "world":
        return detections
    return detections.moved(truth.world_from_ego, "world")


def _refuse_empty(truths: Sequence[Truth]) -> None:
    if not truths:
        raise ValueError("the episode is shorter than one sweep of the LiDAR")
