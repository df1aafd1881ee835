"""What plug-ins answered over an episode, with the ground truth beside it, as kept files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, BinaryIO, Self

import numpy as np

from roadscope.benchmarks.metrics.fusion import Targets
from roadscope.benchmarks.metrics.image_labels import Labels, ParkedBoxes, labels_of
from roadscope.benchmarks.metrics.odometry import Trajectories
from roadscope.core import Detections, ImageDetections, Pose, Tracks, Truth
from roadscope.core.fused import FusedDetections
from roadscope.core.record import Record

DETECTION_FIELDS = ("centres", "sizes", "yaws", "categories", "scores")
BOX_FIELDS = ("boxes", "categories", "scores")
TRACK_FIELDS = (
    "ids",
    "centres",
    "sizes",
    "yaws",
    "velocities",
    "covariances",
    "categories",
    "scores",
    "states",
)
TRUTH_FIELDS = (
    "ids",
    "categories",
    "centres",
    "sizes",
    "yaws",
    "velocities",
    "lidar_returns",
    "visible_pixels",
    "occluded_fraction",
)
FUSED_FIELDS = tuple(f.name for f in fields(FusedDetections) if f.name != "stamp_s")
TARGET_FIELDS = tuple(f.name for f in fields(Targets))
NO_SIZE_PX = (0, 0)
"""Stands in a file for an image size that a detector does not say."""

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True, slots=True, eq=False)
class CallTimes(Record):
    """What the calls of a plug-in cost, one value a call.

    processor_ms: (T,) float64, processor time of all threads of the plug-in's process.
    wall_ms: (T,) float64, time that passed.
    """

    processor_ms: np.ndarray
    wall_ms: np.ndarray

    @staticmethod
    def zero(calls: int) -> CallTimes:
        """Return the times of calls that cost nothing: what is made from truth."""
        return CallTimes(np.zeros(calls), np.zeros(calls))

    def __add__(self, other: CallTimes) -> CallTimes:
        return CallTimes(self.processor_ms + other.processor_ms, self.wall_ms + other.wall_ms)

    def shifted(self, processor_ms: float, wall_ms: float) -> CallTimes:
        """Return times to each of which a constant is added."""
        return CallTimes(self.processor_ms + processor_ms, self.wall_ms + wall_ms)

    def select(self, calls: np.ndarray) -> CallTimes:
        """Return the times of some calls."""
        return CallTimes(self.processor_ms[calls], self.wall_ms[calls])


class EpisodeRecord(Record, ABC):
    """Base of the records of an episode, which are kept as `.npz` files."""

    __slots__ = ()

    @abstractmethod
    def arrays(self) -> Arrays:
        """Return everything as named arrays."""

    @classmethod
    @abstractmethod
    def from_arrays(cls, data: Arrays) -> Self:
        """Undo `arrays`."""

    def save(self, file: BinaryIO) -> None:
        """Write a compressed `.npz` archive."""
        np.savez_compressed(file, allow_pickle=False, **self.arrays())

    @classmethod
    def load(cls, file: BinaryIO) -> Self:
        """Undo `save`; a damaged archive raises an error of any kind."""
        with np.load(file, allow_pickle=False) as data:
            return cls.from_arrays(dict(data))


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

    def arrays(self) -> Arrays:
        """Return everything as named arrays."""
        return {
            "parked": self.parked,
            "delays_s": self.delays_s,
            **_times_arrays(self.times),
            **_truth_arrays(self.truths),
            **joined("d", self.detections, DETECTION_FIELDS),
            **_masses_arrays(self.detections),
        }

    @classmethod
    def from_arrays(cls, data: Arrays) -> Self:
        """Undo `arrays`."""
        truths = _truths(data)
        names = (*DETECTION_FIELDS, "masses") if "d_masses" in data else DETECTION_FIELDS
        return cls(
            tuple(
                Detections(**columns, frame="world", stamp_s=truth.stamp_s)
                for columns, truth in zip(split("d", data, names), truths, strict=True)
            ),
            truths,
            _times(data),
            data["parked"],
            data["delays_s"],
        )


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
        return tuple(no_image_detections(t.stamp_s) if d is None else d for d, t in pairs)

    def labels(self, extinction_per_m: float = 0.0) -> list[Labels]:
        """Return what the images show, without what is lost in rain or fog."""
        pairs = zip(self.truths, self.parked, strict=True)
        return [labels_of(t, p).in_air(extinction_per_m) for t, p in pairs]

    def arrays(self) -> Arrays:
        """Return everything as named arrays."""
        return {
            "rows": self.rows,
            "there": np.array([d is not None for d in self.detections], bool),
            "detections_s": np.array([d.stamp_s for d in self.filled]),
            "sizes_px": np.array([d.size_px or NO_SIZE_PX for d in self.filled]).reshape(-1, 2),
            **_times_arrays(self.times),
            **_truth_arrays(self.truths, image=True),
            **joined("d", self.filled, BOX_FIELDS),
            **joined("p", self.parked, ("boxes", "ranges_m")),
            **_masses_arrays(self.filled),
        }

    @classmethod
    def from_arrays(cls, data: Arrays) -> Self:
        """Undo `arrays`."""
        names = (*BOX_FIELDS, "masses") if "d_masses" in data else BOX_FIELDS
        rows = zip(
            split("d", data, names),
            data["detections_s"].tolist(),
            data["there"].tolist(),
            data["sizes_px"].tolist(),
            strict=True,
        )
        return cls(
            tuple(
                ImageDetections(**columns, stamp_s=stamp_s, size_px=_size_px(size))
                if has_image
                else None
                for columns, stamp_s, has_image, size in rows
            ),
            _truths(data, image=True),
            tuple(ParkedBoxes(**columns) for columns in split("p", data, ("boxes", "ranges_m"))),
            _times(data),
            data["rows"],
        )


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeFusions(EpisodeRecord):
    """A fusion's answers to K scans of an episode; all tuples have K items.

    rows: (K,) int64, numbers of the scans. fused: at the stamps of the scans, frame `ego`.
    targets: what was to be found. times: of the fusion's calls alone.
    """

    rows: np.ndarray
    fused: tuple[FusedDetections, ...]
    targets: tuple[Targets, ...]
    times: CallTimes

    def arrays(self) -> Arrays:
        """Return everything as named arrays."""
        masses = max((f.masses.shape[1] for f in self.fused if len(f)), default=1)
        none = np.empty((0, masses))
        named = [f if len(f) else _with_masses(f, none) for f in self.fused]
        return {
            "rows": self.rows,
            "fused_s": np.array([f.stamp_s for f in self.fused]),
            **joined("f", named, FUSED_FIELDS),
            **joined("g", self.targets, TARGET_FIELDS),
            **_times_arrays(self.times),
        }

    @classmethod
    def from_arrays(cls, data: Arrays) -> Self:
        """Undo `arrays`."""
        pairs = zip(split("f", data, FUSED_FIELDS), data["fused_s"].tolist(), strict=True)
        return cls(
            data["rows"],
            tuple(FusedDetections(**columns, stamp_s=stamp_s) for columns, stamp_s in pairs),
            tuple(Targets(**columns) for columns in split("g", data, TARGET_FIELDS)),
            _times(data),
        )


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeTracks(EpisodeRecord):
    """A tracker's answers, frame by frame.

    tracks: T records in frame `world`.
    times: of the call of each frame; of an offline tracker with its share of the last call.
    """

    tracks: tuple[Tracks, ...]
    times: CallTimes

    def arrays(self) -> Arrays:
        """Return everything as named arrays."""
        return {
            "stamps_s": np.array([t.stamp_s for t in self.tracks]),
            **joined("k", self.tracks, TRACK_FIELDS),
            **_times_arrays(self.times),
        }

    @classmethod
    def from_arrays(cls, data: Arrays) -> Self:
        """Undo `arrays`."""
        pairs = zip(split("k", data, TRACK_FIELDS), data["stamps_s"].tolist(), strict=True)
        tracks = (Tracks(**columns, frame="world", stamp_s=stamp_s) for columns, stamp_s in pairs)
        return cls(tuple(tracks), _times(data))


@dataclass(frozen=True, slots=True, eq=False)
class EpisodePoses(EpisodeRecord):
    """An odometry's answers to T scans, beside the true poses.

    estimate, truth: (T, 4, 4) float64, poses of the LiDAR: in its frame of the first scan, and in
        frame `world`.
    stamps_s: (T,) float64, seconds.
    degraded: (T,) bool.
    dynamic, moving: T arrays (N,) bool: returns that the odometry holds to be dynamic, and those
        that truly come from moving objects.
    times: of the call of each scan; of no calls where the poses are made from truth.
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

    def arrays(self) -> Arrays:
        """Return everything as named arrays; masks as bits."""
        returns = np.array([len(mask) for mask in self.dynamic], np.int64)
        return {
            "estimate": self.estimate,
            "truth": self.truth,
            "stamps_s": self.stamps_s,
            "degraded": self.degraded,
            "returns": returns,
            "dynamic": np.packbits(np.concatenate(self.dynamic)),
            "moving": np.packbits(np.concatenate(self.moving)),
            **_times_arrays(self.times),
        }

    @classmethod
    def from_arrays(cls, data: Arrays) -> Self:
        """Undo `arrays`."""
        total, cuts = int(data["returns"].sum()), np.cumsum(data["returns"])[:-1]
        dynamic, moving = (
            tuple(np.split(np.unpackbits(data[name], count=total).astype(bool), cuts))
            for name in ("dynamic", "moving")
        )
        return cls(
            data["estimate"],
            data["truth"],
            data["stamps_s"],
            data["degraded"],
            dynamic,
            moving,
            _times(data),
        )


