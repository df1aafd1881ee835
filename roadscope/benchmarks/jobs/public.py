"""Public detections: one detector's on one episode, made once, the same for all who want them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from roadscope.benchmarks.cache import cache_dir, kept
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.fingerprint import code_hash, fingerprint, plugin_hash
from roadscope.benchmarks.jobs.stack import perceive, prints_aside
from roadscope.benchmarks.noisy import NOISES
from roadscope.benchmarks.oracle import ORACLE, full_name, made_from_truth
from roadscope.benchmarks.perceived import Perceived
from roadscope.detectors import DETECTORS

PERCEIVING = tuple(
    f"benchmarks/{name}.py"
    for name in ("jobs/stack", "perceived", "oracle", "noisy", "parked", "episode", "eligibility")
)
"""What detections depend on beside the detector and the episode."""


@dataclass(frozen=True)
class PublicDetections:
    """Whose detections, of what, and for which rule of what counts."""

    detector: str
    episode: Episode
    eligibility: Eligibility

    @cached_property
    def spec(self) -> Mapping[str, Any]:
        """Everything that the detections depend on."""
        return spec_of(self.detector, self._made_by(), self.episode)

    def _made_by(self) -> str:
        rule = fingerprint(self.eligibility)
        if self.detector == ORACLE:
            return rule
        if made_from_truth(self.detector):
            return fingerprint([rule, NOISES.make(self.detector)])
        return plugin_hash(DETECTORS.resolve(full_name(self.detector)))

    @property
    def detections_path(self) -> Path:
        """Where the detections are kept."""
        return path_of(self.spec)

    @prints_aside()
    def read(self, fresh: bool = False) -> Perceived:
        """Read the detections, or make and keep them."""
        make = partial(perceive, full_name(self.detector), self.episode, self.eligibility)
        return kept(self.detections_path, Perceived.load, make, anew=fresh)


def spec_of(detector: str, made_by: str, episode: Episode) -> Mapping[str, Any]:
    """Return everything that detections depend on; made_by: a hash of their maker."""
    return {
        "detector": detector,
        "by": made_by,
        "episode": episode.spec(),
        "code": code_hash(*PERCEIVING),
    }


def path_of(spec: Mapping[str, Any]) -> Path:
    """Where detections are kept."""
    return cache_dir() / "detections" / f"{fingerprint(spec)}.npz"
