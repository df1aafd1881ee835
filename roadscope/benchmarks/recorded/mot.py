"""The suite `mot`: pedestrians in the image sequences of a folder of MOTChallenge data.

Our trackers track boxes in space, and nobody knows where the boxes of an image sequence are in
space. So the boxes are laid on a plane: up in the image is ahead, and pixels become metres by one
factor per sequence. Then overlaps seen from above and in space are those in the image, and a person
lower in the image is nearer and occludes those behind.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from roadscope.benchmarks.fingerprints import code_hash
from roadscope.benchmarks.formats.kitti_frames import truth_of_labels
from roadscope.benchmarks.formats.motchallenge import (
    MotRows,
    MotSequence,
    mot_rows,
    read_mot,
    read_mot_sequence,
)
from roadscope.benchmarks.formats.table import FormatError, names_in, visible
from roadscope.benchmarks.formats.tracking_rows import FrameLimit, ImageSize
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.metrics.tracking.hota import hota
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.benchmarks.recorded.combined import alpha_parts
from roadscope.benchmarks.recorded.recording import Recording
from roadscope.benchmarks.recorded.rules import IMAGE_THRESHOLD, apply_mot_rules, distractors_of
from roadscope.benchmarks.recorded.scores import sequence_scores
from roadscope.benchmarks.recorded.suite import suite_of, tracking_settings
from roadscope.benchmarks.records import EpisodeDetections
from roadscope.benchmarks.suite import Suite
from roadscope.core import Category, Detections, Family, ImageDetections, Pose, Tracks

MOT = "mot"
TRUTH_FILE = "gt/gt.txt"
DETECTIONS_FILE = "det/det.txt"
INFO_FILE = "seqinfo.ini"
PERSON_M = 1.7
"""Usual height of a person."""
NEAREST_M = 10.0
"""Distance of the lower edge of the image: nearer people are not seen whole. Chosen by hand."""
PEOPLE = [category for category in Category if category.family is Family.PEDESTRIAN]


@dataclass(frozen=True, slots=True)
class ImagePlane:
    """The plane that the boxes of an image sequence are laid on.

    scale_m: metres per pixel.
    lower_edge_px: pixel row that is `NEAREST_M` ahead.
    middle_px: pixel column that is straight ahead.
    """

    scale_m: float
    lower_edge_px: float
    middle_px: float

    @staticmethod
    def of(frames: Sequence[ImageDetections], image_size: ImageSize | None) -> ImagePlane:
        """Return the plane from the first frame with people, as an online tracker could.

        The median height of the people in it is taken as `PERSON_M`.
        image_size: None takes the size from the boxes of that frame.
        """
        boxes = next((f.boxes for f in frames if len(f)), np.array([[0.0, 0.0, 1.0, 1.0]]))
        person_px = float(np.median(boxes[:, 3] - boxes[:, 1]))
        width, height = image_size or (2 * boxes[:, [0, 2]].mean(), boxes[:, 3].max())
        return ImagePlane(PERSON_M / person_px, float(height), float(width) / 2)

    def boxes_on_plane(self, detections: ImageDetections) -> Detections:
        """Return the people of an image as boxes on the plane, frame `ego`."""
        people = np.flatnonzero(np.isin(detections.categories, PEOPLE))
        boxes, n = detections.boxes[people], len(people)
        x = NEAREST_M + self.scale_m * (self.lower_edge_px - (boxes[:, 1] + boxes[:, 3]) / 2)
        y = self.scale_m * (self.middle_px - (boxes[:, 0] + boxes[:, 2]) / 2)
        sides = np.column_stack([boxes[:, 3] - boxes[:, 1], boxes[:, 2] - boxes[:, 0]])
        return Detections(
            centres=np.column_stack([x, y, np.full(n, PERSON_M / 2)]),
            sizes=np.column_stack([self.scale_m * sides, np.full(n, PERSON_M)]),
            yaws=np.zeros(n),
            categories=detections.categories[people],
            scores=detections.scores[people],
            frame="ego",
            stamp_s=detections.stamp_s,
        )

    def image_boxes(self, tracks: Tracks) -> np.ndarray:
        """Return (N, 4) left top right bottom, pixels, of tracks on the plane."""
        column = self.middle_px - tracks.centres[:, 1] / self.scale_m
        row = self.lower_edge_px - (tracks.centres[:, 0] - NEAREST_M) / self.scale_m
        half = tracks.sizes[:, :2] / self.scale_m / 2
        return np.column_stack(
            [column - half[:, 1], row - half[:, 0], column + half[:, 1], row + half[:, 0]]
        )


@dataclass(frozen=True, slots=True)
class MotRecording(Recording):
    """An image sequence; `folder` holds its folder, and `detector` is `det`."""

    scenario = MOT

    @property
    def board(self) -> str:
        """The board of its class."""
        return f"mot {self.category}"

    @property
    def video(self) -> str:
        """The video that it is of: MOT17 has each three times, with other detections."""
        return re.sub(r"^(MOT\d+-\d+)-\w+$", r"\1", self.sequence)

    def spec(self) -> dict[str, object]:
        """Return what detections and truth depend on: the bytes of the files, not their place."""
        root = Path(self.folder) / self.sequence
        paths = {name: root / name for name in (TRUTH_FILE, DETECTIONS_FILE, INFO_FILE)}
        return {
            "sequence": self.sequence,
            **{n: sha256(p.read_bytes()).hexdigest() for n, p in paths.items() if p.is_file()},
            "code": code_hash("roadscope.benchmarks.recorded.mot"),
        }

    def check(self) -> None:
        """Read the files; a malformed one raises `FormatError`."""
        image_sequence(self)

    def replayed(self) -> EpisodeDetections:
        """Return the detections on a plane as if a detector had made them.

        Truth is empty: where the people are in space is not known.
        """
        sequence, plane = image_sequence(self)
        detections = tuple(plane.boxes_on_plane(frame) for frame in sequence.detections)
        ids, velocities = np.empty(0, np.int64), np.empty((0, 2))
        empty_detections = [Detections.empty(frame.stamp_s, "world") for frame in detections]
        truths = [
            truth_of_labels(ids, boxes, velocities, Pose.identity(), stamp_s=boxes.stamp_s)
            for boxes in empty_detections
        ]
        return EpisodeDetections.recorded(detections, truths)

    def rows(self, tracks: Sequence[Tracks]) -> list[MotRows]:
        """Return the image boxes of the tracks of each frame as rows of results."""
        _, plane = image_sequence(self)
        return [
            mot_rows(record, frame, plane.image_boxes(record))
            for frame, record in enumerate(tracks, start=1)
        ]

    def counted(self, tracks: Sequence[Tracks]) -> TrackedSequence:
        """Return what counts of the objects and of tracks, by image boxes."""
        sequence, _ = image_sequence(self)
        assert sequence.truth_rows is not None
        distractors = distractors_of(sequence.name)
        return apply_mot_rules(sequence.truth_rows, self.rows(tracks), distractors)

    def scores(self, tracks: Sequence[Tracks]) -> dict[str, Score]:
        """Return the scores by image boxes under MOTChallenge's rules.

        tracks: tentative ones are used for averages over recall only.
        """
        counted, with_tentative = map(self.counted, ([record.sure for record in tracks], tracks))
        scores = sequence_scores(counted, IMAGE_THRESHOLD, with_tentative)
        return scores | alpha_parts(hota(counted))


def score_mot_results(sequence: Path | str, results: Path | str) -> dict[str, Score]:
    """Return HOTA (also by alpha), MOTA, IDF1 and other scores of one sequence, by image boxes.

    sequence: its folder with `gt/gt.txt`, `det/det.txt` and `seqinfo.ini`.
    results: a tracker's results, 7 or 10 columns.
    A malformed file raises `FormatError` with file, line and what was expected.

    >>> from roadscope.benchmarks import score_mot_results
    >>> scores = score_mot_results("MOT17-02", "mine/MOT17-02.txt")
    >>> for name in ("hota", "mota", "idf1"):
    ...     print(f"{name} {scores[name].value:.3f}")
    hota 0.707
    mota 0.500
    idf1 0.667
    """
    labelled = read_mot_sequence(sequence)
    truth = labelled.truth_rows
    if truth is None:
        raise FormatError(f"{Path(sequence) / 'gt' / 'gt.txt'}: missing; scores need ground truth")
    limit = FrameLimit(len(truth), f"the last of the sequence {sequence}")
    tracks = read_mot(Path(results), limit=limit).by_frame(len(truth))
    counted = apply_mot_rules(truth, tracks, distractors_of(labelled.name))
    return sequence_scores(counted, IMAGE_THRESHOLD) | alpha_parts(hota(counted))


@lru_cache(maxsize=1)
def image_sequence(recording: MotRecording) -> tuple[MotSequence, ImagePlane]:
    """Return a sequence and its plane; a worker's next job often needs the same ones."""
    sequence = read_mot_sequence(Path(recording.folder) / recording.sequence)
    return sequence, ImagePlane.of(sequence.detections, sequence.image_size)


def mot_suite(folder: Path | str) -> Suite:
    """Return the suite of a folder of sequences, of its `train`, or of one sequence alone.

    A missing folder or a wrong layout raises `FormatError`.
    """
    folder = Path(folder)
    expected = f"SEQ/{DETECTIONS_FILE} and SEQ/{TRUTH_FILE}"
    if not folder.is_dir():
        raise FormatError(f"{folder}: no such folder; expected one with {expected}")
    for root in (folder, folder / "train", folder.parent):
        if root == folder.parent:
            names = [folder.name]
        else:
            names = [path.name for path in visible(root) if path.is_dir()]
        labelled = [name for name in names if (root / name / TRUTH_FILE).is_file()]
        recordings = tuple(
            MotRecording(str(root.resolve()), name, "pedestrian", "det", number)
            for number, name in enumerate(labelled)
            if (root / name / DETECTIONS_FILE).is_file()
        )
        if recordings:
            return suite_of(MOT, tracking_settings(MOT, recordings, labelled=len(labelled)))
    raise FormatError(f"{folder}: expected {expected}, here or in train/; got {names_in(folder)}")
