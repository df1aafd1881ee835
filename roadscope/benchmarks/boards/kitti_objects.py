"""The boards of KITTI's objects: detectors and fusions on recorded data, by KITTI's rules."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, product
from typing import Any, ClassVar

import numpy as np

from roadscope.benchmarks.boards.board import (
    NO_RECORDED_REPLAY,
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
from roadscope.benchmarks.boards.camera import CameraBoard
from roadscope.benchmarks.boards.detection import DetectionBoard
from roadscope.benchmarks.boards.fusion import INPUTS, FusionBoard, fusion_rows
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.formats.kitti_frames import LabelCamera, kitti_results
from roadscope.benchmarks.formats.kitti_labels import DETECTED_TYPES, KittiObjects
from roadscope.benchmarks.formats.kitti_scans import IMAGES, SCANS
from roadscope.benchmarks.graph import Job, Node
from roadscope.benchmarks.kinds import CAMERA_DETECTOR, DETECTOR, FUSION
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.breakdown import part_name
from roadscope.benchmarks.metrics.score import mean
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.nodes.fusions import FusionNode
from roadscope.benchmarks.nodes.images import ImageNode
from roadscope.benchmarks.recorded.kitti_drive import (
    KittiDrive,
    KittiDrives,
    frame_poses,
    labels_by_frame,
)
from roadscope.benchmarks.recorded.object_rules import precision_scores
from roadscope.benchmarks.recorded.recording import KITTI_CLASSES, SequenceSettings
from roadscope.benchmarks.recorded.suite import DataFolder, KittiSettings, kitti_object_settings
from roadscope.benchmarks.records import (
    CallTimes,
    EpisodeDetections,
    EpisodeFusions,
    EpisodeImageDetections,
)
from roadscope.benchmarks.references import UPPER_MARK, detection_source, image_source
from roadscope.benchmarks.suite import Suite
from roadscope.core import Category, Family, Pose, Spec
from roadscope.core.fused import FusedDetections
from roadscope.core.spec import ORACLE

EVERYTHING = Eligibility((0.0, 1e4), 1, tuple(family.value for family in Family))
"""The oracle reports all labels: KITTI's rules, not this one, say which have to be found."""
SEQUENCE = "sequence"
AP_NOTE = (
    "AP: by KITTI's rules at 40 recalls, 0 to 1, from an IoU of 0.7 (cars) or 0.5; moderate: from "
    "25 px high, at most partly hidden and 30 % outside of the image."
)
FEW_NOTE = "Of fewer than 41 objects AP is at most (number - 1) / 40."
MARKERS = {SCANS: (SCANS,), IMAGES: ("image_2", "image_02")}
"""Possible names of the folder of a sensor's data."""
HEADINGS = {"2d": "AP image", "3d": "AP 3-D", "bev": "AP from above"}
"""Headings of average precision by overlap, a key of `OVERLAPS`."""


def precision_columns(*overlaps: str) -> tuple[Column, ...]:
    """Return the columns of average precision by overlap and difficulty."""
    return tuple(
        Column(f"ap_{overlap}_{name}", f"{HEADINGS[overlap]} {name}", 3, f"{AP_NOTE} {FEW_NOTE}")
        for overlap in overlaps
        for name in ("moderate", "easy", "hard")
    )


@dataclass(frozen=True)
class AllDrives(Node):
    """The answers on all drives of a folder, in a node without a file of its own.

    parts: the nodes of the answers on each drive, which are kept as files.
    """

    parts: tuple[Node, ...]

    stage = "reading"
    record: ClassVar[Any] = None
    recomputed_if_fresh = False

    def content(self) -> Mapping[str, Any]:
        """Return what the answers depend on."""
        return {"parts": [part.content() for part in self.parts]}

    def sources(self) -> tuple[Node, ...]:
        """Return the answers on each drive."""
        return self.parts

    def compute(self, options: RunOptions) -> Any:
        """Return the answers on each drive."""
        return tuple(part.read(options) for part in self.parts)

    def read(self, options: RunOptions | None = None, *, recompute: bool = False) -> Any:
        """Return the answers on each drive, from their files."""
        return self.compute(options or RunOptions())


