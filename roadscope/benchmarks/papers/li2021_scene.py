"""Moments of both sensors with what was to be found in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.episode import Episode, sensing_of, timeline_of
from roadscope.benchmarks.images import sensing_without_pixels
from roadscope.benchmarks.metrics.fusion import FusionTargets
from roadscope.benchmarks.nodes.fusions import targets_of
from roadscope.benchmarks.nodes.images import is_dark, lit_share
from roadscope.benchmarks.noisy_camera import CameraNoise, NoisyCamera
from roadscope.benchmarks.parked import parked_among
from roadscope.core import Frame, ImageDetections, Truth
from roadscope.core.projection import Projection
from roadscope.detectors import Detector
from roadscope.envs.sensors.rigs import rig
from roadscope.fusion.pairing import ALONE, moved_projection, nearest_images


@dataclass(frozen=True, slots=True)
class Moment:
    """A scan and the image nearest in time, None where there is none within the limit.

    truth: of the scan. projection: from the ego frame at the scan into the image.
    """

    scan: Frame
    truth: Truth
    camera: ImageDetections | None
    targets: FusionTargets
    projection: Projection


def film(
    episode: Episode, *, every: int = 6, noise: CameraNoise | None = None,
    detector: Detector | None = None,
) -> list[Moment]:  # fmt: skip
    """Sense every n-th scan of an episode and the image nearest in time.

    detector: of images, which are drawn for it; None: the imitation of one, with its errors in
    `noise`.
    """
    if detector is not None and noise is not None:
        raise ValueError("noise is of the imitation, and a detector was given")
    timeline, carrier = timeline_of(episode), rig(episode.rig)
    assert carrier.camera is not None
    sensing = sensing_without_pixels(episode) if detector is None else sensing_of(episode)
    pinhole = carrier.camera.spec.pinhole
    projection = Projection.of(pinhole.intrinsics, carrier.camera.ego_from_camera, pinhole.width,
                               pinhole.height)  # fmt: skip
    last = timeline.end_s - 0.2
    scans = np.arange(every, int(last / carrier.lidar.spec.period_s), every)
    images = np.arange(1, int(last / carrier.camera.spec.period_s))
    scan_s = np.array([carrier.lidar.stamp_s(int(k)) for k in scans])
    image_s = np.array([carrier.camera.stamp_s(int(k)) for k in images])
    camera = NoisyCamera(noise or CameraNoise(), episode.seed, night=is_dark(episode),
                         lit=lit_share(episode),
                         extinction_per_m=sensing.weather.extinction_per_m)  # fmt: skip
    taken = []
    for scan, row in zip(scans, nearest_images(scan_s, image_s), strict=True):
        if row == ALONE:
            continue
        frame, truth = sensing.sense(timeline, int(scan))
        image, seen = sensing.sense_image(timeline, int(images[row]))
        boxes = camera.of(seen, pinhole) if detector is None else in_image(detector, image)
        gap_s = seen.stamp_s - truth.stamp_s
        moved = moved_projection(
            projection, frame.previous_from_ego, carrier.lidar.spec.period_s, gap_s
        )
        taken.append((frame, truth, seen, boxes, moved))
    parked = parked_among(episode, [truth for _, truth, *_ in taken])
    return [
        Moment(frame, truth, boxes, targets_of(truth, seen, parked, moved), moved)
        for frame, truth, seen, boxes, moved in taken
    ]


def in_image(detector: Detector, frame: Frame) -> ImageDetections:
    """Detect in an image; what finds boxes in space is refused."""
    found = detector.detect(frame)
    if not isinstance(found, ImageDetections):
        raise TypeError(f"{type(detector).__name__} finds no boxes in images")
    return found
