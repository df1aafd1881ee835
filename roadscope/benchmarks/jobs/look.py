"""Runs camera detectors over an episode's images; only the plug-in's own call is timed."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from operator import methodcaller
from typing import TYPE_CHECKING, Any

import numpy as np

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.stack import STAMP_TOLERANCE_S, EntryError, guarded, timed
from roadscope.benchmarks.metrics.image_labels import Labels, labels_of
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES, LIT, NoisyCamera
from roadscope.benchmarks.oracle import ORACLE
from roadscope.benchmarks.perceived import without_sources
from roadscope.benchmarks.seen import Seen, nothing_seen
from roadscope.core import ImageDetections
from roadscope.core.registry import split_spec
from roadscope.detectors.camera import CAMERA_DETECTORS

if TYPE_CHECKING:
    from roadscope.benchmarks.images import Picture

Look = Callable[["Picture"], tuple[ImageDetections, float]]
"""Returns what is found in an image and how many milliseconds that took."""
_WARM: set[str] = set()
"""Specs of our detectors that were called in this process."""


def drawn_from_truth(detector: str) -> bool:
    """Say whether a spec names no plug-in but the oracle or an imitation."""
    return detector == ORACLE or split_spec(detector)[0] in CAMERA_NOISES


def look(detector: str, episode: Episode, every_s: float, *, scans: bool = False) -> Seen:
    """Run a camera detector, the oracle or an imitation over an episode's images.

    every_s: from one image that is looked at to the next; scans: images are the nearest ones to
    scans so far apart, by the stamps that a user sees. An image that is missing has no
    detections and costs nothing.
    """
    from roadscope.benchmarks.images import image_rows, image_rows_of_scans, pictures

    rows = tuple(image_rows_of_scans(episode, every_s) if scans else image_rows(episode, every_s))
    seeing = seer(detector, episode)
    found, truths, parked, calls_ms = [], [], [], []
    for picture in pictures(episode, rows, pixels=not drawn_from_truth(detector)):
        there = picture.frame.camera is not None
        answer, took_ms = seeing(picture) if there else (None, 0.0)
        found.append(answer)
        truths.append(without_sources(picture.truth, image=True))
        parked.append(picture.parked)
        calls_ms.append(took_ms)
    return Seen(
        tuple(found), tuple(truths), tuple(parked), np.array(calls_ms), np.array(rows, np.int64)
    )


def air_of(episode: Episode) -> float:
    """Return how much light the air of an episode takes, per metre."""
    from roadscope.envs.sensors.weather import weather

    for fault in episode.faults:
        kind, _, severity = fault.partition(":")
        if kind in ("fog", "rain"):
            return weather(f"{kind}-{severity}").extinction_per_m
    return weather(episode.weather).extinction_per_m


def at_night(episode: Episode) -> bool:
    """Say whether an episode is dark."""
    return episode.light == "night" or any(f.startswith("night:") for f in episode.faults)


def lit_share(episode: Episode) -> float:
    """Return the share of what a camera finds by day that night and glare leave it."""
    faults = [fault.partition(":") for fault in episode.faults]
    return math.prod(LIT[kind][int(severity) - 1] for kind, _, severity in faults if kind in LIT)


def oracle_in_image(labels: Labels, stamp_s: float) -> ImageDetections:
    """Return the true boxes of all that is asked for."""
    rows = np.flatnonzero(labels.asked)
    return ImageDetections(
        labels.boxes[rows], labels.categories[rows].astype(np.int8), np.ones(len(rows)), stamp_s
    )


def seer(detector: str, episode: Episode) -> Look:
    """Return what looks at an episode's images one by one, from the first on."""
    if drawn_from_truth(detector):
        return _imitated(detector, episode)
    plugin = guarded(detector, lambda: CAMERA_DETECTORS.make(detector))
    guarded(detector, methodcaller("reset"), plugin)
    ours = CAMERA_DETECTORS.resolve(detector).ours

    def seeing(picture: Picture) -> tuple[ImageDetections, float]:
        with warnings.catch_warnings():
            # That a failing camera's images are black is what the board is about.
            warnings.simplefilter("ignore")
            if ours and detector not in _WARM:
                guarded(detector, plugin.detect, picture.frame)
                _WARM.add(detector)
            answer, took_ms = timed(detector, methodcaller("detect", picture.frame), plugin)
        return checked(detector, answer, picture.frame.stamp_s), took_ms

    return seeing


def _imitated(detector: str, episode: Episode) -> Look:
    from roadscope.benchmarks.images import camera_of
    from roadscope.envs.sensors.rigs import rig

    pinhole = camera_of(rig(episode.rig)).spec.pinhole
    air = air_of(episode)
    if detector == ORACLE:
        return lambda p: (
            oracle_in_image(labels_of(p.truth, p.parked).in_air(air), p.frame.stamp_s), 0.0
        )  # fmt: skip
    camera = NoisyCamera(
        CAMERA_NOISES.make(detector), episode.seed, extinction_per_m=air,
        night=at_night(episode), lit=lit_share(episode),
    )  # fmt: skip

    def seeing(picture: Picture) -> tuple[ImageDetections, float]:
        found = camera.of(picture.truth, pinhole)
        image = picture.frame.camera
        if image is not None and image.blank:
            return nothing_seen(picture.frame.stamp_s), 0.0
        return _stamped(found, picture.frame.stamp_s), 0.0

    return seeing


def _stamped(found: ImageDetections, stamp_s: float) -> ImageDetections:
    return replace(found, stamp_s=stamp_s)


def checked(spec: str, answer: Any, stamp_s: float) -> ImageDetections:
    """Refuse what is no answer to an image at a stamp."""
    if not isinstance(answer, ImageDetections):
        raise EntryError(f"{spec}: detect returned {type(answer).__name__}, not ImageDetections")
    if not abs(answer.stamp_s - stamp_s) <= STAMP_TOLERANCE_S:
        raise EntryError(
            f"{spec}: detections are stamped {round(answer.stamp_s, 6)} s, their image is at "
            f"{round(stamp_s, 6)} s"
        )
    sound = np.isfinite(answer.boxes).all() and (answer.boxes[:, 2:] >= answer.boxes[:, :2]).all()
    if not sound:
        raise EntryError(f"{spec}: boxes must be finite, left top right bottom, in pixels")
    if not ((answer.scores >= 0) & (answer.scores <= 1)).all():
        raise EntryError(f"{spec}: scores must lie in 0 to 1")
    return answer
