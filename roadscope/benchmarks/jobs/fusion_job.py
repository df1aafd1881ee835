"""One fusion on one episode, given one LiDAR's and one camera's detections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.base import KeyedJob, outcome_of
from roadscope.benchmarks.jobs.camera_job import CameraJob
from roadscope.benchmarks.jobs.cost import cost
from roadscope.benchmarks.jobs.fused import CAMERA_ALONE, LIDAR_ALONE, FusedSpec, Moments, fuse
from roadscope.benchmarks.jobs.job import Job
from roadscope.benchmarks.jobs.odometry_job import OdometryJob
from roadscope.benchmarks.jobs.stack import prints_aside
from roadscope.benchmarks.jobs.store import Outcome
from roadscope.benchmarks.metrics.fusion_parts import fusion_scores
from roadscope.benchmarks.metrics.score import Score
from roadscope.fusion import FUSIONS

SCORING = ("benchmarks/metrics", "benchmarks/jobs/fusion_job.py")
ALONE = (LIDAR_ALONE, CAMERA_ALONE)
"""What one sensor finds without the other: marks of the board."""


@dataclass(frozen=True)
class FusionJob(KeyedJob):
    """What a worker is told: names and numbers, no objects.

    entry: how the board calls it. given: whose detections are joined, and by what.
    every_s: from scan to scan.
    """

    entry: str
    given: FusedSpec
    episode: Episode
    eligibility: Eligibility
    every_s: float

    board = "fusion"
    tracker = None
    scoring = SCORING

    @property
    def detector(self) -> str:
        """Whose detections are joined, in words."""
        return f"{self.given.lidar} + {self.given.camera}"

    @property
    def company(self) -> str:
        """With whom it may share a process: the same fusion of other detections."""
        return self.entry

    @property
    def ours(self) -> bool:
        """Whether what is called ships with this package."""
        return self.given.fusion in ALONE or FUSIONS.resolve(self.given.fusion).ours

    def content(self) -> Mapping[str, Any]:
        """Return whose detections are joined, and by what."""
        return {
            "given": self.detector,
            "fused": self.given.made_by(self.episode, self.eligibility, self.every_s),
            "every_s": self.every_s,
        }


AnyJob = Job | CameraJob | FusionJob | OdometryJob


def execute_fusions(jobs: Sequence[FusionJob]) -> list[Outcome]:
    """Do several jobs, one after the other."""
    return [execute_fusion(job) for job in jobs]


@prints_aside()
def execute_fusion(job: FusionJob) -> Outcome:
    """Do a job; whatever goes wrong becomes its reason, nothing is raised."""

    def scores() -> Mapping[str, Score]:
        moments = fuse(job.given, job.episode, job.eligibility, job.every_s)
        return moment_scores(moments, marked=job.given.fusion in ALONE)

    return outcome_of(scores)


def moment_scores(moments: Moments, *, marked: bool = False) -> dict[str, Score]:
    """Return the scores of an episode's fused targets, and what fusing them took."""
    scores = fusion_scores(moments.fused, moments.targets)
    return scores if marked else scores | cost(moments.calls_ms)
