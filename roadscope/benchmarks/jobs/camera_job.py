"""One camera detector on one episode: what it depends on, and how it is done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from roadscope.benchmarks.cache import cache_dir, kept
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.fingerprint import code_hash, fingerprint, package_version, plugin_hash
from roadscope.benchmarks.jobs.base import KeyedJob, outcome_of
from roadscope.benchmarks.jobs.cost import cost
from roadscope.benchmarks.jobs.look import air_of, drawn_from_truth, look
from roadscope.benchmarks.jobs.stack import prints_aside
from roadscope.benchmarks.jobs.store import Outcome
from roadscope.benchmarks.metrics.image_parts import camera_scores
from roadscope.benchmarks.metrics.score import Score
from roadscope.benchmarks.noisy_camera import CAMERA_NOISES
from roadscope.benchmarks.oracle import ORACLE
from roadscope.benchmarks.seen import Seen
from roadscope.detectors.camera import CAMERA_DETECTORS

LOOKING = (
    *(
        f"benchmarks/{name}.py"
        for name in (
            "jobs/look", "jobs/stack", "seen", "perceived", "noisy_camera", "images", "episode",
            "parked_boxes", "metrics/image_labels",
        )
    ),
    "fusion/pairing.py",
)  # fmt: skip
"""What detections in images depend on beside the detector and the episode."""
SCORING = ("benchmarks/metrics", "benchmarks/jobs/camera_job.py")


@dataclass(frozen=True)
class CameraJob(KeyedJob):
    """What a worker is told: names and numbers, no objects.

    entry: how the board calls it. detector: its spec. every_s: from image to image.
    scans: images are the nearest ones to scans so far apart.
    """

    entry: str
    detector: str
    episode: Episode
    every_s: float
    scans: bool = False

    board = "camera"
    tracker = None
    scoring = SCORING

    @property
    def ours(self) -> bool:
        """Whether what is called ships with this package."""
        return drawn_from_truth(self.detector) or CAMERA_DETECTORS.resolve(self.detector).ours

    @cached_property
    def detections_spec(self) -> Mapping[str, Any]:
        """Everything that the detections depend on, weights and the library that runs them too."""
        return {
            "detector": self.detector,
            "by": self._made_by(),
            "episode": self.episode.spec(),
            "every_s": [self.every_s, self.scans],
            "code": code_hash(*LOOKING),
        }

    def _made_by(self) -> str:
        if self.detector == ORACLE:
            return ORACLE
        if drawn_from_truth(self.detector):
            return fingerprint(CAMERA_NOISES.make(self.detector))
        plugin = CAMERA_DETECTORS.resolve(self.detector)
        return fingerprint([plugin_hash(plugin), package_version("torch")])

    def content(self) -> Mapping[str, Any]:
        """Return what the detections depend on."""
        return {"detections": self.detections_spec}

    @property
    def detections_path(self) -> Path:
        """Where the detections are kept."""
        return cache_dir() / "image-detections" / f"{fingerprint(self.detections_spec)}.npz"


@prints_aside()
def seen_of(job: CameraJob, fresh: bool = False) -> Seen:
    """Read the detections in an episode's images, or make and keep them."""
    make = partial(look, job.detector, job.episode, job.every_s, scans=job.scans)
    return kept(job.detections_path, Seen.load, make, anew=fresh)


@prints_aside()
def execute_camera(job: CameraJob, fresh: bool = False) -> Outcome:
    """Do a job; whatever goes wrong becomes its reason, nothing is raised."""
    return outcome_of(lambda: image_scores(job, seen_of(job, fresh)))


def image_scores(job: CameraJob, seen: Seen) -> dict[str, Score]:
    """Return a detector's scores on an episode, and its cost unless made from truth."""
    scores = camera_scores(seen.found, seen.labels(air_of(job.episode)))
    if drawn_from_truth(job.detector):
        return scores
    there = [d is not None for d in seen.detections]
    return scores | cost(seen.calls_ms[there])
