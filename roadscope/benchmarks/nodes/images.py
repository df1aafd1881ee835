"""Detections in images: of a camera detector, or made from truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from roadscope.benchmarks.episode import Episode, sensing_of
from roadscope.benchmarks.images import (
    Picture,
    camera_of,
    image_rows,
    image_rows_of_scans,
    pictures,
)
from roadscope.benchmarks.kinds import CAMERA_DETECTOR
from roadscope.benchmarks.loop import CallInput, Replies, RunOptions, run_plugin
from roadscope.benchmarks.metrics.image_labels import labels_of
from roadscope.benchmarks.nodes.traffic import SensingNode
from roadscope.benchmarks.noisy_camera import LIT, CameraNoise, NoisyCamera
from roadscope.benchmarks.records import CallTimes, EpisodeImageDetections, without_sources
from roadscope.benchmarks.references import made_from_truth
from roadscope.core import ImageDetections, Spec
from roadscope.core.spec import ORACLE
from roadscope.envs.sensors.rigs import rig


@dataclass(frozen=True)
class ImageNode(SensingNode):
    """The detections of a camera detector, the oracle or a noise model in images of an episode.

    every_s: seconds from one image that is used to the next.
    of_scans: use the images nearest in time to scans at these intervals, by the stamps that a user
        gets.
    """

    source: Spec
    episode: Episode
    every_s: float
    of_scans: bool = False

    stage = "images"
    folder = "image-detections"
    record = EpisodeImageDetections

    def compute(self, options: RunOptions) -> EpisodeImageDetections:
        """Run the detector over the images; a missing image has no detections."""
        rows = self.image_rows()
        shown: Sequence[Picture]
        detections: tuple[ImageDetections | None, ...]
        if made_from_truth(self.source):
            detect, shown = self.from_truth(), list(pictures(self.episode, rows, pixels=False))
            detections = tuple(None if p.frame.camera is None else detect(p) for p in shown)
            times = CallTimes.zero(len(rows))
        else:
            inputs = _inputs(pictures(self.episode, rows))
            replies: Replies[Picture, ImageDetections]
            replies = run_plugin(self.source, CAMERA_DETECTOR, inputs, options=options)
            shown, detections, times = replies.contexts, replies.answers, replies.times
        truths = tuple(without_sources(picture.truth, image=True) for picture in shown)
        parked = tuple(picture.parked for picture in shown)
        return EpisodeImageDetections(detections, truths, parked, times, np.array(rows, np.int64))

    def image_rows(self) -> tuple[int, ...]:
        """Return the numbers of the images that are used."""
        choose = image_rows_of_scans if self.of_scans else image_rows
        return tuple(choose(self.episode, self.every_s))

    def from_truth(self) -> Callable[[Picture], ImageDetections]:
        """Return a function that makes the detections of consecutive images from their truth."""
        if not self.episode.simulated:
            return _labelled_boxes
        if self.source.kind == ORACLE:
            air = extinction_per_m(self.episode)
            return lambda picture: _true_boxes(picture, air)
        pinhole = camera_of(rig(self.episode.rig)).spec.pinhole
        camera = noisy_camera(self.source.make(), self.episode)

        def detect(picture: Picture) -> ImageDetections:
            detections = camera.of(picture.truth, pinhole)
            image = picture.frame.camera
            if image is not None and image.blank:
                return ImageDetections.empty(picture.frame.stamp_s)
            return replace(detections, stamp_s=picture.frame.stamp_s)

        return detect


def _inputs(images: Iterable[Picture]) -> Iterator[CallInput[Picture]]:
    for picture in images:
        without_image = replace(picture, frame=replace(picture.frame, camera=None))
        has_image = picture.frame.camera is not None
        yield CallInput((picture.frame,), without_image, call=has_image)


def _labelled_boxes(picture: Picture) -> ImageDetections:
    """Return all labels of a recorded image as detections."""
    truth = picture.truth
    assert truth.image_boxes is not None
    return ImageDetections(truth.image_boxes, truth.categories, np.ones(len(truth)), truth.stamp_s)


def _true_boxes(picture: Picture, air_per_m: float) -> ImageDetections:
    """Return the true boxes of all eligible objects. air_per_m: extinction coefficient."""
    labels = labels_of(picture.truth, picture.parked).in_air(air_per_m)
    rows = np.flatnonzero(labels.eligible)
    categories = labels.categories[rows].astype(np.int8)
    return ImageDetections(
        labels.boxes[rows], categories, np.ones(len(rows)), picture.frame.stamp_s
    )


def noisy_camera(model: CameraNoise, episode: Episode) -> NoisyCamera:
    """Return a noise model in the air and the light of an episode."""
    return NoisyCamera(
        model,
        episode.seed,
        extinction_per_m=extinction_per_m(episode),
        night=episode.light == "night" or any(f.startswith("night:") for f in episode.faults),
        lit=lit_share(episode),
    )


def extinction_per_m(episode: Episode) -> float:
    """Return the extinction coefficient of the air of an episode, 1/m."""
    return sensing_of(episode).weather.extinction_per_m


def lit_share(episode: Episode) -> float:
    """Return the factor by which night and glare lower a noise model's chance of detection."""
    faults = [fault.partition(":") for fault in episode.faults]
    return math.prod(LIT[kind][int(severity) - 1] for kind, _, severity in faults if kind in LIT)
