"""Damped least squares over rays: all rounds of all starts in one compiled call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import Rays
from roadscope.detectors.pose.body_lane_misfits import lane_misfits
from roadscope.detectors.pose.body_lanes import LANES, Drawn, draw, even, lay, new_room, stand

WIDE = 16
"""Most values of a vector: a whole number of those that are worked on at a time."""


class Space(NamedTuple):
    """Where the search goes on, D of 11 values being free.

    free: (D,) indices. fixed: (11,) values of the others. precision, centre: (D,) of the prior.
    steps: (D,) by which values are moved to see what follows. spread: (T, D) places tried around
    a step's end, in its standard deviations. shares: of the step that are tried. ways: 2 where
    values are moved ahead and back, 1 where ahead only: half the work, and less exact at kinks.
    """

    free: np.ndarray
    fixed: np.ndarray
    precision: np.ndarray
    centre: np.ndarray
    steps: np.ndarray
    spread: np.ndarray
    shares: np.ndarray
    ways: int


class Rules(NamedTuple):
    """limit: misfits beyond so many standard deviations lose weight. edge_m: of silhouettes."""

    limit: float
    edge_m: float


class Room(NamedTuple):
    """Room to work in, for several starts side by side.

    lanes: of `body_lanes`. misfit: (M, LANES). sums: (2, LANES), costs and products.
    moved, tried: (LANES, D) vectors. normal, root: (D, D). pull: (D,).
    slopes: ((WIDE + 2) * WIDE,), sums of products of slopes, of their pull, and slopes of a ray.
    """

    lanes: np.ndarray
    misfit: np.ndarray
    sums: np.ndarray
    moved: np.ndarray
    tried: np.ndarray
    normal: np.ndarray
    root: np.ndarray
    pull: np.ndarray
    slopes: np.ndarray


def descended(
    starts: np.ndarray, slacks: np.ndarray, drawn: Drawn, space: Space, told: tuple[Rays, Rules]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return best vectors (S, D), their damped normal matrices (S, D, D) and costs (S,).

    starts: (S, D). slacks: (T,) metres added to noise and edges, round by round, the last one 0.
    told: the rays and what is made of them.
    """
    size = starts.shape[1]
    normals = np.zeros((len(starts), size, size))
    found: tuple[np.ndarray, np.ndarray, np.ndarray] = _descended(
        starts, slacks, (drawn, space), told, normals
    )
    return found


@compiled()
def lowest(
    starts: np.ndarray, slacks: np.ndarray, drawn: Drawn, space: Space, told: tuple[Rays, Rules]
) -> tuple[np.ndarray, np.ndarray]:
    """Return best vectors (S, D) and costs (S,) as `descended` does, in less time.

    slacks: the last two 0.
    """
    none = np.empty((len(starts), 0, 0))
    best, _, least = _descended(starts, slacks, (drawn, space), told, none)
    return best, least


@compiled()
def disagreed(
    vectors: np.ndarray, slack: float, drawn: Drawn, space: Space, told: tuple[Rays, Rules]
) -> np.ndarray:
    """Return by how many standard deviations each ray disagrees with each vector, (K, M).

    vectors: (K, D). slack: metres added to noise and edges.
    """
    count, rays = len(vectors), told[0]
    out = np.empty((count, len(rays.slope)))
    room = _room(vectors.shape[1], drawn, rays)
    for first in range(0, count, LANES):
        last = min(first + LANES, count)
        _misfits(vectors[first:last], slack, (drawn, space), told, room)
        for k in range(first, last):
            out[k] = room.misfit[:, k - first]
    return out


