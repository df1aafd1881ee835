"""The pass over finished tracks: with all frames at hand, each is told anew.

What it gives is no longer online: frame t is told with frames after t.
"""

from __future__ import annotations

from collections.abc import Sequence

from roadscope.core import Tracks
from roadscope.trackers.offline_links import linked
from roadscope.trackers.offline_noise import MotionNoise
from roadscope.trackers.offline_smoothing import Rescoring, smoothed
from roadscope.trackers.offline_trajectories import Trajectory, told, trajectories


def rescored(
    history: Sequence[Tracks],
    rules: Rescoring | None = None,
    noises: Sequence[MotionNoise] | None = None,
) -> list[Tracks]:
    """Smooth tracks, fill their gaps, join fragments, drop weak ones; one score for each whole.

    history: what a tracker said, tick by tick, tentative tracks included, in one frame that
        stands still; states must be of constant velocity while a target is unseen.
    noises: of each record what the tracker took its tracks to wander by until the next, and which
        errors last; None: all wander alike, by `Rescoring.velocity_walk`, and no error lasts.
    Returns as many records, with states confirmed where a target was seen and coasting between.
    A tentative beginning is told from its first detection on, and no track after its last.
    """
    rules = rules or Rescoring()
    if noises is None:
        noises = [MotionNoise.alike(len(tracks), rules.velocity_walk) for tracks in history]
    strong = [t for t in trajectories(history, noises) if _strong(t, rules)]
    kept = linked(strong, rules.longest_gap_s)
    return told([smoothed(t, rules) for t in kept], history)


def _strong(trajectory: Trajectory, rules: Rescoring) -> bool:
    return bool(trajectory.seen.sum() >= rules.least_seen and trajectory.score >= rules.least_score)
