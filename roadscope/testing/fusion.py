"""The promises of fusions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from roadscope.benchmarks.boards.fusion import PASSED_ON
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.kinds import FUSION
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.fusion import fusion_scores
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.nodes.fusions import FusionNode
from roadscope.benchmarks.nodes.images import ImageNode
from roadscope.benchmarks.references import (
    CAMERA_ALONE,
    LIDAR_ALONE,
    detection_source,
    image_source,
)
from roadscope.core import Category, Detections, ImageDetections, Pose, Spec
from roadscope.core.answers import check_fused
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.fusion.overlap import projected_boxes
from roadscope.testing.shared import figure_in_words, input_promise, memory_promises, start_promises
from roadscope.testing.subject import Instance, Promise, PromiseError, Subject

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Axes of a camera that looks ahead, in the ego frame."""
PROJECTION = Projection.of(
    np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]),
    Pose.from_parts(OPTICAL, np.array([0.0, 0.0, 1.4])),
    640,
    480,
)
SCAN_S, IMAGE_S = 2.0, 2.02
"""Stamps of the scan and of the image."""
CENTRES = np.array([[12.0, 1.0, 0.8], [20.0, -4.0, 0.85], [28.0, 5.0, 0.8], [15.0, 3.5, 0.85]])
SIZES = np.array([[4.4, 1.8, 1.6], [0.5, 0.6, 1.7], [4.4, 1.8, 1.6], [1.8, 0.6, 1.7]])
OTHER_M = 6.0
"""How much further ahead all objects are in the scene before a reset, which has to be forgotten."""
CATEGORIES = np.array([Category.CAR, Category.PEDESTRIAN, Category.CAR, Category.CYCLIST], np.int8)
SCENE, EVERY_S = Episode("street", 0, "wide", 2.0), 0.2
"""Traffic, one of the training seeds, sensors, seconds; and the seconds from scan to scan."""
LIDAR, CAMERA = "noisy-misses", "noisy-camera"
"""Detectors whose detections are fused in the scene: noise models, which are fast."""
REFERENCE = "consistent"
SHARE_OF_BETTER_SENSOR = 0.45
"""A fusion with a smaller share of the better sensor's average precision is broken.

Chosen by hand: `lidar-first`, which leaves out whatever the LiDAR does not detect, has 0.49 of it.
"""


@dataclass(frozen=True, slots=True)
class FusionInput:
    """The detections of both sensors, None for one without measurement."""

    lidar: Detections | None
    camera: ImageDetections | None


@lru_cache(maxsize=2)
def of_both_sensors(further_m: float = 0.0) -> FusionInput:
    """Return two cars, a cyclist and a pedestrian as both sensors detect them.

    further_m: how much further ahead they are than at `CENTRES`.
    """
    centres = CENTRES + np.array([further_m, 0.0, 0.0])
    lidar = Detections(centres, SIZES, np.zeros(4), CATEGORIES, np.full(4, 0.8), "ego", SCAN_S)
    boxes, _ = projected_boxes(lidar, PROJECTION)
    return FusionInput(lidar, ImageDetections(boxes, CATEGORIES, np.full(4, 0.9), IMAGE_S))


@lru_cache(maxsize=2)
def moments(further_m: float = 0.0) -> tuple[FusionInput, ...]:
    """Return all cases: both sensors, one of them, and either or both without detections."""
    lidar, camera = of_both_sensors(further_m).lidar, of_both_sensors(further_m).camera
    no_lidar, no_camera = Detections.empty(SCAN_S), ImageDetections.empty(IMAGE_S)
    return (
        of_both_sensors(further_m),
        FusionInput(lidar, None),
        FusionInput(None, camera),
        FusionInput(no_lidar, camera),
        FusionInput(lidar, no_camera),
        FusionInput(no_lidar, no_camera),
    )


def fuse(instance: Instance, moment: FusionInput) -> FusedDetections:
    """Return the targets of a moment."""
    answer = instance.call("fuse", moment.lidar, moment.camera, PROJECTION)
    return check_fused(answer, stamp_s=SCAN_S if moment.lidar is not None else IMAGE_S)


