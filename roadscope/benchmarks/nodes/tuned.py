"""Trackers whose threshold of scores is chosen on training data.

`gnn?least_score=tuned` gets only detections whose score reaches a threshold; other arguments with
the value `tuned` get the threshold itself. It is the one with the highest HOTA on episodes that are
not ranked with it: train seeds of a suite, all other sequences of a folder. So trackers that do not
use scores are compared at their best.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.fingerprints import code_hash
from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.tracking.hota import Hota, hota
from roadscope.benchmarks.metrics.tracking.scores import counted_rows, counted_sequence
from roadscope.benchmarks.nodes.tracks import TrackNode
from roadscope.benchmarks.records import EpisodeDetections, EpisodeRecord, EpisodeTracks
from roadscope.core import Spec

if TYPE_CHECKING:
    from roadscope.benchmarks.recorded.recording import Recording

TUNED = "tuned"
"""The value of arguments that get the chosen threshold."""
LEAST_SCORE = "least_score"
"""The argument by which detections with low scores are left out; no tracker needs to have it."""
THRESHOLDS = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99)
"""Scores that are tried: round figures, denser where scores of trained detectors are."""


def is_tuned(tracker: Spec) -> bool:
    """Return whether a tracker's threshold of scores is to be chosen."""
    return TUNED in tracker.arguments.values()


def at_threshold(tracker: Spec, threshold: float) -> Spec:
    """Return a tracker's spec with a threshold in place of `tuned`; without `tuned`, unchanged."""
    if not is_tuned(tracker):
        return tracker
    arguments = {k: threshold if v == TUNED else v for k, v in tracker.arguments.items()}
    if tracker.arguments.get(LEAST_SCORE) == TUNED:
        del arguments[LEAST_SCORE]
    items = [f"{name}={value}" for name, value in arguments.items()]
    items += [f"ego={tracker.ego}"] if tracker.ego else []
    text = "?".join(filter(None, [tracker.name, "&".join(items)]))
    return replace(tracker, text=text, arguments=arguments)


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeHota(EpisodeRecord):
    """HOTA of an episode as a record that is kept as a file."""

    curves: Hota


@dataclass(frozen=True)
class HotaNode(Node):
    """HOTA of the tracks of an episode.

    judge: decides which objects and tracks count: a recording, or the rule of a suite.
    """

    tracks: TrackNode
    judge: Recording | Eligibility

    stage = "training scores"
    record = EpisodeHota

    def compute(self, options: RunOptions) -> EpisodeHota:
        """Score the tracks."""
        tracks = [record.sure for record in self.tracks.read(options).tracks]
        if isinstance(self.judge, Eligibility):
            inputs: EpisodeDetections = self.tracks.detections.read(options)
            pairings = self.judge.pairings(tracks, inputs.truths, inputs.parked)
            counted = counted_rows(pairings)
            curves = hota(counted_sequence(tracks, inputs.truths, pairings, counted))
        else:
            curves = hota(self.judge.counted(tracks))
        return EpisodeHota(curves)


def hota_nodes(ranked: TrackNode, judge: Recording | Eligibility) -> tuple[HotaNode, ...]:
    """Return HOTA at each threshold, of a tracker whose spec has `tuned`."""
    filters = ranked.tracker.arguments.get(LEAST_SCORE) == TUNED
    return tuple(
        HotaNode(
            replace(
                ranked,
                tracker=at_threshold(ranked.tracker, threshold),
                least_score=threshold if filters else ranked.least_score,
            ),
            judge,
        )
        for threshold in THRESHOLDS
    )


@dataclass(frozen=True)
class TunedNode(Node):
    """The tracks at the threshold that is best in training.

    candidates: the tracks at each threshold.
    training: of each episode of training, HOTA at each threshold.
    """

    candidates: tuple[TrackNode, ...]
    training: tuple[tuple[HotaNode, ...], ...]

    stage = "tracks"
    folder = "tracks"
    record = EpisodeTracks

    @property
    def detections(self) -> Node:
        """The node of the detections."""
        return self.candidates[0].detections

    @property
    def tracker(self) -> Spec:
        """The tracker at the lowest threshold."""
        return self.candidates[0].tracker

    def sources(self) -> tuple[Node, ...]:
        """Return the sources of the tracks and the scores in training."""
        return (*self.candidates[0].sources(), *self._scores)

    @property
    def _scores(self) -> tuple[HotaNode, ...]:
        return tuple(node for nodes in self.training for node in nodes)

    def content(self) -> dict[str, object]:
        """Return what the tracks depend on."""
        ego = self.candidates[0].ego
        return {
            "code": code_hash(__name__),
            "detections": self.detections.content(),
            "ego": None if ego is None else ego.content(),
            "candidates": [node.key for node in self.candidates],
            "training": [node.key for node in self._scores],
        }

    def compute(self, options: RunOptions) -> EpisodeTracks:
        """Choose a threshold and track with it; the lowest if several are best."""
        curves = [
            sum((node.read(options).curves for node in nodes[1:]), nodes[0].read(options).curves)
            for nodes in zip(*self.training, strict=True)
        ]
        best = int(np.argmax([each.hota.mean() for each in curves]))
        return self.candidates[best].compute(options)
