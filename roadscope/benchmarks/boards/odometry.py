"""The odometry board: poses of the LiDAR from scans and inertial samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta

from roadscope.benchmarks.boards.board import (
    CONDITIONS,
    Board,
    Breakdown,
    Column,
    JobOptions,
    Scores,
    call_cost,
    episodes,
    mark_of,
    slow_calls_column,
    time_columns,
)
from roadscope.benchmarks.drive_steps import MOVING_M_S
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.kinds import ODOMETRY
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.odometry import (
    DISTANCE,
    MARKS_M,
    by_distance,
    score_moving,
    score_odometry,
    score_standing,
)
from roadscope.benchmarks.metrics.score import Score, ratio
from roadscope.benchmarks.metrics.trajectory_errors import SHORT_M, Trajectories
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.benchmarks.records import EpisodePoses
from roadscope.benchmarks.references import (
    check_pose_source,
    is_noise,
    missing_for_poses,
    pose_source,
)
from roadscope.benchmarks.suite import BoardSettings, Positive, Suite
from roadscope.core import Spec
from roadscope.core.spec import ORACLE

DYNAMIC_NOTE = "dyn.: returns that the odometry takes for those of moving objects."
ERROR_NOTE = "mean, std, min, max: of the positions' errors, mean of the episodes."


class OdometrySettings(BoardSettings, frozen=True, kw_only=True):
    """The table `[odometry]`; lengths_m: lengths of the stretches over which drift is measured."""

    lengths_m: Annotated[tuple[Positive, ...], Meta(min_length=1)] = SHORT_M


class OdometryBoard(Board):
    """Ranks odometries by translational drift."""

    name = "odometry"
    kind = ODOMETRY
    settings_type: type[BoardSettings] = OdometrySettings
    headline = "t_rel"
    columns: Sequence[Column] = (
        Column("t_rel", "t_rel %", 2, "t_rel: drift of the position as KITTI defines it."),
        Column("t_rel_median", "t_rel median", 2, "t_rel median: over the episodes."),
        Column(
            "failed",
            "failures",
            2,
            "failures: share of episodes that end more than 1 m and 5 % of the distance off.",
        ),
        *time_columns(1, "scan"),
        Column("r_rel", "r_rel deg", 2, "r_rel: degrees in 100 m."),
        Column(
            "ate",
            "ATE m",
            2,
            "ATE: RMSE of positions, end: error of the last; first poses aligned.",
        ),
        Column("end", "end m", 2),
        Column("false_motion", "false m", 2, "false: farthest estimated motion of a standing ego."),
        Column("below_1", "t_rel < 1 %", 2, "t_rel < 1 %: share of episodes."),
        Column("rpe", "RPE m", 3, "RPE: from scan to scan."),
        Column("call_p90_ms", "ms p90", 1),
        slow_calls_column(1),
        Column("dynamic_recall", "dyn. recall", 2, DYNAMIC_NOTE),
        Column("dynamic_precision", "dyn. prec.", 2, DYNAMIC_NOTE),
        Column("degraded", "degraded", 2, "degraded: share of scans whose pose is uncertain."),
        Column("rpe_rotation", "RPE deg", 3, "RPE: from scan to scan."),
        Column("error_max", "max m", 2, ERROR_NOTE),
        Column("error_mean", "mean m", 2, ERROR_NOTE),
        Column("error_std", "std m", 2, ERROR_NOTE),
        Column(
            "false_motion_end",
            "false end m",
            2,
            "false end: false motion at the end of a standstill.",
        ),
        Column("error_min", "min m", 2, ERROR_NOTE),
    )
    breakdowns = (
        Breakdown(
            DISTANCE,
            "distance, m",
            "t_rel: over all stretches of that length; position: after that distance.",
        ),
        *(Breakdown(by) for by in CONDITIONS),
    )
    by_condition: Sequence[str] = (
        "failed",
        "t_rel",
        "below_1",
        "r_rel",
        "end",
        "false_motion",
        "dynamic_precision",
        "dynamic_recall",
        "degraded",
    )
    shown_parts: Sequence[Column] = (
        Column("failed", "failure rate"),
        Column("t_rel", "t_rel (%)"),
        Column("end", "error of the last position (m)"),
        Column("position_error", "error of the position (m)"),
        Column("false_motion", "false motion of a standing ego (m)"),
        Column("dynamic_recall", "recall of dynamic returns"),
    )
    medians = ("t_rel",)
    marks_notes: Mapping[str, str] = {
        f"on {ORACLE}": f"without the returns of objects that move faster than {MOVING_M_S:g} m/s"
    }
    three_digits = True
    by_distance: Mapping[str, str] = {
        "t_rel": "t_rel (%)",
        "position_error": "error of the position (m)",
    }
    default_suite = "odometry"

    def check_entry(self, spec: Spec) -> Spec:
        """Return an odometry's resolved spec; oracles and noise models are entries too."""
        return check_pose_source(spec)

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every odometry on all episodes, and on scans without moving objects as marks."""
        ranked = [entry for entry in entries if mark_of(entry) is None]
        oracles = [pose_source(f"{ORACLE}?odometry={entry}") for entry in ranked]
        sources = dict.fromkeys([*entries, *(oracles if options.marks else [])])
        return [
            Job(
                self,
                _entry_name(source),
                episode,
                PoseNode(source, episode),
                mark=mark_of(source),
                settings=suite.settings(self.name, OdometrySettings).lengths_m,
                missing=missing_for_poses(source),
            )
            for episode in episodes(suite)
            for source in sources
        ]

    def score(self, job: Job, answers: EpisodePoses, options: RunOptions) -> Scores:
        """Return the scores of a job's answers."""
        assert isinstance(job.answers, PoseNode)
        source = job.answers.source
        return pose_scores(
            answers, job.settings, without_movers=source.kind == ORACLE or is_noise(source)
        )

    def is_silent(self, metric: str, scores: Sequence[Scores]) -> bool:
        """Return whether this is the recall of an odometry that marks no return as dynamic."""
        if metric != "dynamic_recall":
            return False
        return not any(each["dynamic_precision"].n for each in scores if metric in each)

    def explanation(self, suite: Suite) -> str:
        """Return as text over which lengths drift is measured."""
        lengths_m = suite.settings(self.name, OdometrySettings).lengths_m
        *lengths, last = (f"{length_m:g}" for length_m in lengths_m)
        over = f"{', '.join(lengths)} and {last}" if lengths else last
        return f"Drifts t_rel and r_rel are over stretches of {over} m, as KITTI defines them."


