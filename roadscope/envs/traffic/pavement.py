"""Where people walk: along lanes, across them, alone, in pairs and in crowds."""

from __future__ import annotations

from typing import Any

import numpy as np

from roadscope.envs.traffic.flow import FlowRoad
from roadscope.envs.traffic.walkers import Walker, cyclist, pedestrian

PAVEMENT_M = 2.9
"""From the edge of the lane to the middle of the pavement."""
KERB_M = 0.45
"""From the edge of the lane to where one waits."""
EDGE_M = 0.3
"""From the edge of the lane to the middle of a bicycle."""
PACES = (0.9, 1.7)
RIDES = (3.5, 5.5)
GROUPS = ((1, 0.55), (2, 0.30), (6, 0.15))
"""Size of a group and how often: single, pair, crowd."""


class Kerb:
    """One side of a lane: people walk beside it and cross from it."""

    def __init__(self, road: FlowRoad, lane_index: Any, width_m: float) -> None:
        """Take a lane whose right side is the road's edge, and the width of the whole road."""
        self._road = road
        self._lane = road.network.get_lane(lane_index)
        self._width_m = width_m

    @property
    def length_m(self) -> float:
        """Length of the lane."""
        return float(self._lane.length)

    def walk(self, rng: np.random.Generator, at_m: float, *, ends: tuple[float, float]) -> None:
        """Put a group on the pavement at a place along the lane, walking either way."""
        back = bool(rng.random() < 0.5)
        pace = float(rng.uniform(*PACES))
        count = _group(rng)
        for along, aside in _offsets(count, rng):
            stops = np.linspace(*ends, 12)
            points = np.array([self._beside(s, PAVEMENT_M + aside) for s in stops])
            start = at_m + along - ends[0]
            if back:
                points, start = points[::-1], ends[1] - at_m + along
            self._add(points, pedestrian(rng), pace, start_m=max(start, 0.0))

    def cross(self, rng: np.random.Generator, at_m: float, *, coming_m: float) -> None:
        """Send a group along the pavement for a while and then across the road."""
        pace = float(rng.uniform(*PACES))
        patience = float(rng.uniform(0.3, 1.5))
        for along, aside in _offsets(_group(rng), rng):
            s = at_m + aside
            corner = self._beside(s, PAVEMENT_M)
            over = self._width_m + 2 * KERB_M
            far = self._beside(s, KERB_M - over - 0.5)
            points = np.array([self._beside(s - coming_m, PAVEMENT_M), corner, far])
            kerb = coming_m + PAVEMENT_M - KERB_M - 0.35 + min(along, 0.0)
            self._add(
                points, pedestrian(rng), pace, start_m=max(0.0, along), kerb_m=kerb,
                across_m=over, patience_s=patience,
            )  # fmt: skip

    def ride(self, rng: np.random.Generator, at_m: float, *, end_m: float) -> None:
        """Put a cyclist at the edge of the lane, riding with the traffic."""
        stops = np.linspace(at_m, end_m, 20)
        points = np.array([self._beside(s, -EDGE_M) for s in stops])
        self._add(points, cyclist(rng), float(rng.uniform(*RIDES)))

    def _beside(self, along_m: float, off_m: float) -> np.ndarray:
        """Place a given way beyond the right edge of the lane, highway-env's frame."""
        half = float(self._lane.width_at(along_m)) / 2
        place: np.ndarray = np.asarray(self._lane.position(along_m, half + off_m))
        return place

    def _add(self, points: np.ndarray, body: Any, pace: float, **options: float) -> None:
        self._road.vehicles.append(Walker(points, body, pace, **options))


def _group(rng: np.random.Generator) -> int:
    sizes, shares = zip(*GROUPS, strict=True)
    return int(rng.choice(sizes, p=shares))


def _offsets(count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 2) metres along and aside: nobody walks into somebody else."""
    if count == 1:
        return np.zeros((1, 2))
    if count == 2:
        return np.array([[0.0, -0.36], [float(rng.uniform(-0.1, 0.1)), 0.36]])
    rows = np.arange(count) // 2
    sides = np.where(np.arange(count) % 2 == 0, -0.4, 0.4)
    return np.column_stack([-0.85 * rows, sides]) + rng.uniform(-0.12, 0.12, (count, 2))
