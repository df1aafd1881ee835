"""Recorded episodes: sequences on disk in place of simulated traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256

from roadscope.benchmarks.fingerprints import code_hash
from roadscope.benchmarks.formats.kitti_labels import DETECTED_TYPES
from roadscope.benchmarks.formats.kitti_sequence import (
    KittiFolder,
    KittiSequence,
    read_kitti_sequence,
)
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.benchmarks.recorded.rules import apply_kitti_rules
from roadscope.benchmarks.recorded.scores import kitti_scores
from roadscope.benchmarks.records import EpisodeDetections
from roadscope.benchmarks.suite import BoardSettings, Names, Suite
from roadscope.core import Category, Tracks


@dataclass(frozen=True, slots=True)
class Recording:
    """One KITTI sequence with one class and one detector: all that a tracker's input depends on.

    folder: the folder that holds `label_02`.
    sequence: name of the sequence.
    category: the class that is tracked: car, pedestrian or cyclist.
    detector: name of the detector, as in the folder.
    seed: number of the sequence in the folder. Sequences are the samples, as seeds are elsewhere.
    """

    folder: str
    sequence: str
    category: str
    detector: str
    seed: int

    scenario = "kitti"
    weather = condition = "as recorded"

    @property
    def board(self) -> str:
        """The board of its class."""
        return f"kitti {self.category}"

    @property
    def video(self) -> str:
        """The video that it is of: recordings of one have the same truth."""
        return self.sequence

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
            "normalized": files.scores_are_normalized(self.detector),
            **{name: sha256(path.read_bytes()).hexdigest() for name, path in paths.items()},
            "code": code_hash("roadscope.benchmarks.recorded.recording"),
        }

    def check(self) -> None:
        """Read the files; a malformed one raises `FormatError`."""
        sequence_of(self)

    def replayed(self) -> EpisodeDetections:
        """Return detections, frame `ego`, as if a detector had made them, and the truth."""
        sequence = sequence_of(self)
        return EpisodeDetections.recorded(sequence.detections, sequence.truths)

    def counted(self, tracks: Sequence[Tracks]) -> TrackedSequence:
        """Return what counts of the objects and of sure tracks, world frame, by image boxes."""
        sequence = sequence_of(self)
        kind, rows = DETECTED_TYPES[sequence.category], sequence.result_rows(tracks)
        return apply_kitti_rules(sequence.label_rows, rows, kind)

    def scores(self, tracks: Sequence[Tracks]) -> dict[str, Score]:
        """Return the scores of tracks, world frame; some of them may be tentative."""
        return kitti_scores(tracks, sequence_of(self))


class SequenceSettings(BoardSettings, frozen=True, kw_only=True):
    """The settings of a board of recorded data; remark: what a reader must know about them."""

    remark: str = ""

    @property
    def seeds(self) -> Sequence[int]:
        """The numbers of its sequences."""
        return ()


class RecordedSettings(SequenceSettings, frozen=True, kw_only=True):
    """The boards of the suite of a folder.

    recordings: for every detector and class, the sequences that have detections of it.
    labelled: number of sequences that have labels.
    remark: what a reader must know about entries, and about detections that are left out.
    """

    recordings: tuple[Recording, ...] = ()
    labelled: int = 0

    @property
    def seeds(self) -> Sequence[int]:
        """The numbers of its sequences, each as often as it is recorded."""
        return [recording.seed for recording in self.recordings]

    @property
    def detectors(self) -> Names:
        """Names of the detectors whose detections are in the folder."""
        return tuple(dict.fromkeys(recording.detector for recording in self.recordings))


def recordings_of(suite: Suite) -> tuple[Recording, ...]:
    """Return the recordings of all boards of a suite."""
    boards = (each for each in suite.boards.values() if isinstance(each, RecordedSettings))
    return tuple(dict.fromkeys(recording for each in boards for recording in each.recordings))


KITTI_CLASSES = tuple(category.name.lower() for category in DETECTED_TYPES)
"""Each class has its own board; classes are never ranked together."""
MOT_CLASSES = ("pedestrian",)


@lru_cache(maxsize=1)
def sequence_of(recording: Recording) -> KittiSequence:
    """Return the sequence of a recording; a worker's next job often needs the same one."""
    kind = Category[recording.category.upper()]
    return read_kitti_sequence(
        recording.folder, recording.sequence, kind, detector=recording.detector
    )
