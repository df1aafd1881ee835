"""What a camera detector made of an episode's images, with the truth beside it, as a file."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.metrics.image_labels import Labels, labels_of
from roadscope.benchmarks.perceived import TRUTH_FIELDS, joined, joined_masses, split
from roadscope.core import ImageDetections, Pose, RecordError, Truth
from roadscope.core.record import Record

BOX_FIELDS = ("boxes", "categories", "scores")
UNKNOWN_PX = (0, 0)
"""Stands for an image's size that a detector does not tell."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen(Record):
    """Images of one episode, one after the other; all tuples have K items.

    detections: in pixels; None where there was no image.
    truths: with boxes in the image. parked: (P, 4) boxes and (P,) ranges of parked cars.
    calls_ms: (K,) float64, time that the detector took for each image; 0 without one.
    rows: (K,) int64, numbers of the images.
    """

    detections: tuple[ImageDetections | None, ...]
    truths: tuple[Truth, ...]
    parked: tuple[tuple[np.ndarray, np.ndarray], ...]
    calls_ms: np.ndarray
    rows: np.ndarray

    @property
    def found(self) -> tuple[ImageDetections, ...]:
        """The detections, none where there was no image."""
        pairs = zip(self.detections, self.truths, strict=True)
        return tuple(nothing_seen(t.stamp_s) if d is None else d for d, t in pairs)

    def labels(self, extinction_per_m: float = 0.0) -> list[Labels]:
        """Return what the images show, without what is lost in rain or fog."""
        pairs = zip(self.truths, self.parked, strict=True)
        return [labels_of(t, p).in_air(extinction_per_m) for t, p in pairs]

    def save(self, path: Path) -> None:
        """Write a compressed `.npz` file."""
        arrays = {
            "calls_ms": self.calls_ms,
            "rows": self.rows,
            "there": np.array([d is not None for d in self.detections], bool),
            "found_s": np.array([d.stamp_s for d in self.found]),
            "sizes_px": np.array([d.size_px or UNKNOWN_PX for d in self.found]).reshape(-1, 2),
            "stamps_s": np.array([t.stamp_s for t in self.truths]),
            "world_from_ego": np.array([t.world_from_ego.matrix for t in self.truths]),
            "p_count": np.array([len(ranges) for _, ranges in self.parked], np.int64),
            "p_boxes": np.concatenate([boxes for boxes, _ in self.parked]),
            "p_ranges": np.concatenate([ranges for _, ranges in self.parked]),
            **joined("d", self.found, BOX_FIELDS),
            **joined("t", self.truths, (*TRUTH_FIELDS, "image_boxes")),
            **joined_masses(self.found),
        }
        with path.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)

    @staticmethod
    def load(path: Path) -> Seen:
        """Undo `save`; anything else is refused."""
        try:
            with np.load(path, allow_pickle=False) as data:
                return _seen(dict(data))
        except (KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise RecordError(f"{path}: not a file of image detections: {error}") from error


def nothing_seen(stamp_s: float) -> ImageDetections:
    """Return detections of nothing."""
    return ImageDetections(np.empty((0, 4)), np.empty(0, np.int8), np.empty(0), stamp_s)


def _seen(data: dict[str, np.ndarray]) -> Seen:
    names = (*BOX_FIELDS, "masses") if "d_masses" in data else BOX_FIELDS
    detected = split("d", data, names)
    true = split("t", data, (*TRUTH_FIELDS, "image_boxes"))
    parked = split("p", data, ("boxes", "ranges"))
    no_sources = np.empty(0, np.int64)
    return Seen(
        detections=tuple(
            ImageDetections(
                **fields, stamp_s=stamp, size_px=None if tuple(size) == UNKNOWN_PX else tuple(size)
            )
            if there
            else None
            for fields, stamp, there, size in zip(
                detected,
                data["found_s"].tolist(),
                data["there"].tolist(),
                data["sizes_px"].tolist(),
                strict=True,
            )
        ),
        truths=tuple(
            Truth(**fields, world_from_ego=Pose(pose), stamp_s=stamp, sources=no_sources)
            for fields, stamp, pose in zip(
                true, data["stamps_s"].tolist(), data["world_from_ego"], strict=True
            )
        ),
        parked=tuple((fields["boxes"], fields["ranges"]) for fields in parked),
        calls_ms=data["calls_ms"],
        rows=data["rows"],
    )
