"""Detections in images: a camera detector's, or those made from truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.fingerprint import package_version
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
from roadscope.envs.sensors.weather import weather

if TYPE_CHECKING:
    from roadscope.benchmarks.images import Picture

PictureDetector = Callable[["Picture"], ImageDetections]


@dataclass(frozen=True)
class ImageNode(Node):
    """The detections of a camera detector, the oracle or a noise model in images of an episode.

    every_s: seconds from one image that is used to the next.
    of_scans: use the images nearest to scans so far apart, by the stamps that a user gets.
    """

    source: Spec
    episode: Episode
    every_s: float
    of_scans: bool = False

    stage = "images"
    folder = "image-detections"
    record = EpisodeImageDetections

    def content(self) -> Mapping[str, Any]:
        """Return what the detections depend on, the library that runs networks too."""
        return {**super().content(), "torch": package_version("torch")}

    def sources(self) -> tuple[Node, ...]:
        """Return the traffic."""
        return (TrafficNode.of(self.episode),)

    def compute(self, options: RunOptions) -> EpisodeImageDetections:
        """Run the detector over the images; a missing image has no detections."""
        choose = image_rows_of_scans if self.of_scans else image_rows
        rows = tuple(choose(self.episode, self.every_s))
        if made_from_truth(self.source):
            return _from_truth(self.source, self.episode, rows)
        replies = run_plugin(
            self.source,
            CAMERA_DETECTOR,
            _ticks(pictures(self.episode, rows)),
            partial(_check, set()),
            options=options,
        )
        return EpisodeImageDetections(
            replies.answers,
            tuple(context.truth for context in replies.contexts),
            tuple(context.parked for context in replies.contexts),
            replies.times,
            np.array(rows, np.int64),
        )


def detect_in_picture(source: Spec, episode: Episode, picture: Picture) -> ImageDetections:
    """Return what a camera detector, the oracle or a noise model detects in one image."""
    if made_from_truth(source):
        return image_detections_from_truth(source, episode)(picture)
    replies = run_plugin(source, CAMERA_DETECTOR, _ticks(iter([picture])), partial(_check, set()))
    (detections,) = replies.answers
    assert detections is not None
    return detections


def _check(columns: set[int], answer: Any, tick: CallInput[_ImageTruth]) -> ImageDetections:
    """Return a checked answer; columns: those of the masses so far."""
    detections = check_image_detections(answer, stamp_s=tick.context.stamp_s)
    check_masses(detections.masses, columns)
    return detections


@dataclass(frozen=True, slots=True)
class _ImageTruth:
    """What is true of an image, and the stamp that a user gets."""

    truth: Truth
    parked: ParkedBoxes
    stamp_s: float


def _ticks(shown: Iterator[Picture]) -> Iterator[CallInput[_ImageTruth]]:
    for picture in shown:
        context = _ImageTruth(
            without_sources(picture.truth, image=True), picture.parked, picture.frame.stamp_s
        )
        yield CallInput((picture.frame,), context, call=picture.frame.camera is not None)


def _from_truth(source: Spec, episode: Episode, rows: tuple[int, ...]) -> EpisodeImageDetections:
    """Make detections from the truth of every image."""
    detect = image_detections_from_truth(source, episode)
    detections: list[ImageDetections | None] = []
    truths: list[Truth] = []
    parked: list[ParkedBoxes] = []
    for picture in pictures(episode, rows, pixels=False):
        has_image = picture.frame.camera is not None
        detections.append(detect(picture) if has_image else None)
        truths.append(without_sources(picture.truth, image=True))
        parked.append(picture.parked)
    return EpisodeImageDetections(
        tuple(detections),
        tuple(truths),
        tuple(parked),
        CallTimes.zero(len(rows)),
        np.array(rows, np.int64),
    )


def image_detections_from_truth(source: Spec, episode: Episode) -> PictureDetector:
    """Return what makes detections from truth, one image of an episode after the other."""
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
    """Return how much light the air of an episode takes, 1/m."""
    for fault in episode.faults:
        kind, _, severity = fault.partition(":")
        if kind in ("fog", "rain"):
            return weather(f"{kind}-{severity}").extinction_per_m
    return weather(episode.weather).extinction_per_m


def is_dark(episode: Episode) -> bool:
    """Return whether an episode is at night."""
    return episode.light == "night" or any(f.startswith("night:") for f in episode.faults)


def lit_share(episode: Episode) -> float:
    """Return the share of what a camera detects by day that night and glare leave it."""
    faults = [fault.partition(":") for fault in episode.faults]
    return math.prod(LIT[kind][int(severity) - 1] for kind, _, severity in faults if kind in LIT)


def oracle_in_image(labels: Labels, stamp_s: float) -> ImageDetections:
    """Return the true boxes of all that is to be found."""
    rows = np.flatnonzero(labels.asked)
    return ImageDetections(
        labels.boxes[rows], labels.categories[rows].astype(np.int8), np.ones(len(rows)), stamp_s
    )
