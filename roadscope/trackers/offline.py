"""The pass over finished tracks: with all frames at hand, each is told anew.

What it gives is no longer online: frame t is told with frames after t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from roadscope.core import Tracks
from roadscope.trackers.offline_links import linked
from roadscope.trackers.offline_smoothing import smoothed
from roadscope.trackers.offline_trajectories import Trajectory, told, trajectories


@dataclass(frozen=True, slots=True)
class Rescoring:
    """How tracks are told anew.

    velocity_walk: m/s per root second by which velocities are taken to wander.
    fade_s: time over which heights and headings are averaged, to either side.
    size_fade_s: likewise sizes, of bodies that do not change.
    longest_gap_s: time over which fragments are joined.
    least_score: tracks whose mean score is lower are dropped.
    least_seen: tracks with fewer detections are dropped.
    """

    velocity_walk: float = 1.2
    fade_s: float = 0.3
    size_fade_s: float = 2.0
    longest_gap_s: float = 2.5
    least_score: float = 0.6
    least_seen: int = 3


def rescored(history: Sequence[Tracks], rules: Rescoring | None = None) -> list[Tracks]:
    """Smooth tracks, fill their gaps, join fragments, drop weak ones; one score for each whole.

    history: what a tracker said, tick by tick, tentative tracks included, in one frame that
        stands still; states must be of constant velocity while a target is unseen.
    Returns as many records, with states confirmed where a target was seen and coasting between.
    A tentative beginning is told from its first detection on, and no track after its last.
    """
    rules = rules or Rescoring()
    strong = [t for t in trajectories(history) if _strong(t, rules)]
    kept = linked(strong, rules.longest_gap_s, rules.velocity_walk)
    return told(
        [smoothed(t, rules.velocity_walk, rules.fade_s, rules.size_fade_s) for t in kept], history
    )


def _strong(trajectory: Trajectory, rules: Rescoring) -> bool:
    return bool(trajectory.seen.sum() >= rules.least_seen and trajectory.score >= rules.least_score)
