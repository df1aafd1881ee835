"""Who plays in a scripted scenario, and the timeline of their play."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category
from roadscope.envs.traffic.mix import CARS, VANS, Body
from roadscope.envs.traffic.road_map import RoadMap
from roadscope.envs.traffic.script_motion import Motion
from roadscope.envs.traffic.timeline import Timeline

STEP_S = 0.04
BEHIND_M, AHEAD_M = 60.0, 220.0
"""How far the road reaches beyond everybody's way."""

Cast = tuple[tuple[Motion, Body], ...]
"""Motion and body of the ego and of targets 1, 2, ..."""


def timeline_of(
    cast: Cast, times: np.ndarray, *, lanes: tuple[float, ...], width_m: float, style: str
) -> Timeline:
    """Return what a cast does at (T,) times, seconds, on a straight road.

    lanes: where they lie across, metres to the left; all in the ego's direction.
    """
    velocities = np.stack([motion.velocities(times) for motion, _ in cast], axis=1)
    axles = np.stack([motion.places(times) for motion, _ in cast], axis=1)
    sizes = np.array([body.size for _, body in cast])
    here = np.ones(axles.shape[:2], np.bool_)
    return Timeline(
        stamps_s=times,
        ids=np.arange(len(cast)),
        categories=np.array([body.category for _, body in cast], np.int8),
        sizes=sizes,
        centre_ahead_m=sizes[:, 0] / 2,
        present=here,
        axles=axles,
        yaws=np.arctan2(velocities[..., 1], velocities[..., 0]),
        speeds=np.hypot(velocities[..., 0], velocities[..., 1]),
        crashed=~here,
        road=_straight_road(axles[:, :, 0], lanes, width_m),
        style=style,
    )


def times_until(end_s: float) -> np.ndarray:
    """Return the instants of a play from two steps before 0 to two after its end, seconds."""
    return np.arange(-2, round(end_s / STEP_S) + 3) * STEP_S


def any_car(rng: np.random.Generator) -> Body:
    """Draw a car."""
    return Body(Category.CAR, CARS[int(rng.integers(len(CARS)))])


def any_van(rng: np.random.Generator) -> Body:
    """Draw a van."""
    return Body(Category.VAN, VANS[int(rng.integers(len(VANS)))])


def _straight_road(along: np.ndarray, lanes: tuple[float, ...], width_m: float) -> RoadMap:
    x = np.arange(along.min() - BEHIND_M, along.max() + AHEAD_M, 2.0)
    return RoadMap.from_lanes(
        [(np.stack([x, np.full_like(x, y)], axis=-1), np.full_like(x, width_m)) for y in lanes]
    )
