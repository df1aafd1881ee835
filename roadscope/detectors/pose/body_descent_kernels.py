"""Damped least squares over rays: all rounds of all starts in one compiled call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import POSE, Rays
from roadscope.detectors.pose.body_misfits import misfits
from roadscope.detectors.pose.body_model import UNKNOWNS, fill_parts


class Drawn(NamedTuple):
    """A body as the kernel draws it; the fields are those of a `BodyModel`, as arrays.

    sizes: (2, 2) mean and standard deviation of length and width, metres. storeys: (P, 7).
    shape: least and greatest radius, axles, narrowing.
    """

    sizes: np.ndarray
    storeys: np.ndarray
    shape: tuple[float, float, float, float, float, float]


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


class Told(NamedTuple):
    """All that misfits depend on beside vector and body."""

    space: Space
    rays: Rays
    rules: Rules


@compiled()
def descended(
    starts: np.ndarray, slacks: np.ndarray, drawn: Drawn, space: Space, told: tuple[Rays, Rules]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return best vectors (S, D), their damped normal matrices (S, D, D) and costs (S,).

    starts: (S, D). slacks: (T,) metres added to noise and edges, round by round, the last one 0.
    told: the rays and what is made of them.
    """
    rays, rules = told
    given = Told(space, rays, rules)
    count, size = starts.shape
    tries = len(space.shares) + len(space.spread)
    moves = space.ways * size + 1
    rows = max(moves, tries)
    best, normals = starts.copy(), np.zeros((count, size, size))
    least = np.full(count, np.inf)
    misfit, states = np.empty((rows, len(rays.slope))), np.empty((rows, POSE))
    parts = np.empty((rows, len(drawn.storeys), 16))
    moved, tried = np.empty((moves, size)), np.empty((tries, size))
    normal, root, pull = np.empty((size, size)), np.empty((size, size)), np.empty(size)
    for s in range(count):
        vector = starts[s].copy()
        for turn in range(len(slacks)):
            slack = slacks[turn]
            _moves(vector, space.steps, moved)
            _misfits(moved, slack, drawn, given, (states, parts, misfit))
            if slack == 0.0:
                cost = _cost(misfit[0], vector, space, rules.limit)
            _normal(misfit, vector, space, rules.limit, (normal, pull))
            for d in range(size):
                # Keeps what the rays say little of from running away.
                normal[d, d] += 1.0 / ((0.3 + slack) * 30.0 * space.steps[d]) ** 2
            if slack == 0.0 and cost < least[s]:
                least[s] = cost
                best[s], normals[s] = vector, normal
            if turn + 1 == len(slacks):
                break
            _candidates(vector, normal, pull, space, (root, tried))
            _misfits(tried, slack, drawn, given, (states, parts, misfit))
            lowest = np.inf
            for k in range(tries):
                cost = _cost(misfit[k], tried[k], space, rules.limit)
                if cost < lowest:
                    lowest = cost
                    vector[:] = tried[k]
    return best, normals, least


@compiled()
def _moves(vector: np.ndarray, steps: np.ndarray, moved: np.ndarray) -> None:
    """Fill in the vector, then with each value moved ahead, then, where there is room, back."""
    size = len(vector)
    for k in range(len(moved)):
        moved[k] = vector
    for d in range(size):
        moved[1 + d, d] += steps[d]
        if len(moved) > 1 + size:
            moved[1 + size + d, d] -= steps[d]


@compiled()
def _misfits(
    vectors: np.ndarray,
    slack: float,
    drawn: Drawn,
    told: Told,
    room: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Fill the misfits of each vector into the third array of the room."""
    space, rules = told.space, told.rules
    states, parts, out = room
    count, whole = len(vectors), np.empty(POSE + UNKNOWNS)
    unknowns, sizes = np.empty((count, UNKNOWNS)), np.empty((2, count))
    for k in range(count):
        whole[:] = space.fixed
        for d in range(len(space.free)):
            whole[space.free[d]] = vectors[k, d]
        states[k], unknowns[k] = whole[:POSE], whole[POSE:]
        for side in range(2):
            mean, deviation = drawn.sizes[side]
            sizes[side, k] = max(mean + deviation * unknowns[k, side], 0.3 * mean)
    fill_parts(unknowns, sizes, drawn.storeys, drawn.shape, parts[:count])
    noise_m = slack, rules.edge_m + slack
    misfits(states[:count], parts[:count], told.rays, noise_m, out[:count])


@compiled()
def _cost(misfit: np.ndarray, vector: np.ndarray, space: Space, limit: float) -> float:
    """Sum of squares, tempered for what fits nothing, and of the prior."""
    cost, product = 0.0, 1.0
    for m in range(len(misfit)):
        # One logarithm for many factors.
        product *= 1.0 + (misfit[m] / limit) ** 2
        if product > 1e200:
            cost += math.log(product)
            product = 1.0
    cost = limit * limit * (cost + math.log(product))
    for d in range(len(vector)):
        cost += space.precision[d] * (vector[d] - space.centre[d]) ** 2
    return cost


@compiled()
def _normal(
    misfit: np.ndarray,
    vector: np.ndarray,
    space: Space,
    limit: float,
    room: tuple[np.ndarray, np.ndarray],
) -> None:
    """Fill normal matrix (D, D) and gradient (D,) of the weighted squares and the prior."""
    normal, pull = room
    size, slope = len(vector), np.empty(len(vector))
    normal[:] = 0.0
    for d in range(size):
        normal[d, d] = space.precision[d]
        pull[d] = space.precision[d] * (vector[d] - space.centre[d])
    for m in range(misfit.shape[1]):
        off = misfit[0, m]
        weight = 1.0 / (1.0 + (off / limit) ** 2)
        for d in range(size):
            back = misfit[1 + size + d, m] if space.ways == 2 else misfit[0, m]
            slope[d] = (misfit[1 + d, m] - back) / (space.ways * space.steps[d])
        for d in range(size):
            pull[d] += weight * slope[d] * off
            for e in range(d + 1):
                normal[d, e] += weight * slope[d] * slope[e]
    for d in range(size):
        for e in range(d):
            normal[e, d] = normal[d, e]


@compiled()
def _candidates(
    vector: np.ndarray,
    normal: np.ndarray,
    pull: np.ndarray,
    space: Space,
    room: tuple[np.ndarray, np.ndarray],
) -> None:
    """Fill in the ends of shares of a step and places around: silhouettes make no parabola."""
    root, tried = room
    size, shares = len(vector), len(space.shares)
    inverse = _inverse(normal, root)
    step = inverse @ pull
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
