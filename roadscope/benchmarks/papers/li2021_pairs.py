"""Scans of an episode, each with the image nearest in time and the targets that both should detect.

Scans and images are paired as in Li 2021 (section 3).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.episode import Episode, sensing_of, timeline_of
from roadscope.benchmarks.images import camera_of, projection_of, sensing_without_pixels
from roadscope.benchmarks.metrics.fusion import FusionTargets
from roadscope.benchmarks.nodes.fusions import targets_of
from roadscope.benchmarks.nodes.images import noisy_camera
from roadscope.benchmarks.noisy_camera import CameraNoise
from roadscope.benchmarks.parked import parked_among
from roadscope.core import Frame, ImageDetections, Truth
from roadscope.core.projection import Projection
from roadscope.detectors import Detector
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.rigs import rig
from roadscope.fusion.pairing import ALONE, moved_projection, nearest_images

UNUSED_END_S = 0.2
"""End of an episode without scans and images, so that all have states before and after them."""


@dataclass(frozen=True, slots=True)
class SensorPair:
    """A scan and the image nearest in time.

    scan: the frame of the scan. truth: of the scan. camera: detections in the image, None where
    there are none. projection: from the ego frame at the scan into the image.
    """

    scan: Frame
    truth: Truth
    camera: ImageDetections | None
    targets: FusionTargets
    projection: Projection


class _SensedPair(NamedTuple):
    scan: Frame
    truth: Truth
    image_truth: Truth
    camera: ImageDetections
    projection: Projection


def sense_pairs(
    episode: Episode, *, every: int = 6, detector: Detector | None = None
) -> list[SensorPair]:
    """Sense every n-th scan of an episode and the image nearest in time.

    A scan without an image within the limit is left out.

    detector: of images, which are drawn for it. None: detections are imitated from the truth, with
    the errors of `CameraNoise`.
    """
    sensed = list(_sensed_pairs(episode, every, detector))
    parked = parked_among(episode, [each.truth for each in sensed])
    return [
        SensorPair(
            each.scan,
            each.truth,
            each.camera,
            targets_of(each.truth, each.image_truth, parked, each.projection),
            each.projection,
        )
        for each in sensed
    ]


def _sensed_pairs(episode: Episode, every: int, detector: Detector | None) -> Iterator[_SensedPair]:
    timeline, sensors = timeline_of(episode), rig(episode.rig)
    pinhole, projection = camera_of(sensors).spec.pinhole, projection_of(sensors)
    sensing = sensing_without_pixels(episode) if detector is None else sensing_of(episode)
    imitation, period_s = noisy_camera(CameraNoise(), episode), sensors.lidar.spec.period_s
    for scan, image in _paired_numbers(sensors, timeline.end_s - UNUSED_END_S, every):
        frame, truth = sensing.sense(timeline, scan)
        picture, image_truth = sensing.sense_image(timeline, image)
        if detector is None:
            boxes = imitation.of(image_truth, pinhole)
        else:
            boxes = in_image(detector, picture)
        gap_s = image_truth.stamp_s - truth.stamp_s
        moved = moved_projection(projection, frame.previous_from_ego, period_s, gap_s)
        yield _SensedPair(frame, truth, image_truth, boxes, moved)


def _paired_numbers(sensors: Rig, end_s: float, every: int) -> Iterator[tuple[int, int]]:
    """Yield the numbers of every n-th scan and of the image nearest in time."""
    camera, lidar = camera_of(sensors), sensors.lidar
    scans = np.arange(every, int(end_s / lidar.spec.period_s), every)
    images = np.arange(1, int(end_s / camera.spec.period_s))
    scan_s = np.array([lidar.stamp_s(int(k)) for k in scans])
    image_s = np.array([camera.stamp_s(int(k)) for k in images])
    for scan, row in zip(scans, nearest_images(scan_s, image_s), strict=True):
        if row != ALONE:
            yield int(scan), int(images[row])


def in_image(detector: Detector, frame: Frame) -> ImageDetections:
    """Return a detector's boxes in an image; `TypeError` for a detector of boxes in space."""
    boxes = detector.detect(frame)
    if not isinstance(boxes, ImageDetections):
        raise TypeError(f"{type(detector).__name__} finds no boxes in images")
    return boxes