class KittiObjectsBoard(Board):
    """Ranks plug-ins on one class of KITTI's objects by average precision."""

    settings_type = KittiSettings
    breakdowns: Sequence[Breakdown] = (Breakdown(SEQUENCE, note=FEW_NOTE),)
    conditions: Mapping[str, Condition] = {}
    sample = ""
    without_replay = NO_RECORDED_REPLAY
    sensors: Sequence[str]
    """Sensors whose data plug-ins get, `SCANS` or `IMAGES`."""
    overlaps: Sequence[str]
    """By which overlaps precision is measured, keys of `OVERLAPS`; the first ranks."""

    def __init__(self, category: Category) -> None:
        """Take the class: car, pedestrian or cyclist."""
        first = self.overlaps[0]
        self.kitti_markers = [MARKERS[sensor] for sensor in self.sensors]
        self.category = category
        self.name = f"kitti {self.simulated_board} {category.name.lower()}"
        self.headline, self.object_metric = f"ap_{first}_moderate", f"ap_{first}_hard"
        self.by_condition = [column.metric for column in precision_columns(*self.overlaps)]
        self.shown_parts = (Column(self.headline, f"{HEADINGS[first]} moderate"),)
        self.columns = (
            *precision_columns(*self.overlaps),
            *time_columns(2, "frame"),
            Column("boxes_per_frame", "boxes per frame", 2, "boxes: of the class, in the image."),
            slow_calls_column(2),
        )

    @abstractmethod
    def rows(self, drive: KittiDrive, answers: Any) -> list[KittiObjects]:
        """Return the answers to each frame of a drive as KITTI's rows, with image boxes."""

    def kitti_settings(self, place: DataFolder) -> Mapping[str, SequenceSettings]:
        """Return the settings of the boards of all classes that are labelled."""
        return kitti_object_settings(place, self.simulated_board, self.sensors)

    def score(self, job: Job, answers: Sequence[Any], options: RunOptions) -> Scores:
        """Return average precisions, the number of boxes, and times of calls.

        The precisions of each sequence are by the first overlap alone.
        """
        assert isinstance(job.episode, KittiDrives)
        object_type = DETECTED_TYPES[self.category]
        drives = job.episode.drives
        labels = [labels_by_frame(drive) for drive in drives]
        boxes = [self.rows(drive, each) for drive, each in zip(drives, answers, strict=True)]
        all_labels = list(chain.from_iterable(labels))
        all_boxes = list(chain.from_iterable(boxes))
        scores = precision_scores(all_labels, all_boxes, object_type, self.overlaps)
        count = sum(int((rows.types == object_type).sum()) for rows in all_boxes)
        scores["boxes_per_frame"] = mean(count, len(all_boxes), "1/frame")
        # KITTI's object data have no sequences.
        if drives[0].files.layout.by_sequence:
            for drive, drive_labels, drive_boxes in zip(drives, labels, boxes, strict=True):
                of_drive = precision_scores(
                    drive_labels, drive_boxes, object_type, self.overlaps[:1]
                )
                for name, score in of_drive.items():
                    scores[part_name(name, SEQUENCE, drive.name)] = score
        if job.mark:
            return scores
        return scores | call_cost(_joined([each.times for each in answers]))

    def explanation(self, suite: Suite) -> str:
        """Return as text which frames there are, and what plug-ins get."""
        return suite.settings(self.name, KittiSettings).remark


class OneSensorBoard(KittiObjectsBoard):
    """Ranks the detectors of one sensor."""

    @abstractmethod
    def node(self, source: Spec, drive: KittiDrive) -> Node:
        """Return the node with the answers of a detector to a drive."""

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
                AllDrives(tuple(self.node(source, drive) for drive in drives)),
                mark=UPPER_MARK if source.kind == ORACLE else None,
            )
            for name, source in sources.items()
        ]


