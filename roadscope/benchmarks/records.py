"""Records of a plug-in's answers over an episode with the truth, which are kept as files."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, BinaryIO, Self

import msgspec
import numpy as np

from roadscope.benchmarks.metrics.fusion import FusionTargets
from roadscope.benchmarks.metrics.image_labels import Labels, ParkedBoxes, labels_of
from roadscope.benchmarks.metrics.trajectory_errors import Trajectories
from roadscope.core import Detections, ImageDetections, Tracks, Truth
from roadscope.core.fused import FusedDetections
from roadscope.core.record import Record
from roadscope.core.tables import ArrayTable


@dataclass(frozen=True, slots=True, eq=False)
class CallTimes(ArrayTable, Record):
    """The computing times of a plug-in, one value a call.

    processor_ms: (T,) float64, processor time of all threads of the plug-in's process.
    wall_ms: (T,) float64, time that passed.
    """

    processor_ms: np.ndarray
    wall_ms: np.ndarray

    @staticmethod
    def zero(calls: int) -> CallTimes:
        """Return times of 0, for answers that are made from truth."""
        return CallTimes(np.zeros(calls), np.zeros(calls))

    def __add__(self, other: CallTimes) -> CallTimes:
        return CallTimes(self.processor_ms + other.processor_ms, self.wall_ms + other.wall_ms)

    def shifted(self, processor_ms: float, wall_ms: float) -> CallTimes:
        """Return the times with a constant added to each."""
        return CallTimes(self.processor_ms + processor_ms, self.wall_ms + wall_ms)


class EpisodeRecord(Record):
    """Base of the records of an episode, which are kept as files: compressed MessagePack."""

    __slots__ = ()

    def save(self, file: BinaryIO) -> None:
        """Write all fields; equal records give the same bytes."""
        message = msgspec.msgpack.encode(self, enc_hook=_array_as_message)
        # The default level takes 1.6 times as long for 6 % less space, measured on a drive.
        file.write(zlib.compress(message, level=1))

    @classmethod
    def load(cls, file: BinaryIO) -> Self:
        """Read what `save` wrote; damaged content raises an error of any type."""
        message = zlib.decompress(file.read())
        return msgspec.msgpack.decode(message, type=cls, dec_hook=_array_of_message)


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeDetections(EpisodeRecord):
    """A LiDAR detector's answers, frame by frame; all tuples have T items.

    detections: in frame `world`, or in frame `ego` where they come from a recording.
    truths: without the sources of single returns.
    times: of the call of each frame.
    parked: (P, 2) float64, metres, frame `world`, centres of parked cars, which are scenery.
    delays_s: (T,) float64, seconds from each frame to the one in which it was answered; NaN for
        frames that were never answered.
    """

    detections: tuple[Detections, ...]
    truths: tuple[Truth, ...]
    times: CallTimes
    parked: np.ndarray
    delays_s: np.ndarray

    @staticmethod
    def recorded(detections: Sequence[Detections], truths: Sequence[Truth]) -> EpisodeDetections:
        """Return detections that were read from files: answered at once, at no cost."""
        count = len(detections)
        return EpisodeDetections(
            tuple(detections),
            tuple(truths),
            CallTimes.zero(count),
            np.empty((0, 2)),
            np.zeros(count),
        )

    @property
    def answered(self) -> int:
        """Number of frames that were answered."""
        return int(np.isfinite(self.delays_s).sum())


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeImageDetections(EpisodeRecord):
    """A camera detector's answers, image by image; all tuples have K items.

    detections: in pixels; None where there was no image.
    truths: with boxes in the image.
    parked: the parked cars of each image.
    times: of the call of each image; 0 without one.
    rows: (K,) int64, numbers of the images.
    """

    detections: tuple[ImageDetections | None, ...]
    truths: tuple[Truth, ...]
    parked: tuple[ParkedBoxes, ...]
    times: CallTimes
    rows: np.ndarray

    @property
    def filled(self) -> tuple[ImageDetections, ...]:
        """The detections, empty ones where there was no image."""
        pairs = zip(self.detections, self.truths, strict=True)
        return tuple(ImageDetections.empty(t.stamp_s) if d is None else d for d, t in pairs)

    def labels(self, extinction_per_m: float = 0.0) -> list[Labels]:
        """Return the labels of the images; objects lost in fog or rain are labelled as hidden."""
        pairs = zip(self.truths, self.parked, strict=True)
        return [labels_of(t, p).in_air(extinction_per_m) for t, p in pairs]


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeFusions(EpisodeRecord):
    """A fusion's answers to K scans of an episode; all tuples have K items.

    rows: (K,) int64, numbers of the scans. fused: at the stamps of the scans, frame `ego`.
    targets: the objects to be detected. times: of the fusion's calls, without the detectors.
    """

    rows: np.ndarray
    fused: tuple[FusedDetections, ...]
    targets: tuple[FusionTargets, ...]
    times: CallTimes


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeTracks(EpisodeRecord):
    """A tracker's answers, frame by frame.

    tracks: T records in frame `world`.
    times: of the call of each frame; for an offline tracker with a share of its last call.
    """

    tracks: tuple[Tracks, ...]
    times: CallTimes


@dataclass(frozen=True, slots=True, eq=False)
class EpisodePoses(EpisodeRecord):
    """An odometry's answers to T scans, beside the true poses.

    estimate, truth: (T, 4, 4) float64, poses of the LiDAR: in its frame of the first scan, and in
        frame `world`.
    stamps_s: (T,) float64, seconds.
    degraded: (T,) bool.
    dynamic, moving: T arrays (N,) bool: returns that the odometry takes for moving objects, and
        those that truly come from moving objects.
    times: of the call of each scan; no values if the poses are made from truth.
    """

    estimate: np.ndarray
    truth: np.ndarray
    stamps_s: np.ndarray
    degraded: np.ndarray
    dynamic: tuple[np.ndarray, ...]
    moving: tuple[np.ndarray, ...]
    times: CallTimes

    @property
    def trajectories(self) -> Trajectories:
        """Both trajectories, ready to be compared."""
        return Trajectories(self.estimate, self.truth)


def without_sources(truth: Truth, *, image: bool = False) -> Truth:
    """Return truth without the source of every return, which is useless without the scan.

    image: whether the boxes in the image stay.
    """
    boxes = truth.image_boxes if image else None
    return replace(truth, sources=np.empty(0, np.int64), image_boxes=boxes, pixels=None)


def _array_as_message(value: Any) -> Any:
    """Return a plain value in place of one that MessagePack has no type for."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    raise TypeError(f"{type(value).__name__} cannot be kept")


def _array_of_message(kind: type, message: Any) -> Any:
    """Return the array of `_array_as_message`, as a fresh copy."""
    dtype, shape, content = message
    return np.frombuffer(content, dtype).reshape(shape).copy()
