"""Conversion of highway-env's roads into our frame, and checks of its environments."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from roadscope.envs.traffic.road_maps import RoadMap

LANE_STEP_M = 2.0
"""Lanes are sampled at least this densely."""


DRIVER_CONSTANTS = {"DISTANCE_WANTED": 10.0, "COMFORT_ACC_MAX": 3.0, "COMFORT_ACC_MIN": -5.0}
"""Constants of `IDMVehicle` in highway-env 1.12; a reset of `IntersectionEnv` overwrites them."""


class ForeignEnvError(ValueError):
    """An environment of another package cannot be recorded."""


def to_world(
    positions: np.ndarray, headings: np.ndarray, velocities: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Convert from highway-env's frame (y to the right) to ours (y to the left).

    positions: (..., 2); headings: radians; velocities: (..., 2) or None. Both frames share x.
    """
    flip = np.array([1.0, -1.0])
    return positions * flip, -headings, None if velocities is None else velocities * flip


def from_world(
    positions: np.ndarray, headings: np.ndarray, velocities: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Convert from our frame to highway-env's, as `to_world`."""
    flipped, turned, moving = to_world(positions, headings, velocities)
    assert moving is not None
    return flipped, turned, moving


def road_map(network: Any) -> RoadMap:
    """Sample the lanes of a highway-env road network every 2 m at most, true ends included."""
    return RoadMap.from_lanes([_sample(lane) for lane in network.lanes_list()])


def _sample(lane: Any) -> tuple[np.ndarray, np.ndarray]:
    from highway_env.road.lane import StraightLane

    count = max(2, int(np.ceil(lane.length / LANE_STEP_M)) + 1)
    along = np.linspace(0.0, float(lane.length), count)
    if type(lane) is StraightLane:
        points = lane.start + along[:, None] * lane.direction
        widths = np.full(count, lane.width_at(0.0), np.float64)
    else:
        points = np.array([lane.position(s, 0.0) for s in along])
        widths = np.array([lane.width_at(s) for s in along], np.float64)
    world, _, _ = to_world(points, along)
    return world, widths


def restore_driver_constants() -> None:
    """Restore the constants of highway-env's driver classes that an intersection overwrote.

    Call it before an environment of highway-env is reset; the reset may set its own values.
    """
    from highway_env.vehicle import behavior

    for name, value in DRIVER_CONSTANTS.items():
        setattr(behavior.IDMVehicle, name, value)
        for subclass in (
            behavior.LinearVehicle,
            behavior.AggressiveVehicle,
            behavior.DefensiveVehicle,
        ):
            if name in vars(subclass):
                delattr(subclass, name)


def refuse_multi_agent(env: Any) -> None:
    """Raise `ForeignEnvError` unless this is a highway-env environment with one agent."""
    inner = getattr(env, "unwrapped", env)
    spec = getattr(inner, "spec", None) or getattr(env, "spec", None)
    name = spec.id if spec is not None else type(inner).__name__
    if name.startswith("roadscope/"):
        raise ForeignEnvError(
            f"'{name}' is an environment of roadscope, to which nothing is added: choose its "
            "sensors by rig= and what is observed by perception= of gym.make"
        )
    if not (hasattr(inner, "road") and hasattr(inner, "controlled_vehicles")):
        raise ForeignEnvError(f"'{name}' is not a highway-env environment: it has no road")
    agents = type(getattr(inner, "action_type", None)).__name__ == "MultiAgentAction"
    if agents or len(inner.controlled_vehicles) > 1:
        raise ForeignEnvError(
            f"'{name}' has several agents, but sensors belong to one vehicle: use a single-agent "
            "environment such as 'intersection-v2'"
        )


# --------------------------------------------------------------------------------------------------
# Driver constants that some environments overwrite for the whole process.

Constants = dict[type, dict[str, float]]


@contextmanager
def original_constants(constants: Constants) -> Iterator[None]:
    """Run a block with highway-env's own constants; store their values at its end in `constants`.

    The values from before the block are restored.
    """
    before = _read_constants()
    restore_driver_constants()
    with _restoring(before):
        yield
        constants.clear()
        constants.update(_read_constants())


@contextmanager
def own_constants(constants: Constants) -> Iterator[None]:
    """Run a block with the constants that an environment's reset has set; restore the old ones.

    So the traffic of an environment does not depend on other environments of the process.
    """
    before = _read_constants()
    _write_constants(constants)
    with _restoring(before):
        yield


@contextmanager
def _restoring(before: Constants) -> Iterator[None]:
    try:
        yield
    finally:
        _write_constants(before)


def _read_constants() -> Constants:
    from highway_env.vehicle.behavior import IDMVehicle

    return {
        kind: {name: vars(kind)[name] for name in DRIVER_CONSTANTS if name in vars(kind)}
        for kind in _with_subclasses(IDMVehicle)
    }


def _write_constants(constants: Constants) -> None:
    for kind, values in constants.items():
        for name in DRIVER_CONSTANTS:
            if name in values:
                setattr(kind, name, values[name])
            elif name in vars(kind):
                delattr(kind, name)


def _with_subclasses(kind: type[object]) -> Iterator[type]:
    yield kind
    subclasses: list[type[object]] = kind.__subclasses__()
    for subclass in subclasses:
        yield from _with_subclasses(subclass)
