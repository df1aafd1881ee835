"""Clustering by growth within a constrained scan angle (Zhang 2022, section 2.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.arguments import check_not_negative, check_positive
from roadscope.core.disjoint_sets import join, root_of
from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering.density import OUTLIER
from roadscope.detectors.sorting import median_of, order_by, starts_of

SPACINGS = 2.0
"""Links are so many spacings long. Neighbours on a face across the beam are one spacing apart, so
one lost return is bridged."""
UPRIGHT = 0.05
"""Two returns of a column whose ranges differ by less than this share lie on an upright face.
Chosen by hand."""
MOST_SECTORS = 4096
"""Most sectors of a full turn; it limits the time for scans with very short links."""
ROUNDING_SHARE = 1e-9
"""Cells are wider than half of the longest link by this share, because of rounding."""
TURN_ERROR = 2e-5
"""Greatest error of the fast arc tangent that chooses a return's sector, radians."""
CELLS_PER_LINK = 2
"""Two linked returns lie at most so many cells apart, in range and in angle."""


def cluster_range_angle(
    cloud: Cloud,
    *,
    eps_m: float = 0.02,
    angle_deg: float = 5.0,
    min_points: int = 30,
    spacings: float = SPACINGS,
) -> np.ndarray:
    """Grow clusters within a scan angle (Zhang 2022).

    Returns (N,) int64 labels, negative where a cluster has fewer than `min_points`.

    Two returns are linked if they are at most epsilon apart in space (eq. 1) and at most
    `angle_deg` in azimuth.

    Where we depart from the paper: its epsilon of 0.02 m is less than the gap between two beams of
    its VLP-16 beyond 0.6 m, and between two columns beyond 6 m. Here epsilon is `eps_m`, which
    stands for noise, plus `spacings` times the spacing of returns at the lesser of the two ranges.
    The spacing is that of beams or of columns, whichever is wider. With `spacings=0` epsilon is
    `eps_m` at every range, as printed.

    The paper grows a cluster from a seed, then from the farthest returns in six directions, until
    no return satisfies eq. 1 any more. That gives the connected components of links, in whatever
    order seeds are taken. The angle limits links, not clusters: a cluster may be wider. In the
    odometry of Zhang 2022 it limits clusters, too.
    """
    check_positive(eps_m=eps_m, angle_deg=angle_deg, min_points=min_points)
    check_not_negative(spacings=spacings)
    if not len(cloud):
        return np.empty(0, np.int64)
    rule = _link_rule(
        cloud, float(eps_m), float(np.radians(angle_deg)), reach=spacings * spacing(cloud)
    )
    first_rows = linked_sets(cloud.points, cloud.origin, cloud.ring, rule)
    large = np.bincount(first_rows) >= min_points
    numbers = np.where(large, np.cumsum(large) - 1, OUTLIER)
    labels: np.ndarray = numbers[first_rows]
    return labels


def spacing(cloud: Cloud) -> float:
    """Return the angle in radians between neighbouring beams or columns, whichever is wider.

    It is estimated from the returns, because a cloud does not state the directions of the beams.
    """
    return float(_spacing(cloud.points, cloud.ring, cloud.column, cloud.origin))


@compiled()
def _spacing(points: np.ndarray, ring: np.ndarray, column: np.ndarray, origin: np.ndarray) -> float:
    """Return the greater of two medians: of angles between beams and of angles between columns.

    Angles between beams are measured on upright faces.
    """
    rises, steps = np.empty(len(ring)), np.empty(len(ring))
    upright, turns, azimuth, first_of_column = 0, 0, 0.0, -1
    here = 0.0
    for row in range(len(ring)):
        x, y = points[row, 0] - origin[0], points[row, 1] - origin[1]
        last, here = here, np.sqrt(x * x + y * y)
        if row == 0 or column[row] != column[row - 1]:
            before, azimuth = azimuth, np.arctan2(y, x)
            if first_of_column >= 0:
                turn = abs((azimuth - before + np.pi) % (2 * np.pi) - np.pi)
                steps[turns] = turn / max(abs(column[row] - column[first_of_column]), 1)
                turns += 1
            first_of_column = row
        elif ring[row] > ring[row - 1]:
            nearer = min(here, last)
            if nearer > 0 and abs(here - last) < UPRIGHT * nearer:
                beams = ring[row] - ring[row - 1]
                rises[upright] = (points[row, 2] - points[row - 1, 2]) / beams / nearer
                upright += 1
    widest = 0.0
    if upright:
        widest = max(widest, median_of(rises[:upright]))
    if turns:
        widest = max(widest, median_of(steps[:turns]))
    return float(widest)


