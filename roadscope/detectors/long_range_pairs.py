"""The matched filter of three frames inside a detector: all vehicles of a scan in one call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.moving.links import Chain
from roadscope.detectors.pose.estimate import VehiclePose
from roadscope.detectors.pose.matched_filter import settled_reading
from roadscope.detectors.pose.pair_kernels import Filter
from roadscope.detectors.pose.rotating_pair import Frames, Plan, best_pair

FRAMES = 3
BIN_M, STEP_DEG = 0.04, 2.0
"""Bins as wide as the filter's edges, and a parabola finds the angle between two steps. Those of
the paper, half as wide, are no nearer and take twice as long."""


def pair_poses(
    moving: Sequence[tuple[Chain, int]], sizes: Sequence[tuple[float, float]], most: int
) -> list[VehiclePose]:
    """Return what `fit_multi` says of each vehicle in its sightings around one of them.

    moving: chains, and which sighting of each is answered. sizes: length and width of each, metres.
    most: returns of a sighting that are looked at, evenly chosen.
    """
    firsts = [max(0, min(at - 1, len(chain.sightings) - FRAMES)) for chain, at in moving]
    windows = [
        chain.sightings[first : first + FRAMES]
        for (chain, _), first in zip(moving, firsts, strict=True)
    ]
    seen = [s for window in windows for s in window]
    if not seen:
        return []
    settings, plan = settled_reading(*map(float, sizes[0]), bin_m=BIN_M, step_deg=STEP_DEG)
    found = best_pairs(
        (np.concatenate([s.points for s in seen]),
         np.concatenate([s.candidate.times_s for s in seen])),
        np.cumsum([0, *(len(s.points) for s in seen)]),
        np.cumsum([0, *map(len, windows)]),
        (np.array([s.origin for s in seen]), np.array([s.stamp_s for s in seen])),
        (np.array([chain.velocity for chain, _ in moving]), np.array(sizes, np.float64),
         np.array([at - first for (_, at), first in zip(moving, firsts, strict=True)])),
        (settings, plan, most),
    )  # fmt: skip
    return [
        VehiclePose(x, y, yaw, length, width, score=score)
        for (x, y, yaw, score), (length, width) in zip(found.tolist(), sizes, strict=True)
    ]


@compiled()
def best_pairs(
    returns: tuple[np.ndarray, np.ndarray],
    starts: np.ndarray,
    windows: np.ndarray,
    views: tuple[np.ndarray, np.ndarray],
    vehicles: tuple[np.ndarray, np.ndarray, np.ndarray],
    rules: tuple[Filter, Plan, int],
) -> np.ndarray:
    """Return what `best_pair` does of V vehicles, (V, 4).

    returns: (N, 3) places, metres, and (N,) seconds after the stamp, of W sightings one after the
    other; starts: (W + 1,) where each begins, windows: (V + 1,) where each vehicle's begin. views:
    of each sighting, (W, 2) the sensor and (W,) the stamp. vehicles: (V, 2) velocities, m/s, (V, 2)
    length and width, metres, and (V,) which sighting is answered. rules: filter, but for its sizes,
    and plan; returns of a sighting that are looked at.
    """
    (points, times_s), (origins, stamps_s) = returns, views
    (velocities, sizes, answered), (usual, plan, most) = vehicles, rules
    found = np.empty((len(answered), 4))
    for v in range(len(answered)):
        first, end = windows[v], windows[v + 1]
        places = np.empty((starts[end] - starts[first], 2))
        begins, count = np.zeros(end - first + 1, np.int64), 0
        for w in range(first, end):
            step = -(-(starts[w + 1] - starts[w]) // most)
            for i in range(starts[w], starts[w + 1], step):
                for k in range(2):
                    places[count, k] = points[i, k] - times_s[i] * velocities[v, k]
                count += 1
            begins[w - first + 1] = count
        frames = Frames(
            places[:count], begins, origins[first:end], stamps_s[first:end], answered[v]
        )
        settings = Filter(
            usual.bin_m, usual.sigma_m, usual.alpha, sizes[v, 0], sizes[v, 1], usual.power,
            usual.tie,
        )  # fmt: skip
        found[v] = best_pair(frames, settings, plan)
    return found
