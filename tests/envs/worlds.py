"""Small roads and timelines for tests."""

from __future__ import annotations

import numpy as np

from roadscope.envs.traffic import RoadMap, Timeline


def straight(lanes: int = 2, length_m: float = 300.0, width_m: float = 4.0) -> RoadMap:
    x = np.arange(0.0, length_m + 1, 2.0)
    return RoadMap.from_lanes(
        [
            (np.stack([x, np.full(len(x), width_m * lane)], 1), np.full(len(x), width_m))
            for lane in range(lanes)
        ]
    )


def crossing(length_m: float = 120.0) -> RoadMap:
    x = np.arange(-length_m, length_m + 1, 2.0)
    zero, wide = np.zeros(len(x)), np.full(len(x), 4.0)
    return RoadMap.from_lanes([(np.stack([x, zero], 1), wide), (np.stack([zero, x], 1), wide)])


def circle(radius_m: float = 25.0) -> RoadMap:
    turn = np.linspace(0, 2 * np.pi, 90)
    points = radius_m * np.stack([np.cos(turn), np.sin(turn)], 1)
    return RoadMap.from_lanes([(points, np.full(len(turn), 4.0))])


def platoon(actors: int = 3, style: str = "campus", road: RoadMap | None = None) -> Timeline:
    """Cars 12 m apart on a straight road, all at 10 m/s for 10 s; the ego comes last."""
    stamps = np.arange(0.0, 10.01, 0.5)
    grid = (len(stamps), actors)
    axles = np.zeros((*grid, 2))
    axles[..., 0] = 50 + 10 * stamps[:, None] + 12 * np.arange(actors)
    return timeline(
        stamps,
        axles,
        np.zeros(grid),
        np.full(grid, 10.0),
        size=(4.5, 1.8, 1.5),
        ids=np.arange(actors) * 7,
        centre_ahead_m=np.full(actors, 2.25),
        road=straight() if road is None else road,
        style=style,
    )


def timeline(stamps, axles, yaws, speeds, *, size=(1.0, 1.0, 1.0), **changes) -> Timeline:
    """Cars of one size that are there all the time, on a short road, unless something is changed.

    axles: (samples, actors, 2). yaws, speeds: (samples, actors).
    """
    samples, actors = np.shape(yaws)
    fields = {
        "ids": np.arange(actors),
        "categories": np.zeros(actors, np.int8),
        "sizes": np.tile(size, (actors, 1)),
        "centre_ahead_m": np.full(actors, 2.5),
        "present": np.ones((samples, actors), bool),
        "crashed": np.zeros((samples, actors), bool),
        "road": straight(lanes=1, length_m=20.0),
    }
    return Timeline(stamps_s=stamps, axles=axles, yaws=yaws, speeds=speeds, **fields | changes)
