"""The fusion board: fusions of LiDAR and camera detections."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

from roadscope.benchmarks.boards.board import (
    CONDITIONS,
    Board,
    Breakdown,
    Column,
    JobOptions,
    Scores,
    SuiteCheck,
    call_cost,
    check_camera,
    check_inputs,
    episodes,
    input_checks,
    slow_calls_column,
    time_columns,
)
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.images import projection_of
from roadscope.benchmarks.kinds import FUSION
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.fusion import fusion_scores
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.nodes.fusions import FusionNode, fitting_calibration
from roadscope.benchmarks.nodes.images import ImageNode
from roadscope.benchmarks.records import EpisodeFusions
from roadscope.benchmarks.references import (
    CAMERA_ALONE,
    LIDAR_ALONE,
    ONE_SENSOR,
    check_detection_source,
    check_image_source,
    detection_source,
    image_source,
    is_noise,
)
from roadscope.benchmarks.suite import BoardSettings, Names, Positive, Suite
from roadscope.core import Spec
from roadscope.envs.sensors.rigs import rig

INPUTS = "inputs"
PASSED_ON = "union"
"""The fusion of the marks: with one sensor alone it passes its detections on."""


class FusionSettings(BoardSettings, frozen=True, kw_only=True):
    """The table `[fusion]`.

    lidar, camera: detectors; fusions get the detections of each LiDAR detector with those of each
        camera detector.
    every_s: seconds from one pair of detections to the next.
    """

    lidar: Names = ()
    camera: Names = ()
    every_s: Positive = 0.4


def _inputs(settings: FusionSettings) -> dict[str, Sequence[str]]:
    """Return the detectors whose detections fusions get, by the key of the suite's file."""
    return {"fusion.lidar": settings.lidar, "fusion.camera": settings.camera}


class FusionBoard(Board):
    """Ranks fusions by AP."""

    name = "fusion"
    kind = FUSION
    settings_type = FusionSettings
    headline = "ap"
    columns = (
        Column(
            "ap",
            "AP",
            2,
            "AP: of targets of any class, in the image by IoU 0.5, else within 2 m; episodes are "
            "weighed by their objects.",
        ),
        Column("f1", "F1", 2, "F1, detected, false, precision: from a score of 0.5."),
        Column("detection_rate", "detected", 2),
        Column("false_alarms", "false per scan", 2),
        Column(
            "distance_right", "dist. right", 2, "dist. right: of detected ones, within 10 % or 1 m."
        ),
        *time_columns(2, "scan"),
        Column("family_right", "class right", 2, "class right: vehicle, cyclist or pedestrian."),
        Column("calibration_error", "cal. error", 2, "cal. error: of the scores (ECE)."),
        Column(
            "hidden_distance_right", "dist. hidden", 2, "dist. hidden: of more than a third hidden."
        ),
        Column("precision", "precision", 2),
        slow_calls_column(2),
    )
    breakdowns = (
        Breakdown("family"),
        Breakdown("range", "range, m"),
        Breakdown("crowd"),
        Breakdown("score", note="Scores are calibrated where precision lies within their band."),
        *(Breakdown(by) for by in CONDITIONS),
        Breakdown(INPUTS, note="In brackets: the rank on these detections."),
    )
    by_condition = ("ap", "f1", "detection_rate", "false_alarms", "distance_right", "family_right")
    shown_parts = (
        Column("ap", "AP"),
        Column("detection_rate", "detected"),
        Column("precision", "precision"),
    )
    inputs_name = INPUTS
    uses_calibration = True
    object_metric = "detection_rate"
    alarms = "false alarms per scan"
    always_by = ("family", "detection_rate")
    default_suite = "fusion"

    def suite_checks(self, suite: Suite) -> list[SuiteCheck]:
        """Return the checks of the rig and of the detectors whose detections fusions get."""
        settings = suite.settings(self.name, FusionSettings)
        inputs = _inputs(settings) if settings.entries else {}
        return [
            *([SuiteCheck("fusion", check_camera, suite)] if settings.entries else []),
            *input_checks(suite, inputs),
            *(SuiteCheck("fusion.lidar", check_detection_source, s) for s in settings.lidar),
            *(SuiteCheck("fusion.camera", check_image_source, s) for s in settings.camera),
        ]

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every fusion on all pairs of detectors, and each sensor alone as marks."""
        check_camera(suite)
        if options.calibration:
            fitting_calibration(options.calibration, projection_of(rig(suite.rig)))
        settings = suite.settings(self.name, FusionSettings)
        for key, names in _inputs(settings).items():
            check_inputs(suite, key, names)
        rows = fusion_rows(entries, options)
        pairs = [
            (detection_source(lidar), image_source(camera))
            for lidar in settings.lidar
            for camera in settings.camera
        ]
        jobs = []
        for episode, (lidar, camera), row in product(episodes(suite), pairs, rows):
            node = FusionNode(
                DetectionNode(lidar, episode, suite.eligibility),
                ImageNode(camera, episode, settings.every_s, of_scans=True),
                row.fusion,
                options.calibration,
                settings.every_s,
                row.alone,
            )
            jobs.append(Job(self, row.name, episode, node, mark=row.mark, inputs=node.inputs))
        return jobs

    def score(self, job: Job, answers: EpisodeFusions, options: RunOptions) -> Scores:
        """Return the scores of a job's answers, and times of calls unless it is a mark."""
        scores = fusion_scores(answers.fused, answers.targets)
        return scores if job.mark else scores | call_cost(answers.times)

    def explanation(self, suite: Suite) -> str:
        """Return as text which objects are eligible, and which detections fusions get."""
        settings = suite.settings(self.name, FusionSettings)
        lidar, camera = " and ".join(settings.lidar), " and ".join(settings.camera)
        text = (
            "To be found by fusions: road users in the image, 3 to 60 m away, with 5 returns or 60 "
            "pixels, 12 high, less than nine tenths hidden. They get the detections of "
            f"{lidar} with those of {camera}."
        )
        if any(is_noise(image_source(name)) for name in settings.camera):
            text += " noisy-camera is an imitation made from truth."
        return text

    def remark(self, calibration: str) -> str:
        """Return which calibration fusions get, if not the rig's."""
        return f"Fusions get the calibration {calibration}." if calibration else ""


class FusionRow(NamedTuple):
    """A row of a board of fusions: a fusion, and the only sensor that it gets; empty: both."""

    name: str
    fusion: Spec
    alone: str = ""

    @property
    def mark(self) -> str | None:
        """The mark of one sensor alone; None for an entry with a rank."""
        return ONE_SENSOR if self.alone else None


def fusion_rows(entries: Sequence[Spec], options: JobOptions) -> list[FusionRow]:
    """Return the rows of entries, and of each sensor alone, whose detections are passed on."""
    rows = [FusionRow(str(entry), entry) for entry in dict.fromkeys(entries)]
    if options.marks:
        passed_on = FUSION.registry.resolve(PASSED_ON)
        rows += [FusionRow(alone, passed_on, alone) for alone in (LIDAR_ALONE, CAMERA_ALONE)]
    return rows