# --------------------------------------------------------------------------------------------------
# Which returns are linked; cells of angle and range limit the pairs that are compared.


class LinkRule(NamedTuple):
    """When two returns are linked.

    eps_m, reach: greatest distance between them at range 0, metres, and its growth per metre of
    range. angle, cosine: greatest angle between them in azimuth, radians, and its cosine; -2 where
    any angle is allowed.
    """

    eps_m: float
    reach: float
    angle: float
    cosine: float


class SweptReturns(NamedTuple):
    """Returns in the order of the sweep.

    points: (N, 3) metres. origin: (2,) or longer, metres, x and y of the sensor's axis.
    ranges: (N,) metres from the axis.
    """

    points: np.ndarray
    origin: np.ndarray
    ranges: np.ndarray


class PolarCells(NamedTuple):
    """Returns sorted by cells of angle and range.

    order: (N,) int64 rows of returns, cell by cell. starts: (C + 1,) int64, where each cell begins
    in it, and N. sector, shell: (C,) int64 of each cell, sorted by sector, then by shell.
    sectors: how many there are in a full turn.
    """

    order: np.ndarray
    starts: np.ndarray
    sector: np.ndarray
    shell: np.ndarray
    sectors: int


def _link_rule(cloud: Cloud, eps_m: float, angle: float, *, reach: float) -> LinkRule:
    """Return the rule for a cloud; its angle is no wider than the longest link needs."""
    x, y = (cloud.points[:, :2] - cloud.origin).T
    nearest = max(float(np.sqrt((x * x + y * y).min())), eps_m)
    # No link spans a greater angle, not even at the nearest return; 1e-9 allows for rounding.
    share = eps_m / nearest + reach
    widest = np.pi if share >= 1.0 else 1e-9 + float(np.arcsin(share))
    within = min(angle, widest)
    return LinkRule(eps_m, reach, within, float(np.cos(within)) if within < np.pi else -2.0)


def linked_sets(
    points: np.ndarray, origin: np.ndarray, ring: np.ndarray, rule: LinkRule
) -> np.ndarray:
    """Return for each of (N, 3) points the first row, (N,) int64, of its set of linked points.

    Points are in the order of the sweep. Neighbours in the sweep are linked first: then most cells
    are in one set, and returns of one set need not be compared.
    """
    wide = (rule.angle + 2 * TURN_ERROR) / CELLS_PER_LINK * (1 + ROUNDING_SHARE)
    sectors = int(min(2 * np.pi / wide, MOST_SECTORS))
    sectors = sectors if sectors > 2 * CELLS_PER_LINK else 1
    ranges, sector, shell = _places(points, origin, sectors, rule)
    swept = SweptReturns(points, origin, ranges)
    parents = _linked_neighbours(swept, ring, rule)
    order = order_by(shell)
    order = order[order_by(sector[order])]
    sector, shell = sector[order], shell[order]
    starts = starts_of(sector, shell)
    cells = PolarCells(order, starts, sector[starts[:-1]], shell[starts[:-1]], sectors)
    _link_cells(swept, parents, cells, rule)
    return parents


