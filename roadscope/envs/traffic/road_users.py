"""Everything that moves or stands on a road, one record each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from roadscope.envs.traffic.roads import record_type

DRIVER, WALKER, PARKED, OBSTACLE = 0, 1, 2, 3
"""Kinds of bodies."""


class RoadBody(Protocol):
    """A record of a body in highway-env's frame; metres, radians, seconds.

    number: unique on its road. kind: `DRIVER`, `WALKER`, `PARKED` or `OBSTACLE`.
    x, y: its centre. cos, sin: of the heading. diagonal: of its outline.
    steering: angle of the front wheels that the last step used, 0 after a crash. wheel: that angle,
    which also after a crash turns by no more than `turn_limit` in a step. slip: angle from the
    heading to the course.
    impact_x, impact_y: displacement by a collision in the next step, nan for none.
    gone: whether it has arrived and is to be removed.

    Drivers: lane, target: numbers of the lanes where they are and where they want to be, -1 for
    people. commanded: whether somebody else sets target and acceleration, as `DrivenTraffic` does
    for the ego. target_speed: on a free road, m/s. time_gap, standstill_gap, comfort: parameters of
    IDM, comfort in m/s^2. timer: time since the driver last considered a lane change. turn_limit:
    how far the wheels can turn in a step. acceleration: chosen, m/s^2. hold: how far the front may
    still go until the line where the driver has to wait, nan for no line. first_leg, last_leg: the
    remaining roads of the route, half-open rows of `Traffic.legs`. ticket: number of the request to
    cross, -1 before it. path: lane through a crossing that is granted, -1 for none. requested:
    instant of the request.

    People: first_knot, last_knot: of their path, rows of `PATH`. along: on the path. pace: m/s.
    kerb: where on the path they wait, nan for nowhere. across: distance from there to the other
    side. patience: how long they still stand there. crossing: whether they no longer wait there.
    blocked: whether a driver is or will be where they step next.
    """

    number: int
    kind: int
    x: float
    y: float
    heading: float
    cos: float
    sin: float
    speed: float
    length: float
    width: float
    diagonal: float
    steering: float
    wheel: float
    slip: float
    impact_x: float
    impact_y: float
    crashed: bool
    gone: bool
    lane: int
    target: int
    lane_changes: bool
    commanded: bool
    target_speed: float
    time_gap: float
    standstill_gap: float
    comfort: float
    timer: float
    turn_limit: float
    acceleration: float
    hold: float
    first_leg: int
    last_leg: int
    ticket: int
    path: int
    requested: float
    first_knot: int
    last_knot: int
    along: float
    pace: float
    kerb: float
    across: float
    patience: float
    crossing: bool
    blocked: bool


class Knot(Protocol):
    """A record of a knot of a path in highway-env's frame, and of the step to the next; metres.

    x, y: its place. arc: its arc length. middle: arc length of the middle of the step. turn:
    heading of the step, radians, continuous along the path.
    """

    x: float
    y: float
    arc: float
    middle: float
    turn: float


BODY, PATH = record_type(RoadBody), record_type(Knot)

Bodies = np.ndarray[Any, Any]
"""(N,) of `BODY`, in the order in which they decide."""


def neutral_bodies(count: int) -> Bodies:
    """Return (count,) of `BODY` without lane, route, request or collision, and zeros otherwise."""
    bodies = np.zeros(count, BODY)
    for name in ("impact_x", "impact_y", "hold", "kerb", "requested"):
        bodies[name] = np.nan
    for name in ("lane", "target", "ticket", "path"):
        bodies[name] = -1
    return bodies


def new_body(**values: Any) -> np.ndarray:
    """Return (1,) of `BODY` with some fields set; the others as in `neutral_bodies`."""
    body = neutral_bodies(1)
    for name, value in values.items():
        body[name] = value
    body["cos"], body["sin"] = np.cos(body["heading"]), np.sin(body["heading"])
    body["diagonal"] = np.hypot(body["length"], body["width"])
    return body


def copied(rows: Bodies, chosen: Any = ...) -> np.ndarray:
    """Return a copy of chosen records; NumPy would copy field by field, 15 times as slowly."""
    copy: np.ndarray = np.array(_whole(rows)[chosen]).view(rows.dtype)
    return copy


def joined(parts: Sequence[Bodies]) -> np.ndarray:
    """Concatenate arrays of one record type."""
    return np.concatenate([_whole(part) for part in parts]).view(parts[0].dtype)


def _whole(rows: Bodies) -> np.ndarray:
    """Return a view of records without fields."""
    return rows.view(np.dtype((np.void, rows.dtype.itemsize)))
