"""The likelihood of rays given many states of a body on its way, one state a lane.

A body is a stack of upright parts with rounded rectangular footprints. A ray that meets it
returns at its surface, with Gaussian noise; a ray that misses it brings no return of it. Edges
are soft by a few centimetres, because no body is exactly as drawn.
"""

from __future__ import annotations

import math

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import AMPLE, HIT, MOST_PARTS, PASSED, Chances, Rays
from roadscope.detectors.pose.body_lane_meeting import BRIGHT, CHANCE, DISTANCE, FIRST, meet
from roadscope.detectors.pose.body_lane_rays import see
from roadscope.detectors.pose.body_lanes import (
    LANES,
    LEVEL,
    Drawn,
    draw,
    even,
    go,
    lay,
    new_room,
    stand,
)

GAUSS = 0.3989422804014327
"""Density of a standard normal at its middle."""
NOISE = 6.0
"""Returns farther than so many standard deviations from a surface are none of it."""
EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(12, -1, -1))
"""Its series, the last term first."""


@compiled()
def log_likelihoods(
    vectors: np.ndarray,
    body: Drawn,
    kept: tuple[np.ndarray, np.ndarray],
    told: tuple[Rays, Chances],
) -> np.ndarray:
    """Return the log-likelihood (K,) of each of (K, D) vectors.

    kept: `free` (D,), indices of the vector's values among the 11, and `fixed` (11,), the others.
    """
    out = np.empty((len(vectors), 1))
    _fill_rows(vectors, body, kept, told, (out, True))
    return out[:, 0]


@compiled()
def ray_chances(
    vectors: np.ndarray,
    body: Drawn,
    kept: tuple[np.ndarray, np.ndarray],
    told: tuple[Rays, Chances],
) -> np.ndarray:
    """Return the likelihood (K, M) of each ray alone; arguments as above."""
    out = np.empty((len(vectors), len(told[0].slope)))
    _fill_rows(vectors, body, kept, told, (out, False))
    return out


@compiled()
def _fill_rows(
    vectors: np.ndarray,
    body: Drawn,
    kept: tuple[np.ndarray, np.ndarray],
    told: tuple[Rays, Chances],
    into: tuple[np.ndarray, bool],
) -> None:
    """Fill in a row for each vector; into: the rows, and whether each is the sum of logarithms."""
    out, summed = into
    sums, each = np.empty((2, LANES)), np.empty((len(told[0].slope), LANES))
    room, met = new_room(len(body.storeys)), np.empty((MOST_PARTS, 4, LANES))
    for first in range(0, len(vectors), LANES):
        last = min(first + LANES, len(vectors))
        _fill(vectors[first:last], body, kept, told, (room, met, each))
        if summed:
            _add_logs(each, even(last - first), sums)
            out[first:last, 0] = sums[0, : last - first]
        else:
            out[first:last] = each[:, : last - first].T