def without_sources(truth: Truth, *, image: bool = False) -> Truth:
    """Drop the source of every return, which only the scan can be read with.

    image: keep the boxes in the image.
    """
    columns: dict[str, Any] = {name: getattr(truth, name) for name in TRUTH_FIELDS}
    return Truth(
        **columns,
        world_from_ego=truth.world_from_ego,
        stamp_s=truth.stamp_s,
        sources=np.empty(0, np.int64),
        image_boxes=truth.image_boxes if image else None,
    )


def no_image_detections(stamp_s: float) -> ImageDetections:
    """Return image detections of nothing."""
    return ImageDetections(np.empty((0, 4)), np.empty(0, np.int8), np.empty(0), stamp_s)


def joined(prefix: str, records: Sequence[Any], names: Sequence[str]) -> Arrays:
    """Return one array for each field of many records, and the length of each record."""
    arrays = {f"{prefix}_count": np.array([len(r) for r in records], np.int64)}
    for name in names:
        arrays[f"{prefix}_{name}"] = np.concatenate([getattr(r, name) for r in records])
    return arrays


def split(prefix: str, data: Mapping[str, np.ndarray], names: Sequence[str]) -> list[Arrays]:
    """Undo `joined`."""
    cuts = np.cumsum(data[f"{prefix}_count"])[:-1]
    columns = [np.split(data[f"{prefix}_{name}"], cuts) for name in names]
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]


