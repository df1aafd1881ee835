"""The suite `mot`: people in the image sequences of a folder as MOTChallenge lays it out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from roadscope.benchmarks.fingerprint import code_hash
from roadscope.benchmarks.formats.mot_rules import THRESHOLD, distractors_of, mot_judged
from roadscope.benchmarks.formats.motchallenge import (
    MotRows,
    MotSequence,
    mot_rows,
    read_mot_sequence,
)
from roadscope.benchmarks.formats.table import FormatError
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking.hota import hota
from roadscope.benchmarks.recorded.combined import alpha_parts
from roadscope.benchmarks.recorded.image_plane import ImagePlane
from roadscope.benchmarks.recorded.kitti_scores import sequence_scores
from roadscope.benchmarks.recorded.recording import Recording
from roadscope.benchmarks.recorded.suite import recorded_suite
from roadscope.benchmarks.records import EpisodeDetections
from roadscope.benchmarks.suite import Suite
from roadscope.core import Pose, Tracks, Truth

MOT = "mot"
TRUTH, FOUND, INFO = "gt/gt.txt", "det/det.txt", "seqinfo.ini"


@dataclass(frozen=True, slots=True)
class MotRecording(Recording):
    """An image sequence; `folder` holds its own, `detector` is `det`."""

    scenario = MOT

    @property
    def board(self) -> str:
        """The board it belongs to."""
        return f"mot {self.category}"

    def spec(self) -> dict[str, object]:
        """Return what detections and truth depend on: the bytes of the files, not their place."""
        root = Path(self.folder) / self.sequence
        paths = {name: root / name for name in (TRUTH, FOUND, INFO)}
        return {
            "sequence": self.sequence,
            **{n: sha256(p.read_bytes()).hexdigest() for n, p in paths.items() if p.is_file()},
            "code": code_hash("roadscope.benchmarks.recorded.mot"),
        }

    def check(self) -> None:
        """Read the files; what is malformed raises `FormatError`."""
        image_sequence(self)

    def replayed(self) -> EpisodeDetections:
        """Return people found as if a detector had found them on a plane; truth has the stamps."""
        sequence, plane = image_sequence(self)
        flat = tuple(plane.laid_flat(frame) for frame in sequence.detections)
        return EpisodeDetections.recorded(flat, [_nobody(frame.stamp_s) for frame in flat])

    def rows(self, tracks: Sequence[Tracks]) -> list[MotRows]:
        """Return the boxes of tracks in the image."""
        _, plane = image_sequence(self)
        return [mot_rows(each, t, plane.boxes(each)) for t, each in enumerate(tracks, start=1)]

    def scores(self, tracks: Sequence[Tracks]) -> dict[str, Score]:
        """Return scores by image boxes under MOTChallenge's rules.

        Tentative tracks may be among the tracks; they count for averages over recall alone.
        """
        sequence, _ = image_sequence(self)
        assert sequence.truth is not None
        spared = distractors_of(sequence.name)
        counted, swept = (
            mot_judged(sequence.truth, self.rows(some), spared)
            for some in ([each.sure for each in tracks], tracks)
        )
        return sequence_scores(counted, THRESHOLD, swept) | alpha_parts(hota(counted))


@lru_cache(maxsize=1)
def image_sequence(recording: MotRecording) -> tuple[MotSequence, ImagePlane]:
    """Read a sequence; the next job of a worker is often another tracker on the same."""
    sequence = read_mot_sequence(Path(recording.folder) / recording.sequence)
    return sequence, ImagePlane.of(sequence.detections, sequence.image_size)


def mot_suite(folder: Path | str) -> Suite:
    """Return the suite of a folder of sequences, its `train`, or of one sequence alone.

    A missing folder or a wrong layout raises `FormatError`.
    """
    given = Path(folder)
    wanted = f"SEQ/{FOUND} and SEQ/{TRUTH}"
    if not given.is_dir():
        raise FormatError(f"{given}: no such folder; expected one with {wanted}")
    for root in (given, given / "train", given.parent):
        names = [given.name] if root == given.parent else _sequences(root)
        labelled = [name for name in names if (root / name / TRUTH).is_file()]
        recordings = tuple(
            MotRecording(str(root.resolve()), name, "pedestrian", "det", number)
            for number, name in enumerate(labelled)
            if (root / name / FOUND).is_file()
        )
        if recordings:
            return recorded_suite(MOT, recordings, len(labelled))
    seen = ", ".join(sorted(p.name for p in given.iterdir())[:8]) or "nothing"
    raise FormatError(f"{given}: expected {wanted}, here or in train/; got {seen}")


def _sequences(root: Path) -> list[str]:
    return sorted(p.name for p in root.iterdir() if p.is_dir()) if root.is_dir() else []


def _nobody(stamp_s: float) -> Truth:
    """Return a moment in which the camera stands and nobody is known to be in space."""
    n, none, three = np.empty(0, np.int64), np.empty(0), np.empty((0, 3))
    visibility, pose = (n, n, none), Pose.identity()
    categories, velocities = np.empty(0, np.int8), np.empty((0, 2))
    return Truth(n, categories, three, three, none, velocities, *visibility, pose, stamp_s, n)