@compiled()
def _descended(
    starts: np.ndarray,
    slacks: np.ndarray,
    sought: tuple[Drawn, Space],
    told: tuple[Rays, Rules],
    normals: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what `descended` does, and fill in normals unless there is no room for them."""
    (count, size), (drawn, space) = starts.shape, sought
    best = starts.copy()
    least = np.full(count, np.inf)
    room = _room(size, drawn, told[0])
    widest = max(space.ways * size + 1, len(space.shares) + len(space.spread))
    for first in range(0, count, LANES // widest):
        last = min(first + LANES // widest, count)
        found = best[first:last], normals[first:last], least[first:last]
        _descend(found, slacks, sought, told, room)
    return best, normals, least


@compiled()
def _room(size: int, drawn: Drawn, rays: Rays) -> Room:
    return Room(
        new_room(len(drawn.storeys)), np.empty((len(rays.slope), LANES)), np.empty((2, LANES)),
        np.empty((LANES, size)), np.empty((LANES, size)),
        np.empty((size, size)), np.empty((size, size)), np.empty(size), np.empty((WIDE + 2) * WIDE),
    )  # fmt: skip


@compiled()
def _descend(
    found: tuple[np.ndarray, np.ndarray, np.ndarray],
    slacks: np.ndarray,
    sought: tuple[Drawn, Space],
    told: tuple[Rays, Rules],
    room: Room,
) -> None:
    """Improve as many starts as lanes hold; fill in what `descended` returns of them."""
    best, normals, least = found
    (_, space), (_, rules) = sought, told
    vectors, size = best.copy(), best.shape[1]
    moves, tries = space.ways * size + 1, len(space.shares) + len(space.spread)
    for turn in range(len(slacks)):
        slack, final = slacks[turn], turn + 1 == len(slacks)
        # Its cost is that of the last tries, and nobody asks for its slopes.
        if final and normals.shape[1] == 0:
            _keep_better(vectors, room.sums[1], best, least)
            break
        moved = room.moved[: moves * len(vectors)]
        for s in range(len(vectors)):
            _moves(vectors[s], space.steps, moved[s * moves : (s + 1) * moves])
        _misfits(moved, slack, sought, told, room)
        for s in range(len(vectors)):
            normal, vector = room.normal, vectors[s]
            _normal(s * moves, vector, space, rules.limit, room)
            for d in range(size):
                # Keeps what the rays say little of from running away.
                normal[d, d] += 1.0 / ((0.3 + slack) * 30.0 * space.steps[d]) ** 2
            if slack == 0.0:
                cost = _cost(room.misfit[:, s * moves], vector, space, rules.limit)
                if cost < least[s]:
                    least[s], best[s] = cost, vector
                    if normals.shape[1]:
                        normals[s] = normal
            if not final:
                _candidates(vector, space, room, room.tried[s * tries : (s + 1) * tries])
        if not final:
            _misfits(room.tried[: tries * len(vectors)], slack, sought, told, room)
            _choose(vectors, tries, space, rules.limit, room)


@compiled(borrowing=True)
def _keep_better(
    vectors: np.ndarray, costs: np.ndarray, best: np.ndarray, least: np.ndarray
) -> None:
    """Take those vectors over that cost less than the best so far."""
    for s in range(len(vectors)):
        if costs[s] < least[s]:
            least[s] = costs[s]
            for d in range(vectors.shape[1]):
                best[s, d] = vectors[s, d]


@compiled(borrowing=True)
def _moves(vector: np.ndarray, steps: np.ndarray, moved: np.ndarray) -> None:
    """Fill in the vector, then with each value moved ahead, then, where there is room, back."""
    size = len(vector)
    for k in range(len(moved)):
        for d in range(size):
            moved[k, d] = vector[d]
    for d in range(size):
        moved[1 + d, d] += steps[d]
        if len(moved) > 1 + size:
            moved[1 + size + d, d] -= steps[d]


@compiled(borrowing=True)
def _misfits(
    vectors: np.ndarray,
    slack: float,
    sought: tuple[Drawn, Space],
    told: tuple[Rays, Rules],
    room: Room,
) -> None:
    """Fill in the misfits of each vector, one a lane."""
    (drawn, space), (rays, rules) = sought, told
    lanes = even(len(vectors))
    lay(vectors, space.free, space.fixed, room.lanes)
    turns = stand(lanes, room.lanes)
    draw(drawn, lanes, room.lanes)
    noise_m = slack, rules.edge_m + slack
    lane_misfits(rays, noise_m, (lanes, turns), drawn.storeys, (room.lanes, room.misfit))


@compiled(borrowing=True)
def _cost(misfit: np.ndarray, vector: np.ndarray, space: Space, limit: float) -> float:
    """Sum of squares, tempered for what fits nothing, and of the prior."""
    cost, product = 0.0, 1.0
    for m in range(len(misfit)):
        # One logarithm for many factors.
        product *= 1.0 + (misfit[m] / limit) ** 2
        if product > 1e200:
            cost += math.log(product)
            product = 1.0
    return _prior(limit * limit * (cost + math.log(product)), vector, space)


@compiled(borrowing=True)
def _prior(cost: float, vector: np.ndarray, space: Space) -> float:
    """Add to a cost what the prior says of a vector."""
    for d in range(len(vector)):
        cost += space.precision[d] * (vector[d] - space.centre[d]) ** 2
    return cost


@compiled(borrowing=True)
def _choose(vectors: np.ndarray, tries: int, space: Space, limit: float, room: Room) -> None:
    """Put the best of its tries in each vector's place, and its cost in the second sums."""
    costs = room.sums[0]
    _add_up(room.misfit, even(len(vectors) * tries), limit, room.sums)
    for s in range(len(vectors)):
        least, best = np.inf, -1
        for k in range(s * tries, (s + 1) * tries):
            cost = _prior(limit * limit * costs[k], room.tried[k], space)
            if cost < least:
                least, best = cost, k
        room.sums[1, s] = least
        if best >= 0:
            for d in range(vectors.shape[1]):
                vectors[s, d] = room.tried[best, d]


@compiled(borrowing=True)
def _add_up(misfit: np.ndarray, lanes: int, limit: float, sums: np.ndarray) -> None:
    """Fill in each lane's sum of logarithms of 1 + the square of a misfit over the limit."""
    costs, products = sums[0, :lanes], sums[1, :lanes]
    costs[:] = 0.0
    products[:] = 1.0
    for m in range(len(misfit)):
        row, many = misfit[m], 0
        for k in range(lanes):
            product = products[k] * (1.0 + (row[k] / limit) ** 2)
            products[k] = product
            many |= product > 1e200
        if many:
            for k in range(lanes):
                if products[k] > 1e200:
                    costs[k] += math.log(products[k])
                    products[k] = 1.0
    for k in range(lanes):
        costs[k] += math.log(products[k])


@compiled(borrowing=True)
def _normal(first: int, vector: np.ndarray, space: Space, limit: float, room: Room) -> None:
    """Fill normal matrix (D, D) and gradient (D,) of the weighted squares and the prior.

    first: lane of the vector; those of its moves come next.
    """
    normal, size = room.normal, len(vector)
    sums = room.slopes[: (WIDE + 2) * WIDE]
    sums[:] = 0.0
    pull, slope = WIDE * WIDE, (WIDE + 1) * WIDE
    wide = even(size)
    for d in range(size):
        sums[d * WIDE + d] = space.precision[d]
        sums[pull + d] = space.precision[d] * (vector[d] - space.centre[d])
    for m in range(len(room.misfit)):
        row = room.misfit[m, first : first + space.ways * size + 1]
        off = row[0]
        weight = 1.0 / (1.0 + (off / limit) ** 2)
        for d in range(size):
            back = row[1 + size + d] if space.ways == 2 else off
            sums[slope + d] = (row[1 + d] - back) / (space.ways * space.steps[d])
        for e in range(wide):
            sums[pull + e] += weight * sums[slope + e] * off
        for d in range(size):
            scaled = weight * sums[slope + d]
            # Whole rows, though a triangle is asked for: several entries at a time.
            for e in range(wide):
                sums[d * WIDE + e] += scaled * sums[slope + e]
    for d in range(size):
        room.pull[d] = sums[pull + d]
        for e in range(d + 1):
            normal[d, e] = normal[e, d] = sums[d * WIDE + e]


@compiled()
def _candidates(vector: np.ndarray, space: Space, room: Room, tried: np.ndarray) -> None:
    """Fill in the ends of shares of a step and places around: silhouettes make no parabola."""
    root = room.root
    size, shares = len(vector), len(space.shares)
    inverse = _inverse(room.normal, root)
    step = inverse @ room.pull
    _root(inverse, root)
    for k in range(len(tried)):
        share = space.shares[k] if k < shares else space.shares[0]
        for d in range(size):
            tried[k, d] = vector[d] - share * step[d]
            if k >= shares:
                for e in range(d + 1):
                    tried[k, d] += root[d, e] * space.spread[k - shares, e]


@compiled()
def _inverse(matrix: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return the inverse of a positive definite matrix; root is room to work in."""
    size = len(matrix)
    _root(matrix, root)
    lower = np.zeros((size, size))
    for e in range(size):
        for d in range(e, size):
            total = 1.0 if d == e else 0.0
            for k in range(e, d):
                total -= root[d, k] * lower[k, e]
            lower[d, e] = total / root[d, d]
    return lower.T @ lower


@compiled()
def _root(matrix: np.ndarray, root: np.ndarray) -> None:
    """Fill in the lower triangle L with L L' = matrix."""
    root[:] = 0.0
    for d in range(len(matrix)):
        for e in range(d + 1):
            total = matrix[d, e]
            for k in range(e):
                total -= root[d, k] * root[e, k]
            root[d, e] = math.sqrt(max(total, 1e-30)) if d == e else total / root[e, e]
