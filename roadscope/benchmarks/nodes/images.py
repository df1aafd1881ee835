"""Detections in images: of a camera detector, or made from truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.graph import Node
from roadscope.benchmarks.images import (
    camera_of,
    image_rows,
    image_rows_of_scans,
    pictures,
)
from roadscope.benchmarks.kinds import CAMERA_DETECTOR
from roadscope.benchmarks.loop import CallInput, RunOptions, run_plugin
from roadscope.benchmarks.metrics.image_labels import Labels, ParkedBoxes, labels_of
from roadscope.benchmarks.nodes.traffic import TrafficNode
from roadscope.benchmarks.noisy_camera import LIT, NoisyCamera
from roadscope.benchmarks.records import (
    CallTimes,
    EpisodeImageDetections,
    without_sources,
)
from roadscope.benchmarks.references import made_from_truth
from roadscope.core import ImageDetections, Spec, Truth
from roadscope.core.answers import check_image_detections, check_masses
from roadscope.core.spec import ORACLE
from roadscope.envs.sensors.rigs import rig
from roadscope.envs.sensors.weathers import weather

if TYPE_CHECKING:
    from roadscope.benchmarks.images import Picture

PictureDetector = Callable[["Picture"], ImageDetections]


@dataclass(frozen=True)
class ImageNode(Node):
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

    def sources(self) -> tuple[Node, ...]:
        """Return the traffic."""
        return (TrafficNode.of(self.episode),)

    def compute(self, options: RunOptions) -> EpisodeImageDetections:
        """Run the detector over the images; a missing image has no detections."""
        rows = self.image_rows()
        contexts: Sequence[_ImageTruth]
        detections: tuple[ImageDetections | None, ...]
        if made_from_truth(self.source):
            detect = self.from_truth()
            without_pixels = list(self.pictures(rows, pixels=False))
            contexts = [_ImageTruth.of(picture) for picture in without_pixels]
            detections = tuple(
                None if p.frame.camera is None else detect(p) for p in without_pixels
            )
            times = CallTimes.zero(len(rows))
        else:
            inputs = _inputs(self.pictures(rows))
            check = partial(_check, set())
            replies = run_plugin(self.source, CAMERA_DETECTOR, inputs, check, options=options)
            contexts, detections, times = replies.contexts, replies.answers, replies.times
        truths = tuple(context.truth for context in contexts)
        parked = tuple(context.parked for context in contexts)
        return EpisodeImageDetections(detections, truths, parked, times, np.array(rows, np.int64))

    def image_rows(self) -> tuple[int, ...]:
        """Return the numbers of the images that are used."""
        choose = image_rows_of_scans if self.of_scans else image_rows
        return tuple(choose(self.episode, self.every_s))

    def pictures(self, rows: tuple[int, ...], *, pixels: bool = True) -> Iterable[Picture]:
        """Return images by number, with their truth. pixels: whether they are needed."""
        return pictures(self.episode, rows, pixels=pixels)

    def from_truth(self) -> PictureDetector:
        """Return a function that makes the detections of consecutive images from their truth."""
        return image_detections_from_truth(self.source, self.episode)


def detect_in_picture(source: Spec, episode: Episode, picture: Picture) -> ImageDetections:
    """Return the detections of a camera detector, the oracle or a noise model in one image."""
    if made_from_truth(source):
        return image_detections_from_truth(source, episode)(picture)
    replies = run_plugin(source, CAMERA_DETECTOR, _inputs([picture]), partial(_check, set()))
    (detections,) = replies.answers
    assert detections is not None
    return detections


def _check(columns: set[int], answer: Any, call_input: CallInput[_ImageTruth]) -> ImageDetections:
    """Return the checked answer. columns: as of `check_masses`."""
    detections = check_image_detections(answer, stamp_s=call_input.context.stamp_s)
    check_masses(detections.masses, columns)
    return detections


@dataclass(frozen=True, slots=True)
class _ImageTruth:
    """The truth of an image, and the stamp that a user gets."""

    truth: Truth
    parked: ParkedBoxes
    stamp_s: float

    @staticmethod
    def of(picture: Picture) -> _ImageTruth:
        truth = without_sources(picture.truth, image=True)
        return _ImageTruth(truth, picture.parked, picture.frame.stamp_s)


def _inputs(images: Iterable[Picture]) -> Iterator[CallInput[_ImageTruth]]:
    for picture in images:
        has_image = picture.frame.camera is not None
        yield CallInput((picture.frame,), _ImageTruth.of(picture), call=has_image)


def image_detections_from_truth(source: Spec, episode: Episode) -> PictureDetector:
    """Return a function that makes the detections of consecutive images from their truth."""
    air = extinction_per_m(episode)
    if source.kind == ORACLE:
        return lambda p: oracle_in_image(labels_of(p.truth, p.parked).in_air(air), p.frame.stamp_s)
    pinhole = camera_of(rig(episode.rig)).spec.pinhole
    camera = NoisyCamera(
        source.make(),
        episode.seed,
        extinction_per_m=air,
        night=is_dark(episode),
        lit=lit_share(episode),
    )

    def detect(picture: Picture) -> ImageDetections:
        detections = camera.of(picture.truth, pinhole)
        image = picture.frame.camera
        if image is not None and image.blank:
            return ImageDetections.empty(picture.frame.stamp_s)
        return replace(detections, stamp_s=picture.frame.stamp_s)

    return detect


def extinction_per_m(episode: Episode) -> float:
    """Return the extinction coefficient of the air of an episode, 1/m."""
    for fault in episode.faults:
        kind, _, severity = fault.partition(":")
        if kind in ("fog", "rain"):
            return weather(f"{kind}-{severity}").extinction_per_m
    return weather(episode.weather).extinction_per_m


def is_dark(episode: Episode) -> bool:
    """Return whether an episode is at night."""
    return episode.light == "night" or any(f.startswith("night:") for f in episode.faults)


def lit_share(episode: Episode) -> float:
    """Return the factor by which night and glare lower a noise model's chance of detection."""
    faults = [fault.partition(":") for fault in episode.faults]
    return math.prod(LIT[kind][int(severity) - 1] for kind, _, severity in faults if kind in LIT)


def oracle_in_image(labels: Labels, stamp_s: float) -> ImageDetections:
    """Return the true boxes of all eligible objects."""
    rows = np.flatnonzero(labels.eligible)
    return ImageDetections(
        labels.boxes[rows], labels.categories[rows].astype(np.int8), np.ones(len(rows)), stamp_s
    )
