"""Joins fragments of one target's trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from roadscope.trackers.assignment import assign_greedily
from roadscope.trackers.gating import chi_square_gate
from roadscope.trackers.offline_noise import carried
from roadscope.trackers.offline_trajectories import COLUMNS, NOISES, Trajectory

# Round figures set by hand: bodies and gaps that no tracker would join are not joined.
SHARE = 0.99
"""Of right pairs, so many lie within the gate."""
SIZE_RATIO = 1.5
"""Bodies that differ by more in any direction are two."""
FURTHEST_M = 2.0
"""Standard deviation of places beyond which nothing can be said."""
LEAST_SEEN = 3
"""Velocities of shorter fragments say too little."""


def linked(fragments: Sequence[Trajectory], longest_gap_s: float) -> list[Trajectory]:
    """Join each end with the beginning that motion leads to; the likeliest pairs go first.

    Gaps are filled with what was expected there; ids of the earlier parts stay.
    """
    gate = chi_square_gate(SHARE, 2)
    costs = np.full((len(fragments), len(fragments)), np.inf)
    for i, early in enumerate(fragments):
        for j, late in enumerate(fragments):
            gap = late.stamps_s[0] - early.stamps_s[-1]
            if 0 < gap <= longest_gap_s and _alike(early, late):
                costs[i, j] = _distance(early, late, gap)
    follower = dict(zip(*(k.tolist() for k in assign_greedily(costs, gate)), strict=True))
    firsts = sorted(set(range(len(fragments))) - set(follower.values()))
    return [_chained(fragments, first, follower) for first in firsts]


def _alike(early: Trajectory, late: Trajectory) -> bool:
    if early.category != late.category or min(early.seen.sum(), late.seen.sum()) < LEAST_SEEN:
        return False
    ratio = np.abs(np.log(early.sizes[-1] / late.sizes[0]))
    return bool((ratio < np.log(SIZE_RATIO)).all())


def _distance(early: Trajectory, late: Trajectory, gap: float) -> float:
    """Return the squared Mahalanobis distance of the late beginning from where motion leads."""
    mean, covariance = _led(early, gap)
    off = late.means[0, :2] - mean[:2]
    spread = covariance[:2, :2] + late.covariances[0, :2, :2] + late.offsets[0]
    if np.trace(spread) > FURTHEST_M**2:
        return np.inf
    return float(off @ np.linalg.solve(spread, off))


def _led(early: Trajectory, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return state and covariance some seconds after the end."""
    end, spread = early.means[-1], early.covariances[-1]
    return carried(end, spread, early.walks[-1], early.drifts[-1], dt)


def _chained(fragments: Sequence[Trajectory], first: int, follower: dict[int, int]) -> Trajectory:
    whole, at = fragments[first], first
    while at in follower:
        at = follower[at]
        whole = _joined(whole, fragments[at])
    return whole


def _joined(early: Trajectory, late: Trajectory) -> Trajectory:
    """Put two parts together, the ticks between carried on from the earlier."""
    ticks = np.arange(early.ticks[-1] + 1, late.ticks[0])
    share = (ticks - early.ticks[-1]) / (late.ticks[0] - early.ticks[-1])
    stamps = early.stamps_s[-1] + share * (late.stamps_s[0] - early.stamps_s[-1])
    states = [_led(early, stamp - early.stamps_s[-1]) for stamp in stamps]
    n = len(ticks)
    between = {
        "ticks": ticks, "stamps_s": stamps,
        "means": np.array([mean for mean, _ in states]).reshape(n, 4),
        "covariances": np.array([spread for _, spread in states]).reshape(n, 4, 4),
        **{name: np.tile(getattr(early, name)[-1], (n, 1, 1)) for name in NOISES},
        "heights": early.heights[-1] + share * (late.heights[0] - early.heights[-1]),
        "sizes": np.tile(early.sizes[-1], (n, 1)), "yaws": np.full(n, early.yaws[-1]),
        "scores": np.full(n, early.scores[-1]), "seen": np.zeros(n, bool),
    }  # fmt: skip
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(early, name), between[name], getattr(late, name)])
        for name in COLUMNS
    }
    return replace(early, **columns)
