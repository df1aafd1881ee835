"""The likeliest poses of bodies from their rays in one scan, and how they go: one compiled call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_descent_kernels import Rules, Space, lowest
from roadscope.detectors.pose.body_kernels import POSE, Rays
from roadscope.detectors.pose.body_lanes import Drawn
from roadscope.detectors.pose.body_sight_kernels import (
    Beams,
    Motion,
    Returns,
    points_of,
    rays_about,
)
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

    first, next, last: slacks of the rounds, metres, the last two of each 0; the next fit is left
    out where one first fit alone is likely. budget: returns of a body beyond which neighbours are
    joined. rays: at most, before the last fit. unlikely: first guesses whose squared deviation
    from the way is so much more than the best's are left. close: first fits that cost no more
    than so much above the best's are followed. rules: of the descent.
    """

    first: np.ndarray
    next: np.ndarray
    last: np.ndarray
    budget: int
    rays: int
    unlikely: float
    close: float
    rules: Rules


class Sensed(NamedTuple):
    """A scan and how it was made; order and columns as in `returns_about`."""

    returns: Returns
    order: np.ndarray
    columns: np.ndarray
    beams: Beams


@compiled()
def glanced(
    sensed: Sensed,
    held: tuple[np.ndarray, np.ndarray],
    moves: tuple[np.ndarray, np.ndarray],
    ways: np.ndarray,
    sought: Sought,
    search: Search,
) -> np.ndarray:
    """Return returns that count, x, y, yaw, length, width and cost of each body, (K, 7).

    held: rows of each body's returns, one body after the other, and (K + 1,) where each begins.
    moves: (K, 4, 4) and (2,) matrices and velocity of `Motion`, turned as the sensor was when it
    met each. ways: (K, 3), as in `likeliest`. Where no return counts the rest says nothing.
    """
    (rows, starts), (matrices, velocity) = held, moves
    found = np.zeros((len(matrices), 7))
    for k in range(len(matrices)):
        motion = Motion(matrices[k], velocity, 0.0, 1.0)
        ordered, own = (sensed.order, sensed.columns), rows[starts[k] : starts[k + 1]]
        lidar = sensed.beams, motion
        rays, hits = rays_about(sensed.returns, ordered, own, lidar, search.budget)
        found[k, 0] = hits
        if hits:
            way = ways[k, 0], ways[k, 1], ways[k, 2]
            found[k, 1:] = likeliest(rays, motion.matrix[:2, 3].copy(), way, sought, search)
    return found


@compiled()
def ways(
    times_s: np.ndarray,
    starts: np.ndarray,
    going: np.ndarray,
    rules: tuple[float, float, float],
) -> np.ndarray:
    """Return (K, 3) how vehicles go: speed, m/s, heading and its standard deviation, radians.

    A speed of 0 stands for what is not known, with any heading alike. times_s: when each was met
    lately, one vehicle after the other; starts: (K + 1,) where each begins. going: (K, 2) speed and
    heading at which each is followed. rules: by how much a heading departs from a way that is known
    well; scatter of the mark that is followed, metres; and a way that is known no better than this
    says nothing.
    """
    heading, mark_m, vague = rules
    out = np.zeros((len(going), 3))
    out[:, 2] = np.inf
    for k in range(len(going)):
        met = times_s[starts[k] : starts[k + 1]]
        spread, speed = math.sqrt(((met - met.mean()) ** 2).sum()), going[k, 0]
        if spread == 0.0 or speed == 0.0:
            continue
        sd = math.hypot(heading, mark_m / spread / speed)
        if sd < vague:
            out[k, 0], out[k, 1], out[k, 2] = speed, going[k, 1], sd
    return out


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
    if len(begin) > 1:
        fine, costs = lowest(begin, search.next, drawn, _without_spread(whole), few)
        best = costs.argmin()
        begin = fine[best : best + 1]
    last, costs = lowest(begin, search.last, drawn, whole, told)
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
