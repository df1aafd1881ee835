"""The likeliest pose of a body from the rays of one scan, and how it goes: one compiled call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_descent_kernels import Drawn, Rules, Space, lowest
from roadscope.detectors.pose.body_kernels import POSE, Rays
from roadscope.detectors.pose.body_sight_kernels import points_of
from roadscope.detectors.pose.body_start import along_sides

YAW, SPEED = 2, 3
"""Places among what a pose problem may leave free."""


class Sought(NamedTuple):
    """A body, and where its pose alone and all of it are searched when it stands."""

    drawn: Drawn
    pose: Space
    whole: Space


class Search(NamedTuple):
    """How a body is searched.

    first, next, last: slacks of the rounds, metres, the last two of each 0. rays: at most, of a
    first fit. unlikely: first guesses whose squared deviation from the way is so much more than
    the best's are left. close: first fits that cost no more than so much above the best's are
    followed. rules: of the descent.
    """

    first: np.ndarray
    next: np.ndarray
    last: np.ndarray
    rays: int
    unlikely: float
    close: float
    rules: Rules


@compiled()
def likeliest(
    rays: Rays,
    origin: np.ndarray,
    way: tuple[float, float, float],
    sought: Sought,
    search: Search,
) -> tuple[float, float, float, float, float, float]:
    """Return x, y, yaw, length, width and cost.

    origin: (2,) metres, the sensor. way: speed, m/s, heading and its standard deviation, radians,
    as known before. Of a few returns of one face any heading of four is likely: the way then
    decides. Where the rays tell the heading, its standard deviation is far less than the way's.
    """
    drawn, told = sought.drawn, (rays, search.rules)
    pose, whole = _going(sought.pose, way), _going(sought.whole, way)
    step = way[0] * np.array([np.cos(way[1]), np.sin(way[1])])
    sides = drawn.sizes[:, 0]
    guesses = along_sides(points_of(rays, step), origin, sides[0], sides[1])
    guesses = _by_way(guesses, way, search.unlikely)
    few = _thinned(rays, search.rays), search.rules
    rough, costs = lowest(guesses, search.first, drawn, pose, few)
    likely = rough[costs <= costs.min() + search.close]
    begin = np.zeros((len(likely), len(whole.free)))
    begin[:, :3] = likely
    fine, costs = lowest(begin, search.next, drawn, _without_spread(whole), told)
    best = costs.argmin()
    last, costs = lowest(fine[best : best + 1], search.last, drawn, whole, told)
    values = whole.fixed.copy()
    values[whole.free] = last[0]
    sizes = sides + drawn.sizes[:, 1] * values[POSE : POSE + 2]
    length, width = max(sizes[0], 0.3 * sides[0]), max(sizes[1], 0.3 * sides[1])
    return values[0], values[1], values[YAW], length, width, costs[0]


@compiled()
def _by_way(guesses: np.ndarray, way: tuple[float, float, float], unlikely: float) -> np.ndarray:
    """Turn headings to within half a turn of the way and leave those that it makes unlikely."""
    off = (guesses[:, YAW] - way[1] + np.pi) % (2 * np.pi) - np.pi
    square = (off / way[2]) ** 2
    turned = guesses.copy()
    turned[:, YAW] = way[1] + off
    likely: np.ndarray = turned[square <= square.min() + unlikely]
    return likely


@compiled()
def _going(space: Space, way: tuple[float, float, float]) -> Space:
    """Return the search for a body that goes such a way while it is swept."""
    fixed, precision, centre = space.fixed.copy(), space.precision.copy(), space.centre.copy()
    fixed[SPEED], centre[YAW], precision[YAW] = way[0], way[1], 1.0 / way[2] ** 2
    return Space(
        space.free, fixed, precision, centre, space.steps, space.spread, space.shares, space.ways
    )


@compiled()
def _without_spread(space: Space) -> Space:
    return Space(
        space.free, space.fixed, space.precision, space.centre, space.steps, space.spread[:0],
        space.shares, space.ways,
    )  # fmt: skip


@compiled()
def _thinned(rays: Rays, most: int) -> Rays:
    """Keep at most so many rays, evenly."""
    step = -(-len(rays.slope) // most)
    if step <= 1:
        return rays
    return Rays(
        rays.origin[::step].copy(), rays.direction[::step].copy(), rays.slope[::step].copy(),
        rays.reach[::step].copy(), rays.kind[::step].copy(), rays.sigma[::step].copy(),
        rays.time[::step].copy(), rays.need[::step].copy(),
    )  # fmt: skip
