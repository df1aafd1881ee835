"""Moments of both sensors with what was to be found in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.episode import Episode, timeline_of
from roadscope.benchmarks.metrics.fusion import FARTHEST_M, Targets
from roadscope.benchmarks.noisy_camera import FAMILY, CameraNoise, NoisyCamera
from roadscope.benchmarks.parked import parked_among
from roadscope.core import Detections, Frame, ImageDetections, Truth
from roadscope.core.projection import Projection
from roadscope.detectors import Detector
from roadscope.envs.imaging.raster import rasterise, solids_of
from roadscope.envs.sensors.camera import image_truth
from roadscope.envs.sensors.rigs import rig
from roadscope.envs.sensors.sensing import IMAGE_RANGE_M, Sensing, truth_of_image
from roadscope.envs.traffic.timeline import Timeline
from roadscope.fusion.overlap import projected_boxes
from roadscope.fusion.pairing import ALONE, moved_projection, nearest_images

NEAREST_M = 3.0
LEAST_RETURNS, LEAST_PIXELS, LEAST_HEIGHT_PX = 5, 60, 12.0
MOST_HIDDEN = 0.9


@dataclass(frozen=True, slots=True)
class Moment:
    """A scan and the image nearest in time, None where there is none within the limit.

    truth: of the scan. projection: from the ego frame at the scan into the image.
    """

    scan: Frame
    truth: Truth
    camera: ImageDetections | None
    targets: Targets
    projection: Projection


class _WithoutPixels(Sensing):
    """Images are not drawn; what is in them is found as ever."""

    def sense_image(self, timeline: Timeline, index: int) -> tuple[Frame, Truth]:
        """Return the truth of one image and a frame without it."""
        mount = self.rig.camera
        assert mount is not None
        stamp_s = mount.stamp_s(index)
        scene, poses = self._place(timeline, np.array([stamp_s]), IMAGE_RANGE_M)
        solids = solids_of(scene, stamp_s)
        raster = rasterise(scene, mount.spec.pinhole, poses[0] @ mount.ego_from_camera, stamp_s,
                           outlines=True, solids=solids)  # fmt: skip
        seen = image_truth(raster, solids, len(scene.present))
        return Frame(stamp_s, self.rig.calibration()), truth_of_image(timeline, stamp_s, seen)


def film(
    episode: Episode, *, every: int = 6, night: bool = False, noise: CameraNoise | None = None,
    detector: Detector | None = None,
) -> list[Moment]:  # fmt: skip
    """Sense every n-th scan of an episode and the image nearest in time.

    detector: of images, which are drawn for it, always by day; None: the imitation of one, with
    its errors in `noise`, by day or by night.
    """
    if detector is not None and (night or noise is not None):
        raise ValueError("night and noise are of the imitation, and a detector was given")
    timeline, carrier = timeline_of(episode), rig(episode.rig)
    assert carrier.camera is not None
    kind = _WithoutPixels if detector is None else Sensing
    sensing = kind(carrier, episode.seed, weather=episode.weather)
    pinhole = carrier.camera.spec.pinhole
    projection = Projection.of(pinhole.intrinsics, carrier.camera.ego_from_camera, pinhole.width,
                               pinhole.height)  # fmt: skip
    last = timeline.end_s - 0.2
    scans = np.arange(every, int(last / carrier.lidar.spec.period_s), every)
    images = np.arange(1, int(last / carrier.camera.spec.period_s))
    scan_s = np.array([carrier.lidar.stamp_s(int(k)) for k in scans])
    image_s = np.array([carrier.camera.stamp_s(int(k)) for k in images])
    camera = NoisyCamera(noise or CameraNoise(), episode.seed, night=night,
                         extinction_per_m=sensing.weather.extinction_per_m)  # fmt: skip
    taken = []
    for scan, row in zip(scans, nearest_images(scan_s, image_s), strict=True):
        if row == ALONE:
            continue
        frame, truth = sensing.sense(timeline, int(scan))
        image, seen = sensing.sense_image(timeline, int(images[row]))
        boxes = (
            camera.of(seen, pinhole.width, pinhole.height)
            if detector is None
            else in_image(detector, image)
        )
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


def targets_of(
    truth: Truth, seen: Truth, parked: np.ndarray, projection: Projection
) -> Targets:  # fmt: skip
    """Join truth of a scan and of its image; (P, 2) parked cars come last, not eligible.

    To be found is who is in the image, 3 to 60 m away, and gave 5 returns or shows 60 pixels, 12
    high, and less than nine tenths hidden.
    """
    assert seen.image_boxes is not None
    rows = {int(k): i for i, k in enumerate(seen.ids)}
    both = np.array([k for k, i in enumerate(truth.ids.tolist()) if i in rows], np.int64)
    other = np.array([rows[int(truth.ids[k])] for k in both], np.int64)
    centres = truth.world_from_ego.inverse().apply(truth.centres[both])
    boxes = seen.image_boxes[other]
    sides = boxes[:, 2:] - boxes[:, :2]
    in_image = (sides > 3.0).all(axis=1)
    in_image &= seen.occluded_fraction[other] < MOST_HIDDEN
    shows = (seen.visible_pixels[other] >= LEAST_PIXELS) & (sides[:, 1] >= LEAST_HEIGHT_PX)
    returns = truth.lidar_returns[both] >= LEAST_RETURNS
    far = np.hypot(centres[:, 0], centres[:, 1])
    eligible = in_image & (shows | returns) & (far >= NEAREST_M) & (far <= FARTHEST_M)
    cars = truth.world_from_ego.inverse().apply(
        np.column_stack([parked, np.full(len(parked), 0.75)])
    )
    n = len(cars)
    car_boxes, _ = projected_boxes(
        Detections(cars, np.tile((4.4, 1.8, 1.5), (n, 1)), np.zeros(n), np.zeros(n, np.int8),
                   np.ones(n), "ego", truth.stamp_s), projection)  # fmt: skip
    return Targets(
        np.concatenate([FAMILY[truth.categories[both]], np.zeros(n, np.int64)]),
        np.concatenate([centres, cars]), np.concatenate([boxes, car_boxes]),
        np.concatenate([eligible, np.zeros(n, bool)]),
        np.concatenate([seen.occluded_fraction[other], np.zeros(n)]),
    )  # fmt: skip
