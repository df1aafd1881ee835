"""Which returns are linked to which, by way of cells of angle and range.

Two returns are linked if they are nearer than or at a limit that grows with the lesser of their
ranges, and within an angle of one another as the sensor turns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.clustering.union import join, root_of
from roadscope.detectors.sorting import order_by

MOST_SECTORS = 4096
HAIR = 1e-9
"""Cells are wider than half of what is linked by this share, for rounding."""
BESIDE = 2
"""Links reach over so many cells in range and so many in angle."""


class Rule(NamedTuple):
    """When two returns are linked: limit in metres at range 0 and more per metre, and an angle."""

    eps_m: float
    reach: float
    angle: float


class Polar(NamedTuple):
    """Returns in the order of their cells: (N, 3) points, rings, azimuths, ranges."""

    points: np.ndarray
    ring: np.ndarray
    azimuths: np.ndarray
    ranges: np.ndarray


@compiled()
def linked_sets(points: np.ndarray, origin: np.ndarray, ring: np.ndarray, rule: Rule) -> np.ndarray:
    """Return for each of (N, 3) points one, (N,) int64, that stands for all it is linked with."""
    keys, azimuths, ranges, shells, sectors = _cells(points, origin, rule)
    order = order_by(keys)
    cloud = Polar(points[order], ring[order], azimuths[order], ranges[order])
    parents = np.arange(len(points))
    starts, cells = _starts(keys[order])
    whole = np.empty(len(cells), np.bool_)
    for cell in range(len(cells)):
        whole[cell] = _link_inside(cloud, parents, (starts[cell], starts[cell + 1]), rule)
    around = BESIDE if sectors > 1 else 0
    for cell in range(len(cells)):
        sector, shell = cells[cell] // shells, cells[cell] % shells
        for shift in range(around + 1):
            base = (sector + shift) % sectors * shells
            first = base + (shell + 1 if shift == 0 else max(shell - BESIDE, 0))
            last = base + min(shell + BESIDE, shells - 1)
            other = np.searchsorted(cells, first)
            while other < len(cells) and cells[other] <= last:
                rows = (starts[cell], starts[cell + 1], starts[other], starts[other + 1])
                _link_across(cloud, parents, rows, whole[cell] and whole[other], rule)
                other += 1
    sets = np.empty(len(points), np.int64)
    for row in range(len(points)):
        sets[order[row]] = order[root_of(parents, row)]
    return sets


@compiled()
def _cells(
    points: np.ndarray, origin: np.ndarray, rule: Rule
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int, int]:
    """Return cell, azimuth and range of each point, the number of shells and that of sectors.

    Sectors are as wide as half the angle, shells as half the limit: range is measured in limits,
    the integral of dr / (eps + reach r).
    """
    sectors = int(min(2 * np.pi / (rule.angle / BESIDE * (1 + HAIR)), MOST_SECTORS))
    sectors = sectors if sectors > 2 * BESIDE else 1
    size = len(points)
    azimuths, ranges = np.empty(size), np.empty(size)
    sector, shell, shells = np.empty(size, np.int64), np.empty(size, np.int64), 1
    for row in range(size):
        x, y = points[row, 0] - origin[0], points[row, 1] - origin[1]
        azimuths[row], ranges[row] = np.arctan2(y, x), np.sqrt(x * x + y * y)
        turn = (azimuths[row] / (2 * np.pi) + 0.5) * sectors
        sector[row] = int(turn) % sectors
        limits = ranges[row] / rule.eps_m
        if rule.reach > 0:
            limits = np.log1p(rule.reach * limits) / rule.reach
        shell[row] = int(BESIDE * limits * (1 - HAIR))
        shells = max(shells, shell[row] + 1)
    return sector * shells + shell, azimuths, ranges, shells, sectors


@compiled()
def _starts(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where each run of equal keys begins, and N, and the keys: (C + 1,) and (C,)."""
    starts, cells, count = np.empty(len(keys) + 1, np.int64), np.empty(len(keys), np.int64), 0
    for row in range(len(keys)):
        if row == 0 or keys[row] != keys[row - 1]:
            starts[count], cells[count] = row, keys[row]
            count += 1
    starts[count] = len(keys)
    return starts[: count + 1], cells[:count]


@compiled()
def _link_inside(cloud: Polar, parents: np.ndarray, rows: tuple[int, int], rule: Rule) -> bool:
    """Join the linked points of a cell; return whether all hang together."""
    first, end = rows
    for row in range(first + 1, end):
        # Neighbours along the column and along the ring are near in the order of the sweep.
        for other in range(row - 1, first - 1, -1):
            beside = other == row - 1 or cloud.ring[other] == cloud.ring[row]
            if beside and _are_linked(cloud, row, other, rule):
                join(parents, row, other)
            if other < row - 1 and cloud.ring[other] == cloud.ring[row]:
                break
    if _hangs_together(parents, first, end):
        return True
    for row in range(first, end):
        for other in range(row + 1, end):
            if parents[row] != parents[other] and _are_linked(cloud, row, other, rule):
                join(parents, row, other)
    return _hangs_together(parents, first, end)


@compiled()
def _hangs_together(parents: np.ndarray, first: int, end: int) -> bool:
    root, row = root_of(parents, first), first + 1
    while row < end and root_of(parents, row) == root:
        row += 1
    return row == end


@compiled()
def _link_across(
    cloud: Polar, parents: np.ndarray, rows: tuple[int, int, int, int], whole: bool, rule: Rule
) -> None:
    """Join the linked points of two cells; where each hangs together one link is enough."""
    first, end, start, stop = rows
    if whole and root_of(parents, first) == root_of(parents, start):
        return
    low, high = cloud.points[start:stop, 2].min(), cloud.points[start:stop, 2].max()
    for row in range(first, end):
        z = cloud.points[row, 2]
        farthest = rule.eps_m + rule.reach * cloud.ranges[row]
        if z < low - farthest or z > high + farthest:
            continue
        for other in range(start, stop):
            if parents[row] != parents[other] and _are_linked(cloud, row, other, rule):
                join(parents, row, other)
                if whole:
                    return


@compiled()
def _are_linked(cloud: Polar, row: int, other: int, rule: Rule) -> bool:
    limit = rule.eps_m + rule.reach * min(cloud.ranges[row], cloud.ranges[other])
    square = 0.0
    for axis in range(3):
        square += (cloud.points[row, axis] - cloud.points[other, axis]) ** 2
    if square > limit * limit:
        return False
    turn = abs(cloud.azimuths[row] - cloud.azimuths[other])
    return bool(min(turn, 2 * np.pi - turn) <= rule.angle)