@compiled()
def _places(
    points: np.ndarray, origin: np.ndarray, sectors: int, rule: LinkRule
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return range in metres, sector and shell of each point, (N,).

    Sectors are half as wide as the greatest angle of a link, shells half as deep as its greatest
    length. This length grows with range, so ranges are counted in links: the number of links from
    the axis to r is the integral of dr / (eps + reach r).
    """
    size = len(points)
    ranges = np.empty(size)
    sector, shell = np.empty(size, np.int64), np.empty(size, np.int64)
    for row in range(size):
        x, y = points[row, 0] - origin[0], points[row, 1] - origin[1]
        ranges[row] = np.sqrt(x * x + y * y)
        number = int((quick_azimuth(x, y) / (2 * np.pi) + 0.5) * sectors)
        sector[row] = number if number < sectors else 0
        links = ranges[row] / rule.eps_m
        if rule.reach > 0:
            grown = rule.reach * links
            # log takes half the time of log1p, which only small numbers need.
            links = (np.log(1.0 + grown) if grown > 1e-3 else np.log1p(grown)) / rule.reach
        shell[row] = int(CELLS_PER_LINK * links * (1 - ROUNDING_SHARE))
    return ranges, sector, shell


@compiled(forceinline=True, borrowing=True)
def quick_azimuth(x: float, y: float) -> float:
    """Return arctan2 of y and x, radians, with an error below 1.2e-5.

    It is a polynomial by Hastings (Abramowitz and Stegun, 4.4.47).
    """
    wide, high = abs(x), abs(y)
    most = max(wide, high)
    slope = min(wide, high) / most if most > 0.0 else 0.0
    s = slope * slope
    turn = -0.0851330 + s * 0.0208351
    turn = slope * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * turn)))
    turn = np.pi / 2 - turn if high > wide else turn
    turn = np.pi - turn if x < 0.0 else turn
    return -turn if y < 0.0 else turn


@compiled()
def _linked_neighbours(swept: SweptReturns, ring: np.ndarray, rule: LinkRule) -> np.ndarray:
    """Link each return with the last one and with the last of its ring; return parents, (N,) int64.

    parents: as in `root_of`.
    """
    parents, lowest = np.arange(len(ring)), ring.min()
    last = np.full(ring.max() - lowest + 1, -1)
    for row in range(len(ring)):
        before, beside = row - 1, last[ring[row] - lowest]
        last[ring[row] - lowest] = row
        if before >= 0 and _are_linked(swept, row, before, rule):
            join(parents, row, before)
        if beside >= 0 and beside != before and _are_linked(swept, row, beside, rule):
            join(parents, row, beside)
    return parents


@compiled()
def _link_cells(
    swept: SweptReturns, parents: np.ndarray, cells: PolarCells, rule: LinkRule
) -> None:
    """Join linked returns within cells and between near cells, in place.

    parents: (N,) int64, as in `root_of`; in the end the first row of each return's set.
    """
    sector, shell, size = cells.sector, cells.shell, len(cells.sector)
    whole = np.empty(size, np.bool_)
    for cell in range(size):
        whole[cell] = _is_one_set(parents, cells, cell)
        if not whole[cell]:
            _link_pair(swept, parents, cells, cell, cell, False, rule)
            whole[cell] = _is_one_set(parents, cells, cell)
    begin = np.searchsorted(sector, np.arange(cells.sectors + 1))
    around = CELLS_PER_LINK if cells.sectors > 1 else 0
    for cell in range(size):
        for shift in range(around + 1):
            beside = (sector[cell] + shift) % cells.sectors
            other, end = cell + 1, begin[beside + 1]
            if shift > 0:
                other = begin[beside]
                other += np.searchsorted(shell[other:end], shell[cell] - CELLS_PER_LINK)
            while other < end and shell[other] <= shell[cell] + CELLS_PER_LINK:
                one_link = whole[cell] and whole[other]
                _link_pair(swept, parents, cells, cell, other, one_link, rule)
                other += 1
    for row in range(len(parents)):
        parents[row] = root_of(parents, row)


@compiled(borrowing=True)
def _is_one_set(parents: np.ndarray, cells: PolarCells, cell: int) -> bool:
    """Return whether all returns of a cell are in one set."""
    first, end = cells.starts[cell], cells.starts[cell + 1]
    root, place = root_of(parents, cells.order[first]), first + 1
    while place < end and root_of(parents, cells.order[place]) == root:
        place += 1
    return bool(place == end)


@compiled(borrowing=True)
def _link_pair(
    swept: SweptReturns,
    parents: np.ndarray,
    cells: PolarCells,
    one: int,
    two: int,
    one_link: bool,
    rule: LinkRule,
) -> None:
    """Join the linked returns of two cells, or of one.

    one_link: whether each cell is one set, so that a single link joins both.
    """
    order, starts = cells.order, cells.starts
    if one_link and root_of(parents, order[starts[one]]) == root_of(parents, order[starts[two]]):
        return
    for place in range(starts[one], starts[one + 1]):
        row = order[place]
        for beside in range(starts[two], starts[two + 1]):
            other = order[beside]
            if not _are_linked(swept, row, other, rule):
                continue
            join(parents, row, other)
            if one_link:
                return


@compiled(borrowing=True)
def _are_linked(swept: SweptReturns, row: int, other: int, rule: LinkRule) -> bool:
    """Return whether two returns are near each other, in space and in azimuth."""
    limit = rule.eps_m + rule.reach * min(swept.ranges[row], swept.ranges[other])
    square = 0.0
    for axis in range(3):
        square += (swept.points[row, axis] - swept.points[other, axis]) ** 2
    if square > limit * limit:
        return False
    # The cosine of the angle between them; a return on the sensor's axis has no azimuth.
    along = 0.0
    for axis in range(2):
        middle = swept.origin[axis]
        along += (swept.points[row, axis] - middle) * (swept.points[other, axis] - middle)
    both = swept.ranges[row] * swept.ranges[other]
    return bool(both > 0.0 and along >= rule.cosine * both)
