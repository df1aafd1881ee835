"""The boards of KITTI's objects: LiDAR detectors on recorded scans, by KITTI's rules."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from roadscope.benchmarks.boards.board import (
    Board,
    Breakdown,
    Column,
    Condition,
    JobOptions,
    Scores,
    call_cost,
    slow_calls_column,
    time_columns,
)
from roadscope.benchmarks.boards.detection import DetectionBoard
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.formats.kitti_labels import DETECTED_TYPES, KittiObjects, KittiType
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.kinds import DETECTOR
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.breakdown import part_name
from roadscope.benchmarks.metrics.score import mean
from roadscope.benchmarks.nodes.kitti import AllDrives, KittiDetectionNode
from roadscope.benchmarks.recorded.kitti_drive import KittiDrive, KittiDrives, labels_of
from roadscope.benchmarks.recorded.object_rules import object_precisions
from roadscope.benchmarks.recorded.recording import KITTI_CLASSES
from roadscope.benchmarks.recorded.settings import KittiSettings
from roadscope.benchmarks.records import CallTimes, EpisodeDetections
from roadscope.benchmarks.references import NAMED_BY_SUITES, UPPER_MARK, detection_source
from roadscope.benchmarks.suite import Suite
from roadscope.core import Category, Family, Spec
from roadscope.core.spec import ORACLE

EVERYTHING = Eligibility((0.0, 1e4), 1, tuple(family.value for family in Family))
"""The oracle reports all labels; KITTI's rules say which of them have to be found."""
SEQUENCE = "sequence"
AP_NOTE = (
    "AP: by KITTI's rules at 40 recalls, 0 to 1, from an IoU of 0.7 (cars) or 0.5; moderate: from "
    "25 px high, at most partly hidden and 30 % outside of the image."
)
FEW_NOTE = "Of fewer than 41 objects AP is at most (number - 1) / 40: see the labels' own."


def precision_columns(overlaps: Sequence[tuple[str, str]]) -> tuple[Column, ...]:
    """Return columns of AP by overlap and difficulty. overlaps: key of `OVERLAPS` and heading."""
    return tuple(
        Column(f"ap_{overlap}_{name}", f"{heading} {name}", 3, f"{AP_NOTE} {FEW_NOTE}")
        for overlap, heading in overlaps
        for name in ("moderate", "easy", "hard")
    )


class KittiDetectionBoard(Board):
    """Ranks LiDAR detectors on one class of KITTI's objects by AP of 3-D boxes."""

    kind = DETECTOR
    settings_type = KittiSettings
    headline = "ap_3d_moderate"
    columns = (
        *precision_columns([("3d", "AP 3-D"), ("bev", "AP from above")]),
        *time_columns(2, "frame"),
        Column("boxes_per_frame", "boxes per frame", 2, "boxes: of the class, in the image."),
        slow_calls_column(2),
    )
    breakdowns = (Breakdown(SEQUENCE, note=FEW_NOTE),)
    by_condition = ()
    shown_parts = (Column("ap_3d_moderate", "AP 3-D moderate"),)
    conditions: Mapping[str, Condition] = {}
    object_metric = "ap_3d_hard"
    sample = ""
    compared_with = DetectionBoard.name

    def __init__(self, category: Category) -> None:
        """Take the class: car, pedestrian or cyclist."""
        self.category = category
        self.name = f"kitti detection {category.name.lower()}"

    def check_entry(self, spec: Spec) -> Spec:
        """Return a detector's resolved spec; those that only suites name are entries here too."""
        return detection_source(spec) if spec.name in NAMED_BY_SUITES else super().check_entry(spec)

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every detector on all drives, and the labels as a mark."""
        drives = suite.settings(self.name, KittiSettings).drives
        sources = {str(entry): entry for entry in entries}
        if options.marks:
            sources[ORACLE] = detection_source(ORACLE)
        return [
            Job(
                self,
                name,
                KittiDrives(drives),
                AllDrives(tuple(KittiDetectionNode(source, drive, EVERYTHING) for drive in drives)),
                mark=UPPER_MARK if source.kind == ORACLE else None,
            )
            for name, source in sources.items()
        ]

    def score(self, job: Job, answers: Sequence[EpisodeDetections], options: RunOptions) -> Scores:
        """Return average precisions, the number of boxes, and times of calls."""
        assert isinstance(job.episode, KittiDrives)
        kind = DETECTED_TYPES[self.category]
        drives = job.episode.drives
        labels = [rows for drive in drives for rows in labels_of(drive)]
        boxes = [
            rows
            for drive, each in zip(drives, answers, strict=True)
            for rows in drive.rows(each.detections)
        ]
        shown = sum(int((rows.types == kind).sum()) for rows in boxes)
        scores = {
            f"ap_{overlap}_{name}": precision.score
            for overlap in ("3d", "bev")
            for name, precision in object_precisions(labels, boxes, kind, overlap).items()
        }
        scores["boxes_per_frame"] = mean(shown, len(boxes), "1/frame")
        scores |= _by_sequence(drives, labels, boxes, kind)
        if job.mark:
            return scores
        return scores | call_cost(_joined([each.times for each in answers]))

    def explanation(self, suite: Suite) -> str:
        """Return as text which frames there are, and what detectors get."""
        return suite.settings(self.name, KittiSettings).remark


def _by_sequence(
    drives: Sequence[KittiDrive],
    labels: Sequence[KittiObjects],
    boxes: Sequence[KittiObjects],
    kind: KittiType,
) -> Scores:
    """Return the average precision of each sequence; parts of the object data are none."""
    scores, end = {}, 0
    for drive in drives if drives[0].files.layout.by_sequence else ():
        begin, end = end, end + len(drive.files.numbers)
        found = object_precisions(labels[begin:end], boxes[begin:end], kind)
        scores |= {
            part_name(f"ap_3d_{name}", SEQUENCE, drive.name): precision.score
            for name, precision in found.items()
        }
    return scores


def _joined(times: Sequence[CallTimes]) -> CallTimes:
    """Return the times of all calls; the first of a drive may load or compile what is needed.

    That of the first drive stays, as `call_cost` leaves the first one out.
    """
    kept = [
        each.select(np.arange(number > 0, len(each.wall_ms))) for number, each in enumerate(times)
    ]
    return CallTimes(
        np.concatenate([each.processor_ms for each in kept]),
        np.concatenate([each.wall_ms for each in kept]),
    )


KITTI_DETECTION_BOARDS = tuple(
    KittiDetectionBoard(Category[name.upper()]) for name in KITTI_CLASSES
)
