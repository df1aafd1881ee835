"""highway-env's roads in our frame, and what must be known about its environments."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from roadscope.envs.traffic.road_map import RoadMap

# --------------------------------------------------------------------------------------------------
# highway-env's roads in our frame, and what must be known about its environments.

LANE_STEP_M = 2.0
"""Lanes are sampled at least this densely."""


# highway-env 1.12, IDMVehicle; `IntersectionEnv` writes others into the class on every reset.
DRIVER_CONSTANTS = {"DISTANCE_WANTED": 10.0, "COMFORT_ACC_MAX": 3.0, "COMFORT_ACC_MIN": -5.0}


class ForeignEnvError(ValueError):
    """An environment cannot be recorded."""


def to_world(
    positions: np.ndarray, headings: np.ndarray, velocities: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Turn highway-env's frame, y to the right, into ours, y to the left; nothing else does.

    positions: (..., 2); headings: radians; velocities: (..., 2) or None. Both frames share x.
    """
    flip = np.array([1.0, -1.0])
    return positions * flip, -headings, None if velocities is None else velocities * flip


def road_map(network: Any) -> RoadMap:
    """Sample the lanes of a highway-env road network every 2 m at most, true ends included."""
    return RoadMap.from_lanes([_sample(lane) for lane in network.lanes_list()])


def _sample(lane: Any) -> tuple[np.ndarray, np.ndarray]:
    count = max(2, int(np.ceil(lane.length / LANE_STEP_M)) + 1)
    along = np.linspace(0.0, float(lane.length), count)
    if hasattr(lane, "start") and not hasattr(lane, "amplitude"):
        points = lane.start + along[:, None] * lane.direction
    else:
        points = np.array([lane.position(s, 0.0) for s in along])
    widths = np.array([lane.width_at(s) for s in along], np.float64)
    world, _, _ = to_world(points, along)
    return world, widths


def restore_driver_constants() -> None:
    """Undo what building an intersection did to highway-env's driver classes.

    To be called before a foreign environment is reset: after that, its own settings count.
    """
    from highway_env.vehicle import behavior

    for name, value in DRIVER_CONSTANTS.items():
        setattr(behavior.IDMVehicle, name, value)
        for heir in (behavior.LinearVehicle, behavior.AggressiveVehicle, behavior.DefensiveVehicle):
            if name in vars(heir):
                delattr(heir, name)


def refuse_multi_agent(env: Any) -> None:
    """Raise `ForeignEnvError` unless this is a highway-env environment with one agent."""
    inner = getattr(env, "unwrapped", env)
    spec = getattr(inner, "spec", None) or getattr(env, "spec", None)
    name = spec.id if spec is not None else type(inner).__name__
    if not (hasattr(inner, "road") and hasattr(inner, "controlled_vehicles")):
        raise ForeignEnvError(f"'{name}' is not a highway-env environment: it has no road")
    agents = type(getattr(inner, "action_type", None)).__name__ == "MultiAgentAction"
    if agents or len(inner.controlled_vehicles) > 1:
        raise ForeignEnvError(
            f"'{name}' has several agents; sensors ride on one vehicle: use a single-agent "
            "environment such as 'intersection-v2'"
        )


# --------------------------------------------------------------------------------------------------
# Driver constants that some environments overwrite for the whole process, kept apart.

Constants = dict[type, dict[str, float]]


@contextmanager
def original_constants(kept: Constants) -> Iterator[None]:
    """Run with highway-env's own constants, keep what became of them, put back what was there."""
    before = _read()
    restore_driver_constants()
    with _putting_back(before):
        yield
        kept.clear()
        kept.update(_read())


@contextmanager
def own_constants(kept: Constants) -> Iterator[None]:
    """Run with the constants that an environment's reset has left, put back what was there.

    So an environment drives the same whatever other environments of the process do.
    """
    before = _read()
    _write(kept)
    with _putting_back(before):
        yield


@contextmanager
def _putting_back(before: Constants) -> Iterator[None]:
    try:
        yield
    finally:
        _write(before)


def _read() -> Constants:
    from highway_env.vehicle.behavior import IDMVehicle

    return {
        kind: {name: vars(kind)[name] for name in DRIVER_CONSTANTS if name in vars(kind)}
        for kind in _heirs(IDMVehicle)
    }


def _write(constants: Constants) -> None:
    for kind, values in constants.items():
        for name in DRIVER_CONSTANTS:
            if name in values:
                setattr(kind, name, values[name])
            elif name in vars(kind):
                delattr(kind, name)


def _heirs(kind: type[object]) -> Iterator[type]:
    yield kind
    heirs: list[type[object]] = kind.__subclasses__()
    for heir in heirs:
        yield from _heirs(heir)
