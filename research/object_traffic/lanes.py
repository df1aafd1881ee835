"""Lane coordinates of many points at once; highway-env computes them one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.road.lane import CircularLane, SineLane, StraightLane


def coordinates(lane: Any, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `lane.local_coordinates` of (N, 2) points as two (N,) arrays."""
    if isinstance(lane, StraightLane):
        offsets = points - lane.start
        along = along_direction(offsets, lane.direction)
        across = along_direction(offsets, lane.direction_lateral)
        if isinstance(lane, SineLane):
            across = across - lane.amplitude * np.sin(lane.pulsation * along + lane.phase)
        return along, across
    if isinstance(lane, CircularLane):
        offsets = points - lane.center
        turn = np.arctan2(offsets[:, 1], offsets[:, 0]) - lane.start_phase
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
        radii = np.hypot(offsets[:, 0], offsets[:, 1])
        return lane.direction * turn * lane.radius, lane.direction * (lane.radius - radii)
    pairs = np.array([lane.local_coordinates(point) for point in points]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def along_direction(vectors: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Project (..., 2) vectors; unlike a BLAS product it rounds the same way everywhere."""
    projected: np.ndarray = vectors[..., 0] * direction[0] + vectors[..., 1] * direction[1]
    return projected
