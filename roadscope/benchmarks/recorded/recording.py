"""Recorded episodes: a sequence on disk in place of simulated traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256

from roadscope.benchmarks.fingerprint import code_hash
from roadscope.benchmarks.formats.kitti import KittiSequence, read_sequence
from roadscope.benchmarks.formats.kitti_folder import KittiFolder
from roadscope.benchmarks.formats.kitti_objects import TYPE_OF
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.recorded.kitti_scores import kitti_scores
from roadscope.benchmarks.records import EpisodeDetections
from roadscope.benchmarks.suite import BoardSettings, Names, Suite
from roadscope.core import Category, Tracks


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

    @property
    def board(self) -> str:
        """The board it belongs to."""
        return f"kitti {self.category}"

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
            "code": code_hash("roadscope.benchmarks.recorded.recording"),
        }

    def check(self) -> None:
        """Read the files; what is malformed raises `FormatError`."""
        sequence_of(self)

    def replayed(self) -> EpisodeDetections:
        """Return detections, frame `ego`, and truth as if a detector had made them."""
        sequence = sequence_of(self)
        return EpisodeDetections.recorded(sequence.detections, sequence.truths)

    def scores(self, tracks: Sequence[Tracks]) -> dict[str, Score]:
        """Return the scores of tracks, world frame; tentative ones may be among them."""
        return kitti_scores(tracks, sequence_of(self))


class RecordedSettings(BoardSettings, frozen=True, kw_only=True):
    """What the suite of a folder says of its boards.

    recordings: of every detector and class, those sequences that have detections of it.
    labelled: number of sequences that have labels.
    remark: what a reader must know of entries, and of detections that are left out.
    """

    recordings: tuple[Recording, ...] = ()
    labelled: int = 0
    remark: str = ""

    @property
    def detectors(self) -> Names:
        """Those whose detections there are."""
        return tuple(dict.fromkeys(recording.detector for recording in self.recordings))


def recordings_of(suite: Suite) -> tuple[Recording, ...]:
    """Return the recordings of all boards of a suite."""
    boards = (each for each in suite.boards.values() if isinstance(each, RecordedSettings))
    return tuple(dict.fromkeys(recording for each in boards for recording in each.recordings))


KITTI_CLASSES = tuple(category.name.lower() for category in TYPE_OF)
"""Each has a board of its own: they are never ranked together."""
MOT_CLASSES = ("pedestrian",)


@lru_cache(maxsize=1)
def sequence_of(recording: Recording) -> KittiSequence:
    """Read a recording; the next job of a worker is often another tracker on the same."""
    kind = Category[recording.category.upper()]
    return read_sequence(recording.folder, recording.sequence, kind, detector=recording.detector)
