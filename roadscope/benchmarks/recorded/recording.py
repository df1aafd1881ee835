"""Recorded episodes: a sequence on disk in place of simulated traffic."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256

import numpy as np

from roadscope.benchmarks.fingerprint import code_hash
from roadscope.benchmarks.formats.kitti import KittiSequence, read_sequence
from roadscope.benchmarks.formats.kitti_folder import KittiFolder
from roadscope.benchmarks.formats.kitti_objects import TYPE_OF
from roadscope.benchmarks.perceived import Perceived
from roadscope.core import Category


@dataclass(frozen=True, slots=True)
class Recording:
    """What decides everything that a tracker gets to see of one recorded sequence.

    folder: where `label_02` lies.
    sequence: name of the sequence.
    category: the class that is tracked: car, pedestrian or cyclist.
    detector: whose detections, as the folder calls it.
    seed: number of the sequence in the folder; sequences are the sample, as seeds elsewhere.
    """

    folder: str
    sequence: str
    category: str
    detector: str
    seed: int

    scenario = "kitti"
    weather = condition = "as recorded"

    def spec(self) -> dict[str, object]:
        """Return what detections and truth depend on: the bytes of the files, not their place."""
        files = KittiFolder.find(self.folder)
        kind = Category[self.category.upper()]
        paths = {
            "labels": files.labels(self.sequence),
            "calibration": files.calibration(self.sequence),
            "detections": files.detections(self.sequence, kind, self.detector),
            "poses": files.poses(self.sequence),
        }
        return {
            "sequence": self.sequence,
            "category": self.category,
            "scaled": files.scores_are_shares(self.detector),
            **{name: sha256(path.read_bytes()).hexdigest() for name, path in paths.items()},
            "code": code_hash("core", "benchmarks/formats", "benchmarks/recorded/recording.py"),
        }


OFFLINE = "offline"
"""Metric that is 1 where a tracker went over its tracks again with all frames at hand."""
KITTI_BOARDS = tuple(f"kitti {category.name.lower()}" for category in TYPE_OF)
"""One for each class: they are never ranked together."""


def board_of(recording: Recording) -> str:
    """Return the board that a recording belongs to."""
    return f"kitti {recording.category}"


@lru_cache(maxsize=1)
def sequence_of(recording: Recording) -> KittiSequence:
    """Read a recording; the next job of a worker is often another tracker on the same."""
    kind = Category[recording.category.upper()]
    return read_sequence(recording.folder, recording.sequence, kind, detector=recording.detector)


def check_recording(recording: Recording) -> None:
    """Read a recording's files; what is malformed raises `FormatError`."""
    sequence_of(recording)


def replayed(recording: Recording) -> Perceived:
    """Return a recording's detections, ego frame, and truth as if a detector had made them."""
    sequence = sequence_of(recording)
    none = np.zeros(len(sequence))
    return Perceived(sequence.detections, sequence.truths, none, np.empty((0, 2)), none)
