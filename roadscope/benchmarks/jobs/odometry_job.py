"""One odometry on one episode: what it depends on, and how it is done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.fingerprint import code_hash, fingerprint, plugin_hash
from roadscope.benchmarks.jobs.base import KeyedJob, outcome_of
from roadscope.benchmarks.jobs.cost import cost
from roadscope.benchmarks.jobs.ride import Ride, ride
from roadscope.benchmarks.jobs.stack import prints_aside
from roadscope.benchmarks.jobs.store import Outcome
from roadscope.benchmarks.metrics.odometry import (
    SHORT_M,
    by_distance,
    score_moving,
    score_odometry,
    score_standing,
)
from roadscope.benchmarks.metrics.score import Score, ratio
from roadscope.benchmarks.noisy_odometry import ODOMETRY_NOISES, imitated
from roadscope.benchmarks.oracle_odometry import entry_of, method_of, spared
from roadscope.benchmarks.suite import Suite
from roadscope.odometry import ODOMETRIES

RIDING = tuple(
    f"benchmarks/{name}.py"
    for name in ("drive", "oracle_odometry", "noisy_odometry", "jobs/ride", "jobs/stack", "episode")
)
"""What poses depend on beside the odometry and the episode."""
SCORING = ("benchmarks/metrics", "benchmarks/jobs/odometry_job.py")


@dataclass(frozen=True)
class OdometryJob(KeyedJob):
    """What a worker is told: names and numbers, no objects.

    entry: how the board calls it. odometry: its spec, or an oracle's.
    lengths_m: of the stretches that drift is measured over.
    """

    entry: str
    odometry: str
    episode: Episode
    lengths_m: tuple[float, ...] = SHORT_M

    board = "odometry"
    tracker = None
    detector = ""
    scoring = SCORING

    @property
    def plugin(self) -> str:
        """The spec of what is called."""
        return method_of(self.odometry)

    @property
    def company(self) -> str:
        """With whom it may share a process: a stranger with its oracle alone, peers all."""
        return "" if self.ours or ODOMETRIES.resolve(self.plugin).ours else self.plugin

    @property
    def ours(self) -> bool:
        """Whether all that is called ships with this package: compiled peers may end a process."""
        if imitated(self.plugin):
            return True
        plugin = ODOMETRIES.resolve(self.plugin)
        return plugin.ours and plugin.requirement is None

    def content(self) -> Mapping[str, Any]:
        """Return what the poses depend on, and the stretches."""
        # Methods of ours share the ground and the clusters of detectors.
        rooms = ("detectors",) if self.company == "" else ()
        return {
            "odometry": self._made_by(),
            "episode": self.episode.spec(),
            "lengths_m": list(self.lengths_m),
            "code": code_hash(*RIDING, *rooms),
        }

    def _made_by(self) -> str:
        if imitated(self.plugin):
            return fingerprint(ODOMETRY_NOISES.make(self.plugin))
        return plugin_hash(ODOMETRIES.resolve(self.plugin))


def odometry_jobs(
    suite: Suite, odometries: Sequence[str], episodes: Sequence[Episode]
) -> list[OdometryJob]:
    """Every odometry on every episode."""
    return [
        OdometryJob(entry_of(spec), spec, episode, suite.odometry_lengths_m)
        for episode in episodes
        for spec in dict.fromkeys(odometries)
    ]


def execute_odometries(jobs: Sequence[OdometryJob]) -> list[Outcome]:
    """Do several jobs, one after the other."""
    return [execute_odometry(job) for job in jobs]


@prints_aside()
def execute_odometry(job: OdometryJob) -> Outcome:
    """Do a job; whatever goes wrong becomes its reason, nothing is raised."""
    spec = job.plugin
    if not imitated(spec) and (reason := ODOMETRIES.missing(spec)):
        return Outcome({}, f"{spec}: {reason}")

    def scores() -> Mapping[str, Score]:
        found = ride(job.odometry, job.episode)
        from_truth = spared(job.odometry) is not None or imitated(spec)
        return ride_scores(found, job.lengths_m, from_truth)

    return outcome_of(scores)


def ride_scores(
    found: Ride, lengths_m: Sequence[float] = SHORT_M, from_truth: bool = False
) -> dict[str, Score]:
    """Return an odometry's scores on an episode and what its calls cost.

    from_truth: what moves was taken out before, or is not looked at: there is none to be told.
    """
    told = {} if from_truth else score_moving(found.dynamic, found.moving).named()
    return {
        **score_odometry(found.both, lengths_m=lengths_m).named(),
        **score_standing(found.both, found.stamps_s).named(),
        "degraded": ratio(int(found.degraded.sum()), len(found.degraded), "lower"),
        **told,
        **(cost(found.calls_ms, (50, 90, 99)) if len(found.calls_ms) else {}),
        **by_distance(found.both),
    }
