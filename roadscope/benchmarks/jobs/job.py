"""One entry on one episode: what it depends on, and how it is done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.benchmarks.cache import kept
from roadscope.benchmarks.ego import odometry_told, split_ego, tracker_of
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.fingerprint import code_hash, fingerprint, plugin_hash
from roadscope.benchmarks.jobs.base import KeyedJob, outcome_of
from roadscope.benchmarks.jobs.cost import cost
from roadscope.benchmarks.jobs.ego_poses import told_content, track_told
from roadscope.benchmarks.jobs.fused import FusedSpec, perceive_fused
from roadscope.benchmarks.jobs.public import PERCEIVING, PublicDetections, path_of, spec_of
from roadscope.benchmarks.jobs.stack import (
    offline,
    perceive,
    prints_aside,
    weighed,
)
from roadscope.benchmarks.jobs.store import Outcome
from roadscope.benchmarks.metrics.breakdown import broken_down
from roadscope.benchmarks.metrics.detection import score_detections
from roadscope.benchmarks.metrics.score import Score, mean
from roadscope.benchmarks.metrics.tracking import score_tracks
from roadscope.benchmarks.metrics.tracking.alphas import score_alphas
from roadscope.benchmarks.noisy_odometry import imitated
from roadscope.benchmarks.oracle import full_name, is_fused, made_from_truth
from roadscope.benchmarks.oracle_odometry import method_of
from roadscope.benchmarks.perceived import Perceived
from roadscope.benchmarks.recorded.recording import OFFLINE, Recording
from roadscope.core import Tracks
from roadscope.odometry import ODOMETRIES
from roadscope.trackers import TRACKERS

SCORING = ("benchmarks/metrics", "benchmarks/eligibility.py", "benchmarks/jobs/job.py")
"""What scores depend on beside the detections."""
RECORDED_SCORING = (
    "benchmarks/formats",
    *(
        f"benchmarks/recorded/{name}.py"
        for name in ("kitti_scores", "combined", "recording", "mot", "image_plane")
    ),
)
"""And on recorded episodes."""


@dataclass(frozen=True)
class Job(KeyedJob):
    """What a worker is told: names and numbers, no objects.

    board: `detection`, `tracking` or one of `RECORDED_BOARDS`.
    entry: how the board calls it.
    detector, tracker: specs; a detection job has no tracker. Of recorded episodes the detector
        is whose detections are on disk. A tracker's says whose poses of the ego it is told, too
        (`ego.split_ego`).
    episode: where frames or detections come from: simulated traffic or a recording.
    """

    board: str
    entry: str
    detector: str
    tracker: str | None
    episode: Episode | Recording
    eligibility: Eligibility

    @cached_property
    def detections_spec(self) -> Mapping[str, Any]:
        """Everything that the detections depend on."""
        episode = self.episode
        if isinstance(episode, Recording):
            return {"episode": episode.spec(), "code": code_hash(*PERCEIVING)}
        if is_fused(self.detector):
            made_by = FusedSpec.parse(self.detector).made_by(episode, self.eligibility, 0.0)
            return spec_of(self.detector, made_by, episode)
        return PublicDetections(self.detector, episode, self.eligibility).spec

    @property
    def scoring(self) -> tuple[str, ...]:
        """Files that scores depend on; more of them on recorded episodes."""
        return SCORING + (RECORDED_SCORING if isinstance(self.episode, Recording) else ())

    def content(self) -> Mapping[str, Any]:
        """Return what detections depend on, and who tracks them."""
        content = {
            "tracker": None,
            "detections": self.detections_spec,
            "eligibility": fingerprint(self.eligibility),
        }
        if self.tracker is None:
            return content
        tracker, ego = split_ego(self.tracker)
        content["tracker"] = plugin_hash(TRACKERS.resolve(tracker))
        return {**content, **told_content(ego, self.episode)}

    @property
    def detections_path(self) -> Path:
        """Where the detections are kept."""
        return path_of(self.detections_spec)


@prints_aside()
def execute(job: Job, fresh: bool = False) -> Outcome:
    """Do a job; whatever goes wrong becomes its reason, nothing is raised."""
    if job.tracker is not None and (reason := missing_of(job.tracker)):
        return Outcome({}, f"{job.tracker}: {reason}")
    return outcome_of(lambda: job_scores(job, fresh))


def missing_of(tracker: str) -> str | None:
    """Say what is not installed of a tracker, or of the odometry that tells it where the ego is."""
    odometry, unmet = odometry_told(tracker), TRACKERS.missing(tracker_of(tracker))
    if unmet or odometry is None or imitated(odometry):
        return unmet
    return ODOMETRIES.missing(method_of(odometry))


def job_scores(job: Job, fresh: bool = False) -> dict[str, Score]:
    """Return the scores of a job's detections or tracks."""
    perceived = detections_of(job, fresh and job.tracker is None)
    if job.tracker is None:
        whole = detection_scores(job.detector, perceived, job.eligibility)
        return {**whole, **detection_parts(perceived, job.eligibility)}
    plugin = tracker_of(job.tracker)
    unsure = isinstance(job.episode, Recording) and weighed(plugin)
    tracks, calls_ms = track_told(job.tracker, perceived, job.episode, unsure=unsure)
    if isinstance(job.episode, Recording):
        return recorded_scores(plugin, tracks, calls_ms, job.episode)
    scores = tracking_scores(tracks, calls_ms, perceived, job.eligibility)
    scores |= tracking_parts(tracks, perceived, job.eligibility)
    return scores | passed(len(tracks)) if offline(plugin) else scores