class KittiDetectionBoard(OneSensorBoard):
    """Ranks LiDAR detectors on one class of KITTI's objects by AP of 3-D boxes."""

    kind = DETECTOR
    simulated_board = DetectionBoard.name
    sensors = (SCANS,)
    overlaps = ("3d", "bev")

    def node(self, source: Spec, drive: KittiDrive) -> Node:
        """Return the node with the boxes of a detector in a drive."""
        return DetectionNode(source, drive, EVERYTHING)

    def rows(self, drive: KittiDrive, answers: EpisodeDetections) -> list[KittiObjects]:
        """Return the boxes in space, with the image boxes around them."""
        return drive.rows(answers.detections)


class KittiCameraBoard(OneSensorBoard):
    """Ranks camera detectors on one class of KITTI's objects by AP of image boxes."""

    kind = CAMERA_DETECTOR
    simulated_board = CameraBoard.name
    sensors = (IMAGES,)
    overlaps = ("2d",)

    def node(self, source: Spec, drive: KittiDrive) -> Node:
        """Return the node with the image boxes of a detector in a drive."""
        return ImageNode(source, drive, 0.0)

    def rows(self, drive: KittiDrive, answers: EpisodeImageDetections) -> list[KittiObjects]:
        """Return the image boxes."""
        camera = LabelCamera(Pose.identity())
        return [kitti_results(FusedDetections.of(None, each), camera) for each in answers.filled]


class KittiFusionBoard(KittiObjectsBoard):
    """Ranks fusions on one class of KITTI's objects by AP of image boxes."""

    kind = FUSION
    simulated_board = FusionBoard.name
    sensors = (SCANS, IMAGES)
    overlaps = ("2d", "3d", "bev")
    inputs_name = INPUTS
    breakdowns = (
        *KittiObjectsBoard.breakdowns,
        Breakdown(INPUTS, note="In brackets: the rank on these detections."),
    )

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every fusion on all pairs of detectors, and each sensor alone as marks."""
        settings = suite.settings(self.name, KittiSettings)
        rows = fusion_rows(entries, options)
        jobs = []
        for lidar, camera, row in product(settings.lidar, settings.camera, rows):
            nodes = tuple(
                FusionNode(
                    DetectionNode(detection_source(lidar), drive, EVERYTHING),
                    ImageNode(image_source(camera), drive, 0.0),
                    row.fusion,
                    alone=row.alone,
                )
                for drive in settings.drives
            )
            drives, answers = KittiDrives(settings.drives), AllDrives(nodes)
            jobs.append(Job(self, row.name, drives, answers, mark=row.mark, inputs=nodes[0].inputs))
        return jobs

    def rows(self, drive: KittiDrive, answers: EpisodeFusions) -> list[KittiObjects]:
        """Return the fused targets.

        A target without an image box of its own gets the one around its box in space.
        """
        pairs = zip(answers.fused, frame_poses(drive), strict=True)
        return [poses.fused_rows(fused) for fused, poses in pairs]

    def explanation(self, suite: Suite) -> str:
        """Return as text which frames there are, and which detections fusions get."""
        settings = suite.settings(self.name, KittiSettings)
        lidar, camera = " and ".join(settings.lidar), " and ".join(settings.camera)
        return f"{settings.remark} Fusions get the detections of {lidar} with those of {camera}."


def _joined(times: Sequence[CallTimes]) -> CallTimes:
    """Return the times of all calls, but for the first call of each drive after the first drive.

    A first call may load or compile things; that of the first drive is left out by `call_cost`.
    """
    first, *later = times
    counted = [first, *(each.select(np.arange(1, len(each.wall_ms))) for each in later)]
    return CallTimes(
        np.concatenate([each.processor_ms for each in counted]),
        np.concatenate([each.wall_ms for each in counted]),
    )


KITTI_OBJECT_BOARDS = tuple(
    board(Category[name.upper()])
    for board in (KittiDetectionBoard, KittiCameraBoard, KittiFusionBoard)
    for name in KITTI_CLASSES
)