@compiled(borrowing=True)
def _fill(
    vectors: np.ndarray,
    body: Drawn,
    kept: tuple[np.ndarray, np.ndarray],
    told: tuple[Rays, Chances],
    rooms: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Fill in the density of each return, or the chance of none.

    rooms: that of `body_lanes`; (P, 4, LANES), what a ray meets; and (M, LANES), filled in.
    """
    free, fixed = kept
    room, _, _ = rooms
    lanes = even(len(vectors))
    lay(vectors, free, fixed, room)
    turns = stand(lanes, room)
    draw(body, lanes, room)
    _lane_chances(told, (lanes, turns), body.storeys, rooms)


@compiled(borrowing=True)
def _lane_chances(
    told: tuple[Rays, Chances],
    standing: tuple[int, bool],
    storeys: np.ndarray,
    rooms: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Do as `_fill` does for lanes that stand and are drawn; standing: how many, and any turns."""
    (rays, chances), (lanes, turns), (room, met, out) = told, standing, rooms
    now = np.nan
    for m in range(len(rays.slope)):
        if rays.time[m] != now:
            now = rays.time[m]
            go(now, turns, lanes, room)
        path = rays.origin[m, 0], rays.origin[m, 1], rays.direction[m, 0], rays.direction[m, 1]
        see(path, lanes, room)
        rise = rays.origin[m, 2], rays.slope[m]
        count = meet(rise, chances, storeys, lanes, (room, met))
        _order(count, lanes, met)
        passed = rays.kind[m] == PASSED
        _brighten(0.0 if passed else rays.need[m], chances.steep, met[:count, :, :lanes])
        row, free = out[m, :lanes], room[LEVEL : LEVEL + lanes]
        if rays.kind[m] == HIT:
            _returned(rays.reach[m], rays.sigma[m], chances, met[:count], row)
        else:
            silent = chances.through if passed else chances.lost
            _kept_silent(rays.reach[m], silent, met[:count], free, row)


@compiled(borrowing=True)
def _order(count: int, lanes: int, met: np.ndarray) -> None:
    """Fill in the chance that each part is the first that a ray meets."""
    for i in range(count):
        here = met[i]
        for k in range(lanes):
            here[FIRST, k] = here[CHANCE, k]
        for j in range(count):
            there = met[j]
            if i != j:
                for k in range(lanes):
                    left = 1.0 - there[CHANCE, k]
                    nearer = there[DISTANCE, k] < here[DISTANCE, k]
                    here[FIRST, k] *= left if nearer else 1.0


@compiled(borrowing=True)
def _brighten(need: float, steep: int, met: np.ndarray) -> None:
    """Turn cosines of incidence into the chance that the surface sends enough back, as `seen`."""
    for i in range(len(met)):
        distances, bright = met[i, DISTANCE], met[i, BRIGHT]
        if need == 0.0:
            bright[:] = 1.0
            continue
        for k in range(len(bright)):
            ratio = bright[k] / (need * distances[k] * distances[k])
            bright[k] = ratio if ratio < AMPLE else AMPLE
        for _ in range(steep):
            for k in range(len(bright)):
                bright[k] *= bright[k]
        for k in range(len(bright)):
            bright[k] = bright[k] / (1.0 + bright[k])


@compiled(borrowing=True)
def _returned(
    reach: float, sigma: float, chances: Chances, met: np.ndarray, row: np.ndarray
) -> None:
    """Fill in the density of a return."""
    row[:] = chances.outlier / chances.outlier_m
    peak = (1.0 - chances.outlier) * GAUSS / sigma
    for i in range(len(met)):
        here = met[i]
        for k in range(len(row)):
            z = (reach - here[DISTANCE, k]) / sigma
            sent = here[BRIGHT, k]
            sent = sent if sent > 0.01 else 0.01
            density = here[FIRST, k] * peak * sent * _fallen(z * z)
            row[k] += density if abs(z) <= NOISE else 0.0


@compiled(borrowing=True, forceinline=True)
def _fallen(square: float) -> float:
    """Return exp(-square / 2) for a square from 0 to 36, in lanes, all but to the last bit.

    The series of the 32nd root is short.
    """
    x = square if square < 36.0 else 36.0
    x = x * (-0.5 / 32.0)
    power = 0.0
    for k in range(len(EXPONENTIAL)):
        power = EXPONENTIAL[k] + x * power
    for _ in range(5):
        power *= power
    return power


@compiled(borrowing=True)
def _kept_silent(
    reach: float, silent: float, met: np.ndarray, free: np.ndarray, row: np.ndarray
) -> None:
    """Fill in the chance that a ray meets no part, or that the first one sends nothing back.

    silent: least chance of that. free: room to work in.
    """
    row[:] = 0.0
    free[:] = 1.0
    for i in range(len(met)):
        here = met[i]
        for k in range(len(row)):
            dark = 1.0 - here[BRIGHT, k]
            dark = dark if dark > silent else silent
            before = here[DISTANCE, k] < reach
            row[k] += here[FIRST, k] * dark if before else 0.0
            free[k] *= 1.0 - here[CHANCE, k] if before else 1.0
    for k in range(len(row)):
        row[k] += free[k]


@compiled(borrowing=True)
def _add_logs(each: np.ndarray, lanes: int, sums: np.ndarray) -> None:
    """Fill in the sum of logarithms of each lane's chances (M, LANES) in the first row of sums."""
    totals, products = sums[0, :lanes], sums[1, :lanes]
    totals[:] = 0.0
    products[:] = 1.0
    for m in range(len(each)):
        row, many = each[m], 0
        for k in range(lanes):
            product = products[k] * row[k]
            products[k] = product
            many |= (product > 1e200) | (product < 1e-200)
        # One logarithm for many factors.
        if many:
            for k in range(lanes):
                totals[k] += math.log(products[k])
                products[k] = 1.0
    for k in range(lanes):
        totals[k] += math.log(products[k])