@prints_aside()
def detections_of(job: Job, fresh: bool = False) -> Perceived:
    """Read the detections of an episode, or make and keep them."""
    if isinstance(job.episode, Recording):
        return job.episode.replayed()
    make = partial(perceived_by, job.detector, job.episode, job.eligibility)
    return kept(job.detections_path, Perceived.load, make, anew=fresh)


def perceived_by(detector: str, episode: Episode, eligibility: Eligibility) -> Perceived:
    """Run whatever makes detections in space over an episode, a fusion with its sensors too."""
    if is_fused(detector):
        return perceive_fused(detector, episode, eligibility)
    return perceive(full_name(detector), episode, eligibility)


def detection_scores(
    detector: str, perceived: Perceived, eligibility: Eligibility
) -> dict[str, Score]:
    """Return a detector's scores on an episode; its delay and cost, unless made from truth.

    unseen_per_frame: objects that do not count for want of returns, the same for every entry.
    delay_s: from a frame to its answer, mean of the answered ones.
    """
    found, truths = perceived.detections, perceived.truths
    pairings = eligibility.pairings(found, truths, perceived.parked)
    scores = score_detections(found, truths, pairings).named()
    unseen = sum(eligibility.unseen(truth) for truth in truths)
    scores["unseen_per_frame"] = mean(unseen, len(truths), "1/frame")
    if made_from_truth(detector):
        return scores
    late_s = float(np.nansum(perceived.delays_s))
    return {**scores, "delay_s": mean(late_s, perceived.answered, "s"), **cost(perceived.calls_ms)}


def detection_parts(perceived: Perceived, eligibility: Eligibility) -> dict[str, Score]:
    """Return a detector's scores on an episode, broken down."""
    found, truths = perceived.detections, perceived.truths
    return broken_down(found, truths, eligibility.pairings(found, truths, perceived.parked))


def tracking_scores(
    tracks: Sequence[Tracks], calls_ms: np.ndarray, perceived: Perceived, eligibility: Eligibility
) -> dict[str, Score]:
    """Return a tracker's scores on an episode, and its cost."""
    pairings = eligibility.pairings(tracks, perceived.truths, perceived.parked)
    return score_tracks(tracks, perceived.truths, pairings).named() | cost(calls_ms)


def tracking_parts(
    tracks: Sequence[Tracks], perceived: Perceived, eligibility: Eligibility
) -> dict[str, Score]:
    """Return a tracker's scores on an episode, broken down."""
    pairings = eligibility.pairings(tracks, perceived.truths, perceived.parked)
    return score_alphas(tracks, perceived.truths, pairings)


def recorded_scores(
    tracker: str, tracks: Sequence[Tracks], calls_ms: np.ndarray, recording: Recording
) -> dict[str, Score]:
    """Return a tracker's scores on a recording, its cost, and whether it is an offline one."""
    which = passed(len(tracks), offline(tracker))
    return recording.scores(tracks) | which | cost(calls_ms)


def passed(frames: int, later: bool = True) -> dict[str, Score]:
    """Return the mark of a tracker that looks at frames that were still to come, or not."""
    return {OFFLINE: Score(float(later), "1", "lower", frames)}