def fuse_all(instance: Instance, further_m: float = 0.0) -> list[FusedDetections]:
    """Return the targets of all moments."""
    return [fuse(instance, moment) for moment in moments(further_m)]


def answers(subject: Subject) -> str:
    """Fuse a moment at which both sensors detect the same four."""
    with subject.started() as instance:
        targets = fuse(instance, of_both_sensors())
    of_both = int((targets.by_lidar & targets.by_camera).sum())
    return f"{len(targets)} targets of 4, {of_both} of both sensors"


def one_sensor(subject: Subject) -> str:
    """Refuse targets of a sensor that has no detections."""
    with subject.started() as instance:
        for moment in moments():
            targets = fuse(instance, moment)
            if not len(moment.lidar or ()) and targets.by_lidar.any():
                raise PromiseError("targets of the LiDAR, which has no detections")
            if not len(moment.camera or ()) and targets.by_camera.any():
                raise PromiseError("targets of the camera, which has no detections")
            if not len(moment.lidar or ()) and not len(moment.camera or ()) and len(targets):
                raise PromiseError(f"{len(targets)} targets, and neither sensor has detections")
    return ""


def order(subject: Subject) -> str:
    """Refuse a fusion whose targets depend on the order of detections."""
    lidar, camera = of_both_sensors().lidar, of_both_sensors().camera
    assert lidar is not None
    assert camera is not None
    backwards = np.arange(len(lidar))[::-1]
    reordered = FusionInput(
        lidar.select(backwards),
        ImageDetections(
            camera.boxes[backwards],
            camera.categories[backwards],
            camera.scores[backwards],
            camera.stamp_s,
        ),
    )
    distances = []
    for moment in (of_both_sensors(), reordered):
        with subject.started() as instance:
            distances.append(np.sort(fuse(instance, moment).distances_m))
    one, other = distances
    if len(one) != len(other) or not np.allclose(one, other):
        raise PromiseError("the same detections in another order give other targets")
    return ""


def compare(subject: Subject) -> str:
    """Fuse two seconds of a street; refuse a fusion much worse than the better sensor alone."""
    precision = _average_precision(subject.spec, subject.options)
    beside = _standards()
    words = figure_in_words("average precision in a street", precision, beside=beside)
    if precision < SHARE_OF_BETTER_SENSOR * max(beside[LIDAR_ALONE], beside[CAMERA_ALONE]):
        raise PromiseError(f"{words}: it detects much less than one sensor alone")
    return words


@cache
def _standards() -> dict[str, float]:
    """Return the average precision of `REFERENCE` and of each sensor alone."""
    passed_on, options = FUSION.registry.resolve(PASSED_ON), RunOptions()
    return {
        REFERENCE: _average_precision(FUSION.registry.resolve(REFERENCE), options),
        LIDAR_ALONE: _average_precision(passed_on, options, alone=LIDAR_ALONE),
        CAMERA_ALONE: _average_precision(passed_on, options, alone=CAMERA_ALONE),
    }


def _average_precision(spec: Spec, options: RunOptions, *, alone: str = "") -> float:
    node = FusionNode(
        DetectionNode(detection_source(LIDAR), SCENE, Eligibility()),
        ImageNode(image_source(CAMERA), SCENE, EVERY_S, of_scans=True),
        spec,
        every_s=EVERY_S,
        alone=alone,
    )
    fusions = node.compute(options)
    precision = fusion_scores(fusions.fused, fusions.targets)["ap"].value
    return float(np.nan_to_num(precision))


PROMISES = (
    *start_promises("fuse", "lidar, camera, projection"),
    Promise("answers with targets of the moment", answers),
    Promise("goes on with one sensor, and finds nothing where neither detects", one_sensor),
    input_promise(fuse_all),
    *memory_promises(
        fuse_all,
        lambda instance: fuse_all(instance, OTHER_M),
        inputs="detections",
        answers="targets",
    ),
    Promise("does not depend on the order of detections", order),
    Promise("fuses two seconds of a street", compare),
)