def _with_masses(fused: FusedDetections, masses: np.ndarray) -> FusedDetections:
    columns: dict[str, Any] = {name: getattr(fused, name) for name in FUSED_FIELDS}
    return FusedDetections(**{**columns, "masses": masses}, stamp_s=fused.stamp_s)


def _masses_arrays(detections: Sequence[Detections | ImageDetections]) -> Arrays:
    """Return the masses of detections, where all of them have some."""
    masses = [each.masses for each in detections if len(each)]
    known = [each for each in masses if each is not None]
    if not known or len(known) < len(masses):
        return {}
    return {"d_masses": np.concatenate(known)}


def _times_arrays(times: CallTimes) -> Arrays:
    return {"processor_ms": times.processor_ms, "wall_ms": times.wall_ms}


def _times(data: Arrays) -> CallTimes:
    return CallTimes(data["processor_ms"], data["wall_ms"])


def _truth_arrays(truths: Sequence[Truth], *, image: bool = False) -> Arrays:
    names = (*TRUTH_FIELDS, "image_boxes") if image else TRUTH_FIELDS
    return {
        "stamps_s": np.array([t.stamp_s for t in truths]),
        "world_from_ego": np.array([t.world_from_ego.matrix for t in truths]),
        **joined("t", truths, names),
    }


def _truths(data: Arrays, *, image: bool = False) -> tuple[Truth, ...]:
    names = (*TRUTH_FIELDS, "image_boxes") if image else TRUTH_FIELDS
    columns: list[dict[str, Any]] = list(split("t", data, names))
    rows = zip(columns, data["stamps_s"].tolist(), data["world_from_ego"], strict=True)
    none = np.empty(0, np.int64)
    return tuple(
        Truth(**fields_, world_from_ego=Pose(pose), stamp_s=stamp_s, sources=none)
        for fields_, stamp_s, pose in rows
    )


def _size_px(size: Sequence[int]) -> tuple[int, int] | None:
    width, height = size
    return None if (width, height) == NO_SIZE_PX else (width, height)
