"""How a sensor moved between the features of two scans (Zhang and Singh 2017; Zhang 2022, 2.3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from roadscope.odometry.loam.features import Features
from roadscope.odometry.loam.lm_kernels import bisquare, descend, distances, normal_equations
from roadscope.odometry.loam.pair_kernels import Pairs, lines_of, planes_of
from roadscope.odometry.loam.ring_table import RingTable, ring_table
from roadscope.odometry.rigid import inverse, log_se3, orthonormal

ALL = (True,) * 6
LOOKS = 15
"""So often neighbours are looked for at most."""
SHIFT_M, TURN_RAD = 1e-4, 1e-5
"""The search ends with less; far below what two scans tell."""
WIDER = (16.0, 16.0, 8.0, 4.0, 2.0, 1.0)
"""From one look to the next, how much wider the bisquare is."""
NOISE_M = 0.02
"""No feature is surer than a return's range noise."""


@dataclass(frozen=True, slots=True, eq=False)
class FeatureMatch:
    """A motion from features.

    before_from_now: (4, 4). information: (6, 6), of a shift, metres, and a turn about the
        sensor, radians, along the axes of the frame before; by the scatter of the features.
    residual_m: weighted root mean square distance; nan without pairs. held: pairs that count.
    """

    before_from_now: np.ndarray
    information: np.ndarray
    residual_m: float
    held: int


def match_features(
    now: Features, before: Features, start: np.ndarray, *, edges: bool = True,
    planes: bool = True, same_label: bool = True, free: tuple[bool, ...] = ALL,
    reach_m: float = 5.0,
) -> FeatureMatch:  # fmt: skip
    """Return the motion that brings edges onto lines and planes onto planes of the scan before.

    start: (4, 4) `before_from_now`, whence to look. same_label: only within clusters of one
        label. free: which of x, y, z, roll, pitch, yaw are sought; others stay as they start.
    reach_m: how far neighbours are looked for.
    """
    looks: list[Callable[[np.ndarray], Pairs]] = []
    if edges:
        rows = slice(now.sharp)
        table = ring_table(before.edges, before.edge_rings, before.edge_labels)
        labels = _labels(now.edge_labels[rows], same_label)
        looks.append(_look(lines_of, (now.edges[rows], labels, now.edge_rings[rows]), table,
                           reach_m))  # fmt: skip
    if planes:
        rows = slice(now.flat)
        table = ring_table(before.planes, before.plane_rings, before.plane_labels)
        labels = _labels(now.plane_labels[rows], same_label)
        looks.append(_look(planes_of, (now.planes[rows], labels, now.plane_rings[rows]), table,
                           reach_m))  # fmt: skip
    return settle(looks, start, free)


def settle(
    looks: list[Callable[[np.ndarray], Pairs]], start: np.ndarray, free: tuple[bool, ...] = ALL,
    most: int = LOOKS,
) -> FeatureMatch:  # fmt: skip
    """Return the motion at which pairs, looked for again and again, are nearest.

    looks: each from a (4, 4) motion to pairs of one kind. Tukey's bisquare of the kind's own
    scatter weighs them (Zhang and Singh's weights have this form), and a wider one at first:
    most pairs are of ground and walls along the way, and fit whatever the way is.
    """
    pose, able = start.copy(), np.array(free)
    for turn in range(most):
        kinds = [look(pose) for look in looks]
        pairs = joined(kinds)
        if len(pairs.points) < able.sum():
            break
        weights = _weights(kinds, pose, WIDER[min(turn, len(WIDER) - 1)])
        last, pose = pose, descend(pairs, weights, pose, able)
        step = np.abs(log_se3(inverse(last) @ pose))
        small = step[:3].max() < SHIFT_M and step[3:].max() < TURN_RAD
        if small and turn + 1 >= len(WIDER):
            break
    return _told([look(pose) for look in looks], orthonormal(pose))


def joined(kinds: list[Pairs]) -> Pairs:
    """Return pairs one after the other."""
    if not kinds:
        return Pairs(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2, 3)))
    return Pairs(*(np.concatenate(each) for each in zip(*kinds, strict=True)))


def _look(
    kernel: Callable[..., Pairs], features: tuple[np.ndarray, np.ndarray, np.ndarray],
    table: RingTable, reach_m: float,
) -> Callable[[np.ndarray], Pairs]:  # fmt: skip
    return lambda pose: kernel(*features, table, (pose, reach_m))


def _labels(labels: np.ndarray, same_label: bool) -> np.ndarray:
    return labels if same_label else np.full_like(labels, -1)


def _weights(kinds: list[Pairs], pose: np.ndarray, wider: float = 1.0) -> np.ndarray:
    """Return the weight of each pair, 1/m^2: its kind's certainty by the bisquare."""
    each = [bisquare(distances(pairs, pose), NOISE_M, wider) for pairs in kinds]
    return np.concatenate([np.empty(0), *each])


def _told(kinds: list[Pairs], pose: np.ndarray) -> FeatureMatch:
    pairs, weights = joined(kinds), _weights(kinds, pose)
    information, _, _ = normal_equations(pairs, weights, pose)
    squares = weights @ distances(pairs, pose) ** 2
    residual_m = float(np.sqrt(squares / weights.sum())) if len(weights) else float("nan")
    return FeatureMatch(pose, information, residual_m, int((weights > 0).sum()))
