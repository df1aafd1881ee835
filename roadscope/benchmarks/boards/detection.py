"""The detection board: LiDAR detectors."""

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
    call_cost,
    episodes,
    slow_calls_column,
    time_columns,
)
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.kinds import DETECTOR
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.breakdown import BANDS
from roadscope.benchmarks.metrics.detection import score_detections, score_detections_by_band
from roadscope.benchmarks.metrics.matching import Pairing
from roadscope.benchmarks.metrics.score import Score, mean
from roadscope.benchmarks.nodes.detections import DetectionNode
from roadscope.benchmarks.records import EpisodeDetections
from roadscope.benchmarks.references import (
    LOWER_MARK,
    ONE_CLUSTER,
    UPPER_MARK,
    detection_source,
    made_from_truth,
)
from roadscope.benchmarks.suite import Suite
from roadscope.core import Detections, Spec, Truth
from roadscope.core.spec import ORACLE

MARKS = {ORACLE: UPPER_MARK, ONE_CLUSTER: LOWER_MARK}
_EVERY_BAND = (
    "A false detection has no band: it counts in the AP of each, and there is no precision."
)
_NOTES = {
    "range": "Objects and their errors by the true range, false detections by their own.",
    "category": "Objects and their errors by the true category, false detections by their own.",
    "occlusion": "Occlusion: share of the object's rays that something else stopped. "
    + _EVERY_BAND,
    "points": f"Points: returns from the object. {_EVERY_BAND}",
    "score": "Scores are calibrated where precision lies within their band.",
    "weather": "Objects with too few returns because of fog or rain are not eligible.",
}
_TITLES = {
    "range": "range, m",
    "occlusion": "occlusion, % of rays",
    "points": "points on the object",
}


class DetectionBoard(Board):
    """Ranks LiDAR detectors by F1."""

    name = "detection"
    kind = DETECTOR
    headline = "f1"
    columns = (
        Column(
            "f1", "F1", 2, "F1, detected, precision: one to one, centres within 2 m from above."
        ),
        Column("detection_rate", "detected", 2),
        Column("precision", "precision", 2),
        *time_columns(2, "frame"),
        Column("false_alarms_per_frame", "false per frame", 2),
        Column("ap", "AP", 2, "AP: mean over gates of 0.5, 1, 2, 4 m."),
        Column("position_rmse_m", "pos. m", 2, "pos.: RMSE of matched centres."),
        Column("heading_rmse_deg", "head. deg", 1, "head.: RMSE of matched headings."),
        Column("ap_iou_50", "AP IoU.5", 2, "IoU: of boxes from above."),
        slow_calls_column(2),
        Column("category_accuracy", "category", 2, "category: share of right ones."),
        Column("size_rmse_m", "size m", 2, "size: RMSE of length and width."),
        Column("calibration_error", "cal. error", 2, "cal. error: of the scores (ECE)."),
        Column("ap_iou_70", "AP IoU.7", 2, "IoU: of boxes from above."),
        Column("heading_flips", "flipped", 3, "flipped: heading off by more than 45 degrees."),
        Column("longitudinal_rmse_m", "long. m", 2, "long., lat.: parts of pos. along and across."),
        Column("lateral_rmse_m", "lat. m", 2, "long., lat.: parts of pos. along and across."),
        Column("delay_s", "delay s", 2, "delay: from a frame to its answer."),
    )
    breakdowns = tuple(
        Breakdown(by, _TITLES.get(by, ""), _NOTES.get(by, "")) for by in (*BANDS, *CONDITIONS)
    )
    by_condition = (
        "f1",
        "detection_rate",
        "precision",
        "false_alarms_per_frame",
        "ap",
        "position_rmse_m",
        "heading_rmse_deg",
        "size_rmse_m",
        "objects_per_frame",
        "unseen_per_frame",
    )
    shown_parts = (
        Column("detection_rate", "detected"),
        Column("precision", "precision"),
        Column("f1", "F1"),
        Column("false_alarms_per_frame", "false alarms per frame"),
        Column("ap", "AP"),
        Column("position_rmse_m", "position RMSE (m)"),
        Column("heading_rmse_deg", "heading RMSE (degrees)"),
        Column("size_rmse_m", "size RMSE (m)"),
    )
    object_metric = "detection_rate"
    over_time = ("detection_rate", "precision")

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every detector on all episodes, and the oracle and one cluster as marks."""
        sources = {name: detection_source(name) for name in (MARKS if options.marks else ())}
        sources |= {str(entry): entry for entry in entries}
        return [
            Job(
                self,
                name,
                episode,
                DetectionNode(source, episode, suite.eligibility),
                mark=MARKS.get(name),
                settings=suite.eligibility,
            )
            for episode in episodes(suite)
            for name, source in sources.items()
        ]

    def score(self, job: Job, answers: EpisodeDetections, options: RunOptions) -> Scores:
        """Return the scores of a job's answers."""
        assert isinstance(job.answers, DetectionNode)
        source = job.answers.source
        return {
            **detection_scores(answers, job.settings, timed=not made_from_truth(source)),
            **detection_parts(answers, job.settings),
        }

    def box_scores(
        self, boxes: Sequence[Detections], truths: Sequence[Truth], pairings: Sequence[Pairing]
    ) -> Scores:
        """Return the scores of detections."""
        return score_detections(boxes, truths, pairings).named()

    def explanation(self, suite: Suite) -> str:
        """Return as text which objects are eligible."""
        return rule_in_words(suite.eligibility)


def rule_in_words(rule: Eligibility) -> str:
    """Return as text which objects are eligible."""
    near, far = rule.range_m
    families = " and ".join(f"{family}s" for family in rule.families)
    place = f"within {far:g} m" if near == 0 else f"{near:g} to {far:g} m away"
    return f"To be found: {families} {place} with at least {rule.min_returns} returns."


def detection_scores(
    answers: EpisodeDetections, rule: Eligibility, *, timed: bool = True
) -> dict[str, Score]:
    """Return a detector's scores on an episode. timed: with delay and times of calls.

    unseen_per_frame: objects that are not eligible for too few returns, the same for every entry.
    delay_s: from a frame to its answer, mean of the answered frames.
    """
    detections, truths = answers.detections, answers.truths
    pairings = rule.pairings(detections, truths, answers.parked)
    scores = score_detections(detections, truths, pairings).named()
    unseen = sum(rule.unseen(truth) for truth in truths)
    scores["unseen_per_frame"] = mean(unseen, len(truths), "1/frame")
    if not timed:
        return scores
    late_s = float(np.nansum(answers.delays_s))
    scores["delay_s"] = mean(late_s, answers.answered, "s")
    return scores | call_cost(answers.times)


def detection_parts(answers: EpisodeDetections, rule: Eligibility) -> dict[str, Score]:
    """Return a detector's scores on an episode, broken down."""
    detections, truths = answers.detections, answers.truths
    pairings = rule.pairings(detections, truths, answers.parked)
    return score_detections_by_band(detections, truths, pairings)