def pose_scores(
    answers: EpisodePoses,
    lengths_m: Sequence[float] = SHORT_M,
    *,
    trajectories: Trajectories | None = None,
    marks_m: Sequence[float] = MARKS_M,
    every: int = 1,
    without_movers: bool = False,
) -> dict[str, Score]:
    """Return an odometry's scores on an episode and the times of its calls.

    lengths_m, marks_m: lengths of the stretches over which drift is measured, all together and
        broken down. every: of how many frames one begins a stretch.
    trajectories: that are compared; None: those of the LiDAR.
    without_movers: its scans had no moving objects, or were not used: dynamic returns are not
        scored.
    """
    both = answers.trajectories if trajectories is None else trajectories
    timed = len(answers.times.wall_ms) > 0
    moving = score_moving(answers.dynamic, answers.moving).named() if not without_movers else {}
    return {
        **score_odometry(both, lengths_m=lengths_m, every=every).named(),
        **score_standing(both, answers.stamps_s).named(),
        "degraded": ratio(int(np.sum(answers.degraded)), len(answers.degraded), "lower"),
        **moving,
        **(call_cost(answers.times, (50, 90, 99)) if timed else {}),
        **by_distance(both, marks_m, every=every),
    }


def _entry_name(source: Spec) -> str:
    odometry = source.parts.get(ODOMETRY.name)
    return str(source) if odometry is None else f"{odometry} on {ORACLE}"
