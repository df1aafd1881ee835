"""What a detector made of an episode, with the truth beside it, as a file."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.core import Detections, ImageDetections, Pose, RecordError, Truth
from roadscope.core.record import Record

DETECTION_FIELDS = ("centres", "sizes", "yaws", "categories", "scores")
TRUTH_FIELDS = (
    "ids", "categories", "centres", "sizes", "yaws", "velocities",
    "lidar_returns", "visible_pixels", "occluded_fraction",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Perceived(Record):
    """One episode, frame by frame; all tuples have T items.

    detections: in the world frame, or in the ego frame where they are not kept but recorded.
    truths: without the sources of single returns.
    calls_ms: (T,) float64, time that the detector took for each frame.
    parked: (P, 2) float64, metres, world frame, cars that stand beside the road as scenery.
    delays_s: (T,) float64, seconds from each frame to the one in which it was answered; nan for
        frames that never were.
    """

    detections: tuple[Detections, ...]
    truths: tuple[Truth, ...]
    calls_ms: np.ndarray
    parked: np.ndarray
    delays_s: np.ndarray

    @property
    def answered(self) -> int:
        """Number of frames that were answered."""
        return int(np.isfinite(self.delays_s).sum())

    def save(self, path: Path) -> None:
        """Write a compressed `.npz` file."""
        arrays = {
            "calls_ms": self.calls_ms,
            "parked": self.parked,
            "delays_s": self.delays_s,
            "stamps_s": np.array([t.stamp_s for t in self.truths]),
            "world_from_ego": np.array([t.world_from_ego.matrix for t in self.truths]),
            **joined("d", self.detections, DETECTION_FIELDS),
            **joined_masses(self.detections),
            **joined("t", self.truths, TRUTH_FIELDS),
        }
        with path.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)

    @staticmethod
    def load(path: Path) -> Perceived:
        """Undo `save`; anything else is refused."""
        try:
            with np.load(path, allow_pickle=False) as data:
                return _perceived(dict(data))
        except (KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise RecordError(f"{path}: not a file of detections: {error}") from error


def without_sources(truth: Truth, *, image: bool = False) -> Truth:
    """Drop what only the scan itself can be read with; image: keep boxes in the image."""
    fields: dict[str, Any] = {name: getattr(truth, name) for name in TRUTH_FIELDS}
    return Truth(
        **fields,
        world_from_ego=truth.world_from_ego,
        stamp_s=truth.stamp_s,
        sources=np.empty(0, np.int64),
        image_boxes=truth.image_boxes if image else None,
    )


def _perceived(data: dict[str, np.ndarray]) -> Perceived:
    stamps = data["stamps_s"].tolist()
    names = (*DETECTION_FIELDS, "masses") if "d_masses" in data else DETECTION_FIELDS
    detected = split("d", data, names)
    true = split("t", data, TRUTH_FIELDS)
    no_sources = np.empty(0, np.int64)
    return Perceived(
        detections=tuple(
            Detections(**fields, frame="world", stamp_s=stamp)
            for fields, stamp in zip(detected, stamps, strict=True)
        ),
        truths=tuple(
            Truth(**fields, world_from_ego=Pose(pose), stamp_s=stamp, sources=no_sources)
            for fields, stamp, pose in zip(true, stamps, data["world_from_ego"], strict=True)
        ),
        calls_ms=data["calls_ms"],
        parked=data["parked"],
        delays_s=data["delays_s"],
    )


def joined_masses(found: Sequence[Detections | ImageDetections]) -> dict[str, np.ndarray]:
    """Return the masses of detections, where all of them have some."""
    masses = [each.masses for each in found if len(each)]
    known = [each for each in masses if each is not None]
    if not known or len(known) < len(masses):
        return {}
    return {"d_masses": np.concatenate(known)}


def joined(prefix: str, records: Sequence[Any], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return arrays of one name each from many records, and how long each record is."""
    arrays = {f"{prefix}_count": np.array([len(r) for r in records], np.int64)}
    for name in names:
        arrays[f"{prefix}_{name}"] = np.concatenate([getattr(r, name) for r in records])
    return arrays


def split(prefix: str, data: dict[str, np.ndarray], names: Sequence[str]) -> list[dict[str, Any]]:
    """Undo `joined`."""
    cuts = np.cumsum(data[f"{prefix}_count"])[:-1]
    columns = [np.split(data[f"{prefix}_{name}"], cuts) for name in names]
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
