"""The board of KITTI's odometry data: odometries on recorded scans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from roadscope.benchmarks.boards.board import (
    Breakdown,
    Column,
    Condition,
    JobOptions,
    Scores,
    mark_of,
)
from roadscope.benchmarks.boards.odometry import OdometryBoard, pose_scores
from roadscope.benchmarks.graph import Job
from roadscope.benchmarks.loop import RunOptions
from roadscope.benchmarks.metrics.odometry import DISTANCE
from roadscope.benchmarks.metrics.trajectory_errors import KITTI_EVERY, KITTI_M
from roadscope.benchmarks.nodes.poses import PoseNode
from roadscope.benchmarks.recorded.kitti_drive import KittiOdometryDrive
from roadscope.benchmarks.recorded.recording import SequenceSettings
from roadscope.benchmarks.recorded.suite import (
    DataFolder,
    KittiOdometrySettings,
    kitti_odometry_settings,
)
from roadscope.benchmarks.records import EpisodePoses
from roadscope.benchmarks.references import missing_for_poses
from roadscope.benchmarks.suite import Suite
from roadscope.core import Spec, SpecError
from roadscope.core.spec import ORACLE

UNKNOWN = ("dynamic_recall", "dynamic_precision")
"""Metrics that need to know which returns come from moving objects."""


def _columns() -> tuple[Column, ...]:
    """Return the columns of simulated traffic that have figures here: r_rel comes after t_rel."""
    columns = [each for each in OdometryBoard.columns if each.metric not in UNKNOWN]
    (turn,) = (each for each in columns if each.metric == "r_rel")
    columns.remove(turn)
    note = "t_rel: drift as KITTI defines it, over all stretches of all sequences."
    return (replace(columns[0], note=note), turn, *columns[1:])


class KittiOdometryBoard(OdometryBoard):
    """Ranks odometries on KITTI's sequences by translational drift."""

    name = "kitti odometry"
    simulated_board = OdometryBoard.name
    kitti_markers = (("sequences",),)
    settings_type = KittiOdometrySettings
    columns = _columns()
    breakdowns = (
        Breakdown(DISTANCE, "distance, m", "t_rel, r_rel: over all stretches of that length."),
        Breakdown("sequence"),
    )
    by_condition = ("t_rel", "r_rel", "ate", "end", "failed", "degraded")
    shown_parts = (
        Column("t_rel", "t_rel (%)"),
        Column("r_rel", "r_rel (degrees in 100 m)"),
        Column("end", "error of the last position (m)"),
    )
    conditions: Mapping[str, Condition] = {"sequence": lambda drive: drive.sequence.name}
    marks_notes: Mapping[str, str] = {}
    by_distance: Mapping[str, str] = {}
    sample = "sequences"

    def kitti_settings(self, place: DataFolder) -> Mapping[str, SequenceSettings]:
        """Return the settings of the board for all sequences."""
        return kitti_odometry_settings(place, self.simulated_board)

    def check_entry(self, spec: Spec) -> Spec:
        """Return an odometry's resolved spec; which returns move is not known here."""
        resolved = super().check_entry(spec)
        if resolved.kind == ORACLE:
            raise SpecError(f"'{spec}': KITTI does not say which returns come from moving objects")
        return resolved

    def jobs(self, suite: Suite, entries: Sequence[Spec], options: JobOptions) -> list[Job]:
        """Return every odometry on all sequences."""
        return [
            Job(
                self,
                str(source),
                drive,
                PoseNode(source, drive),
                mark=mark_of(source),
                missing=missing_for_poses(source),
            )
            for drive in suite.settings(self.name, KittiOdometrySettings).drives
            for source in dict.fromkeys(entries)
        ]

    def score(self, job: Job, answers: EpisodePoses, options: RunOptions) -> Scores:
        """Return the scores of the camera's poses, as KITTI's evaluation takes them."""
        assert isinstance(job.episode, KittiOdometryDrive)
        return pose_scores(
            answers,
            KITTI_M,
            trajectories=job.episode.of_camera(answers.trajectories),
            marks_m=KITTI_M,
            every=KITTI_EVERY,
            without_movers=True,
        )

    def explanation(self, suite: Suite) -> str:
        """Return as text which sequences there are, and which stretches they have."""
        return suite.settings(self.name, KittiOdometrySettings).remark


KITTI_ODOMETRY_BOARD = KittiOdometryBoard()
