"""The camera board: camera detectors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
    episodes,
    mark_of,
    slow_calls_column,
    time_columns,
)
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.kinds import CAMERA_DETECTOR
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.image_detection import camera_scores
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.nodes.images import ImageNode, extinction_per_m
from roadscope.benchmarks.records import EpisodeImageDetections
from roadscope.benchmarks.references import check_image_source, image_source, made_from_truth
from roadscope.benchmarks.suite import BoardSettings, Positive, Suite
from roadscope.core import Spec
from roadscope.core.spec import ORACLE

_TITLES = {"size": "size in the image", "range": "range, m"}
_NOTES = {
    "size": "small: below 32 x 32 pixels, large: above 96 x 96.",
    "occlusion": "Occlusion: share of the outline that something else covers.",
    "score": "Scores are calibrated where precision lies within their band.",
}


class CameraSettings(BoardSettings, frozen=True, kw_only=True):
    """The table `[camera]`; every_s: seconds from one image to the next."""

    every_s: Positive = 0.5


class CameraBoard(Board):
    """Ranks camera detectors by AP50."""

    name = "camera"
    kind = CAMERA_DETECTOR
    settings_type = CameraSettings
    headline = "ap50"
    columns = (
        Column(
            "ap50",
            "AP50",
            2,
            "AP50: from an IoU of 0.5, mean of the families; episodes are "
            "weighed by their objects.",
        ),
        Column("ap", "AP", 2, "AP: IoU 0.5 to 0.95."),
        Column("detection_rate", "detected", 2, "detected, false: from a score of 0.5."),
        *time_columns(1, "image"),
        Column("false_alarms", "false per image", 2),
        Column("category_accuracy", "category", 2, "category: share of right ones."),
        Column("calibration_error", "cal. error", 2, "cal. error: of the scores (ECE)."),
        slow_calls_column(1),
        Column("ap50_16px", "AP50 16 px", 2, "16 px: of objects at least that high."),
    )
    breakdowns = tuple(
        Breakdown(by, _TITLES.get(by, ""), _NOTES.get(by, ""))
        for by in ("family", "size", "range", "occlusion", "category", "score", *CONDITIONS)
    )
    by_condition = ("ap50", "detection_rate", "false_alarms", "objects_per_image")
    shown_parts = (
        Column("ap50", "AP50"),
        Column("detection_rate", "detected"),
        Column("precision", "precision"),
    )
    object_metric = "detection_rate"
    alarms = "false alarms per image"
    always_by = ("family", "detection_rate")
    default_suite = "camera"

    def check_entry(self, spec: Spec) -> Spec:
        """Return a camera detector's resolved spec; noise models are entries too."""
        return check_image_source(spec)

    def suite_checks(self, suite: Suite) -> list[SuiteCheck]:
        """Return the check of the rig."""
        return [SuiteCheck("camera", check_camera, suite)] if self.suite_entries(suite) else []

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every detector on all episodes, and the true boxes as a mark."""
        check_camera(suite)
        every_s = suite.settings(self.name, CameraSettings).every_s
        sources = {str(entry): entry for entry in entries}
        if options.marks:
            sources[ORACLE] = image_source(ORACLE)
        return [
            Job(self, name, episode, ImageNode(source, episode, every_s), mark=mark_of(source))
            for episode in episodes(suite)
            for name, source in sources.items()
        ]

    def score(self, job: Job, answers: EpisodeImageDetections, options: RunOptions) -> Scores:
        """Return the scores of a job's answers, and times of calls unless made from truth."""
        assert isinstance(job.answers, ImageNode)
        scores = image_scores(answers, job.answers.episode)
        if made_from_truth(job.answers.source):
            return scores
        has_image = np.array([d is not None for d in answers.detections], bool)
        return scores | call_cost(answers.times.select(has_image))

    def explanation(self, suite: Suite) -> str:
        """Return as text which objects are eligible."""
        return (
            "To be found in images: road users with at least 40 visible pixels, 8 pixels high, at "
            "most three quarters hidden and not lost in fog or rain; parked cars are neither "
            "misses nor false alarms."
        )


def image_scores(answers: EpisodeImageDetections, episode: Episode) -> dict[str, Score]:
    """Return a camera detector's scores on an episode, without times of calls."""
    return camera_scores(answers.filled, answers.labels(extinction_per_m(episode)))
