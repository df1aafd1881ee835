"""How people walk: along a path at a pace, waiting at a kerb until it is safe, for kernels."""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.traffic.road_users import DRIVER, WALKER, Bodies, RoadBody

ACCELERATION_M_S2 = 1.2
COMFORTABLE_BRAKING_M_S2 = 2.0
"""People cross only if no driver would have to brake harder than this; chosen by hand."""
REACTION_S = 0.6
"""Reaction time of drivers that people assume."""
MARGIN_M = 2.5
"""Distance from a stopped driver that people want to keep."""
NEARBY_M, AHEAD_S = 15.0, 0.8
"""People notice drivers within the first, and do not step where these will be after the second."""
ARRIVED_M = 1e-6
"""People have arrived when they are this close to the end of their path."""


@compiled()
def decide_people(bodies: Bodies, paths: np.ndarray, dt: float) -> bool:
    """Let all people decide whether to stop or to cross; return whether any have arrived.

    paths: (K,) of `PATH`, the knots of all paths. dt: time since the last call, seconds.
    """
    arrived = False
    for slot in range(len(bodies)):
        body = bodies[slot]
        if body.kind == WALKER:
            body.blocked = _is_blocked(bodies, paths, body)
            waits = not body.crossing and not np.isnan(body.kerb)
            if waits and not body.along < body.kerb - 0.3:
                body.patience -= dt
                if body.patience <= 0.0:
                    body.crossing = _is_safe(bodies, paths, body)
            body.gone = body.along >= paths[body.last_knot - 1].arc - ARRIVED_M
            arrived |= body.gone
    return arrived


@compiled(borrowing=True)
def _is_blocked(bodies: Bodies, paths: np.ndarray, walker: RoadBody) -> bool:
    """Return whether a driver is, or soon will be, where the next steps lead."""
    for slot in range(len(bodies)):
        driver = bodies[slot]
        if driver.kind == DRIVER:
            away = max(abs(driver.x - walker.x), abs(driver.y - walker.y))
            if away <= NEARBY_M and _blocks(driver, paths, walker):
                return True
    return False


@compiled(borrowing=True)
def _blocks(driver: RoadBody, paths: np.ndarray, walker: RoadBody) -> bool:
    """Return whether a driver is, or soon will be, where the person's next steps lead."""
    half, side = driver.length / 2, driver.width / 2
    front = half + 0.4 + driver.speed * AHEAD_S
    for step in (0.5, 1.0, 0.5 + walker.speed):
        x, y = _position_at(walker, paths, walker.along + step + walker.length)
        along, across = _offset_from(driver, x, y)
        if -half - 0.4 < along < front and abs(across) < side + 0.4:
            # A person already in front of a driver continues: the driver has to stop.
            along, across = _offset_from(driver, walker.x, walker.y)
            return bool(abs(across) > side + 0.3 or along < half)
    return False


@compiled(borrowing=True)
def _offset_from(driver: RoadBody, x: float, y: float) -> tuple[float, float]:
    """Return the offset of a point from a driver, along and across its heading, metres."""
    x, y = x - driver.x, y - driver.y
    return x * driver.cos + y * driver.sin, x * driver.sin - y * driver.cos


@compiled(borrowing=True)
def _is_safe(bodies: Bodies, paths: np.ndarray, walker: RoadBody) -> bool:
    """Return whether each driver can stop before the path across the road, or never reaches it."""
    end = paths[walker.last_knot - 1].arc
    x, y = _position_at(walker, paths, walker.kerb)
    far_x, far_y = _position_at(walker, paths, min(walker.kerb + walker.across, end))
    for slot in range(len(bodies)):
        driver = bodies[slot]
        if driver.kind == DRIVER:
            nearest = np.inf
            for share in (0.0, 0.25, 0.5, 0.75, 1.0):
                along, across = _offset_from(
                    driver, x + share * (far_x - x), y + share * (far_y - y)
                )
                if abs(across) < driver.width / 2 + 1.5 and along > -driver.length / 2 - 1.0:
                    nearest = min(nearest, along)
            clearance = nearest - driver.length / 2 - MARGIN_M
            braking = driver.speed * driver.speed / (2 * COMFORTABLE_BRAKING_M_S2)
            if not clearance > driver.speed * REACTION_S + braking:
                return False
    return True


@compiled(borrowing=True)
def walk(body: RoadBody, paths: np.ndarray, dt: float) -> None:
    """Move for `dt` seconds along the path; slow down for the kerb and for the end."""
    stop = paths[body.last_knot - 1].arc
    if not body.crossing and not np.isnan(body.kerb):
        stop = body.kerb
    remaining = max(stop - body.along, 0.0)
    pace = 0.0 if body.blocked else body.pace
    desired = min(pace, sqrt(2 * ACCELERATION_M_S2 * remaining))
    limit = ACCELERATION_M_S2 * dt
    change = min(max(desired - body.speed, -2 * limit), limit)
    before = body.speed
    body.speed = max(0.0, before + change)
    body.along = min(body.along + 0.5 * (before + body.speed) * dt, stop)
    # The rear end follows the path: timelines take it for an axle that does not slip.
    first, last = body.first_knot, body.last_knot - 1
    body.heading = _interpolated(body.along, paths["middle"][first:last], paths["turn"][first:last])
    body.cos, body.sin = cos(body.heading), sin(body.heading)
    x, y = _position_at(body, paths, body.along)
    body.x, body.y = x + body.length / 2 * body.cos, y + body.length / 2 * body.sin


@compiled(borrowing=True)
def _position_at(body: RoadBody, paths: np.ndarray, along: float) -> tuple[float, float]:
    """Return x and y of a person's path at an arc length; beyond an end, those of the end."""
    first, last = body.first_knot, body.last_knot
    arcs, x, y = paths["arc"][first:last], paths["x"][first:last], paths["y"][first:last]
    return _interpolated(along, arcs, x), _interpolated(along, arcs, y)


@compiled(borrowing=True)
def _interpolated(value: float, knots: np.ndarray, values: np.ndarray) -> float:
    """Return `np.interp` of one finite number.

    knots: (K,) increasing. values: (K,) at the knots.
    """
    low, high = 0, len(knots)
    while low < high:
        middle = (low + high) // 2
        if value < knots[middle]:
            high = middle
        else:
            low = middle + 1
    k = low - 1
    if k < 0:
        return float(values[0])
    if k >= len(knots) - 1:
        return float(values[len(knots) - 1])
    slope = (values[k + 1] - values[k]) / (knots[k + 1] - knots[k])
    return float(slope * (value - knots[k]) + values[k])
