"""The promises of LiDAR detectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from roadscope.benchmarks.boards.detection import detection_scores
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.records import EpisodeDetections
from roadscope.benchmarks.references import ONE_CLUSTER, detection_source
from roadscope.core import Detections, Frame, Spec
from roadscope.core.answers import check_detections
from roadscope.testing.shared import figure_in_words, input_promise, memory_promises, start_promises
from roadscope.testing.subject import Instance, Promise, PromiseError, Subject

SCENE = Episode("motorway", 0, "lux", 2.0)
"""Traffic, one of the training seeds, sensors, seconds."""
OTHER_SCENE = Episode("roundabout", 1, "lux", 1.0)
"""What a detector gets before a reset, and has to forget."""
RULE = Eligibility()
REFERENCE = "distance-l-shape"
SHARE_OF_ONE_CLUSTER = 0.5
"""A detector with a smaller share of the lower mark's detection rate is broken.

Chosen by hand: the mark, one box around everything, has 0.24, our detectors have 0.7 and more.
"""
WATCHED_FRAMES = 8
"""Frames of the scene whose arrays are compared before and after a call; chosen by hand, for
speed."""


@lru_cache(maxsize=2)
def frames(scene: Episode = SCENE) -> tuple[Frame, ...]:
    """Return the frames of a scene."""
    return tuple(frame for frame, _ in sensed(scene))


def detect(instance: Instance, consecutive: Sequence[Frame]) -> list[Detections]:
    """Return the detections of consecutive frames."""
    stamps_s: list[float] = []
    answers = []
    for frame in consecutive:
        stamps_s.append(frame.stamp_s)
        answers.append(check_detections(instance.call("detect", frame), stamps_s=stamps_s))
    return answers


def detect_scene(instance: Instance) -> list[Detections]:
    """Return the detections of the scene."""
    return detect(instance, frames())


def answers(subject: Subject) -> str:
    """Run it over the scene, and have every answer checked."""
    with subject.started() as instance:
        count = sum(map(len, detect_scene(instance)))
    return f"{count / len(frames()):.1f} boxes a frame"


def nothing_to_detect(subject: Subject) -> str:
    """Refuse detections in a first frame without scan or returns; the next frames must work."""
    first, *others = frames()
    scan = first.lidar
    assert scan is not None
    for poor in (replace(first, lidar=None), replace(first, lidar=scan.select(np.empty(0, int)))):
        with subject.started() as instance:
            detections = detect(instance, [poor, *others[:3], replace(others[3], lidar=None)])
        if len(detections[0]):
            raise PromiseError(f"{len(detections[0])} detections in a frame without returns")
    return ""


def compare(subject: Subject) -> str:
    """Detect two seconds of traffic; refuse a detector that finds hardly any car."""
    detections = DetectionNode(subject.spec, SCENE, RULE).compute(subject.options)
    rate = _detection_rate(detections)
    beside = {name: _rate_of(name) for name in (REFERENCE, ONE_CLUSTER)}
    words = figure_in_words("detection rate on a motorway", rate, beside=beside)
    if rate < SHARE_OF_ONE_CLUSTER * beside[ONE_CLUSTER]:
        count = sum(map(len, detections.detections))
        raise PromiseError(
            f"{words}: {count} boxes in two seconds full of cars, hardly any on a car; centres are "
            "metres in the frame that is named: 'ego', x ahead and y to the left, or 'world'"
        )
    return words


@lru_cache(maxsize=2)
def _rate_of(name: str) -> float:
    node = DetectionNode(detection_source(Spec.parse(name)), SCENE, RULE)
    return _detection_rate(node.compute(RunOptions()))


def _detection_rate(detections: EpisodeDetections) -> float:
    rate = detection_scores(detections, RULE, timed=False)["detection_rate"].value
    return float(np.nan_to_num(rate))


PROMISES = (
    *start_promises("detect", "frame"),
    Promise("answers with detections of a frame that it got", answers),
    Promise("goes on where a scan is missing or empty", nothing_to_detect),
    input_promise(lambda instance: detect(instance, frames()[:WATCHED_FRAMES])),
    *memory_promises(
        detect_scene,
        lambda instance: detect(instance, frames(OTHER_SCENE)),
        inputs="frames",
        answers="detections",
    ),
    Promise("detects two seconds of traffic", compare),
)
