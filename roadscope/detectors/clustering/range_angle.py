"""Clustering by growth within a constrained scan angle (Zhang 2022, section 2.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering.density import OUTLIER
from roadscope.detectors.clustering.union import join, root_of
from roadscope.detectors.sorting import median_of, order_by

# --------------------------------------------------------------------------------------------------
# Which returns are linked to which, by way of cells of angle and range.

MOST_SECTORS = 4096
HAIR = 1e-9
"""Cells are wider than half of what is linked by this share, for rounding."""
TURN_ERROR = 2e-5
"""Sectors are told by an arc tangent that is quick and so far off at most, radians."""
BESIDE = 2
"""Links reach over so many cells in range and so many in angle."""
SEVERAL = -1
"""In place of a row that stands for all of a run or cell."""


class Rule(NamedTuple):
    """When two returns are linked: limit in metres at range 0 and more per metre, and an angle.

    cosine: of the angle; -1 or less from half a turn on.
    """

    eps_m: float
    reach: float
    angle: float
    cosine: float


class Polar(NamedTuple):
    """Returns as swept.

    points: (N, 3). origin: (2,) or longer, x and y of the axis. ranges: (N,) from the axis.
    """

    points: np.ndarray
    origin: np.ndarray
    ranges: np.ndarray


class Runs(NamedTuple):
    """Returns of one cell and one ring: (R + 1,) starts in the order of cells, and N.

    order: (N,) rows of returns by sector, shell and ring.
    lows, highs: (R,) metres, least and greatest height. limits: (R,) metres, no link is longer.
    wholes: (R,) row that stands for all of a run, or `SEVERAL`, once neighbours were linked.
    """

    order: np.ndarray
    starts: np.ndarray
    lows: np.ndarray
    highs: np.ndarray
    limits: np.ndarray
    wholes: np.ndarray


@compiled()
def linked_sets(points: np.ndarray, origin: np.ndarray, ring: np.ndarray, rule: Rule) -> np.ndarray:
    """Return for each of (N, 3) points one, (N,) int64, that stands for all it is linked with.

    Neighbours in the sweep, which is the order of the points, are linked first: what then is in
    one set need not be compared.
    """
    cloud, sector, shell, sectors = _cells(points, origin, rule)
    parents = _neighbours(cloud, ring, rule)
    order = _order(sector, shell, ring)
    runs, cells = _runs(cloud, parents, (sector, shell, ring, order), rule)
    firsts = order[runs.starts[cells[:-1]]]
    around = BESIDE if sectors > 1 else 0
    parts = runs, cells, sector[firsts], shell[firsts]
    _link_cells(cloud, parents, parts, (sectors, around), rule)
    for row in range(len(parents)):
        parents[row] = root_of(parents, row)
    return parents


@compiled()
def _order(sector: np.ndarray, shell: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Return the order, (N,) int64, by sector, then shell, then ring."""
    lowest = ring.min()
    rings, keys = ring.max() - lowest + 1, np.empty(len(ring), np.int64)
    for row in range(len(ring)):
        keys[row] = shell[row] * rings + ring[row] - lowest
    order = order_by(keys)
    for row in range(len(ring)):
        keys[row] = sector[order[row]]
    again = order_by(keys)
    for row in range(len(ring)):
        again[row] = order[again[row]]
    return again


@compiled()
def _cells(
    points: np.ndarray, origin: np.ndarray, rule: Rule
) -> tuple[Polar, np.ndarray, np.ndarray, int]:
    """Return the points, sector and shell of each, (N,) int64, and the number of sectors.

    Sectors are as wide as half the angle, shells as half the limit: range is measured in limits,
    the integral of dr / (eps + reach r).
    """
    wide = (rule.angle + 2 * TURN_ERROR) / BESIDE * (1 + HAIR)
    sectors = int(min(2 * np.pi / wide, MOST_SECTORS))
    sectors = sectors if sectors > 2 * BESIDE else 1
    size = len(points)
    ranges = np.empty(size)
    sector, shell = np.empty(size, np.int64), np.empty(size, np.int64)
    for row in range(size):
        x, y = points[row, 0] - origin[0], points[row, 1] - origin[1]
        ranges[row] = np.sqrt(x * x + y * y)
        behind = int((quick_azimuth(x, y) / (2 * np.pi) + 0.5) * sectors)
        sector[row] = behind if behind < sectors else 0
        limits = ranges[row] / rule.eps_m
        if rule.reach > 0:
            grown = rule.reach * limits
            # Half the time of log1p, which small ones need.
            limits = (np.log(1.0 + grown) if grown > 1e-3 else np.log1p(grown)) / rule.reach
        shell[row] = int(BESIDE * limits * (1 - HAIR))
    return Polar(points, origin, ranges), sector, shell, sectors


@compiled(forceinline=True, borrowing=True)
def quick_azimuth(x: float, y: float) -> float:
    """Return arctan2 to 1.2e-5 by a polynomial of Hastings (Abramowitz and Stegun, 4.4.47)."""
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
def _neighbours(swept: Polar, ring: np.ndarray, rule: Rule) -> np.ndarray:
    """Return parents, (N,) int64, after links to the last return and to the last of the ring."""
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
def _runs(
    cloud: Polar,
    parents: np.ndarray,
    keys: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    rule: Rule,
) -> tuple[Runs, np.ndarray]:
    """Return runs of one sector, shell and ring, and at which of them cells begin, (C + 1,).

    keys: sector, shell and ring of each return, and the order by them.
    """
    sector, shell, ring, order = keys
    size, count, cell = len(ring), 0, 0
    starts, cells = np.empty(size + 1, np.int64), np.empty(size + 1, np.int64)
    lows, highs, limits = np.empty(size), np.empty(size), np.empty(size)
    wholes = np.empty(size, np.int64)
    last = -1
    for place in range(size):
        row = order[place]
        z, limit = cloud.points[row, 2], rule.eps_m + rule.reach * cloud.ranges[row]
        root = root_of(parents, row)
        new = place == 0 or sector[row] != sector[last] or shell[row] != shell[last]
        if new:
            cells[cell] = count
            cell += 1
        if new or ring[row] != ring[last]:
            starts[count], lows[count], highs[count], limits[count] = place, z, z, limit
            wholes[count] = root
            count += 1
        last, run = row, count - 1
        wholes[run] = root if wholes[run] == root else SEVERAL
        lows[run], highs[run] = min(lows[run], z), max(highs[run], z)
        limits[run] = max(limits[run], limit)
    starts[count], cells[cell] = size, count
    return Runs(order, starts[: count + 1], lows, highs, limits, wholes), cells[: cell + 1]


@compiled()
def _link_cells(
    cloud: Polar,
    parents: np.ndarray,
    parts: tuple[Runs, np.ndarray, np.ndarray, np.ndarray],
    turn: tuple[int, int],
    rule: Rule,
) -> None:
    """Join what is linked within cells and between those beside one another.

    parts: runs, at which cells begin, and each cell's sector and shell. turn: the number of
    sectors, and how many further ones links reach.
    """
    (runs, cells, sector, shell), (sectors, around) = parts, turn
    size = len(sector)
    whole = np.empty(size, np.int64)
    for cell in range(size):
        whole[cell] = _link_inside(cloud, parents, runs, (cells[cell], cells[cell + 1]), rule)
    begin = np.searchsorted(sector, np.arange(sectors + 1))
    for cell in range(size):
        for shift in range(around + 1):
            beside = (sector[cell] + shift) % sectors
            other, end = cell + 1, begin[beside + 1]
            if shift > 0:
                other = begin[beside]
                other += np.searchsorted(shell[other:end], shell[cell] - BESIDE)
            while other < end and shell[other] <= shell[cell] + BESIDE:
                both = whole[cell] != SEVERAL and whole[other] != SEVERAL
                rows = (cells[cell], cells[cell + 1], cells[other], cells[other + 1])
                if not (both and _same(parents, whole[cell], whole[other])):
                    _link_across(cloud, parents, (runs, rows, both), rule)
                other += 1


@compiled(borrowing=True)
def _same(parents: np.ndarray, row: int, other: int) -> bool:
    return bool(root_of(parents, row) == root_of(parents, other))


@compiled(borrowing=True)
def _link_inside(
    cloud: Polar, parents: np.ndarray, runs: Runs, cell: tuple[int, int], rule: Rule
) -> int:
    """Join the linked points of a cell; return one of them if all hang together."""
    if _all_whole(parents, runs, cell):
        return int(runs.wholes[cell[0]])
    for run in range(cell[0], cell[1]):
        for other in range(run, cell[1]):
            _link_runs(cloud, parents, (runs, run, other), rule)
    first, end = runs.starts[cell[0]], runs.starts[cell[1]]
    whole = _hangs_together(parents, runs.order, first, end)
    return int(runs.order[first]) if whole else SEVERAL


@compiled(borrowing=True)
def _all_whole(parents: np.ndarray, runs: Runs, cell: tuple[int, int]) -> bool:
    """Whether the runs of a cell were found whole, and of one set."""
    whole = runs.wholes[cell[0]]
    if whole == SEVERAL:
        return False
    for run in range(cell[0] + 1, cell[1]):
        other = runs.wholes[run]
        if other == SEVERAL or (other != whole and not _same(parents, whole, other)):
            return False
    return True


@compiled(borrowing=True)
def _hangs_together(parents: np.ndarray, order: np.ndarray, first: int, end: int) -> bool:
    root, place = root_of(parents, order[first]), first + 1
    while place < end and root_of(parents, order[place]) == root:
        place += 1
    return bool(place == end)


@compiled(borrowing=True)
def _link_across(
    cloud: Polar,
    parents: np.ndarray,
    cells: tuple[Runs, tuple[int, int, int, int], bool],
    rule: Rule,
) -> None:
    """Join the linked points of two cells; where both hang together one link is enough."""
    runs, (first, end, start, stop), both = cells
    for run in range(first, end):
        for other in range(start, stop):
            if _link_runs(cloud, parents, (runs, run, other), rule) and both:
                return


@compiled(borrowing=True)
def _link_runs(cloud: Polar, parents: np.ndarray, pair: tuple[Runs, int, int], rule: Rule) -> bool:
    """Join the linked points of two runs or of one; return whether there were any to join.

    Where both runs hang together, one link is enough.
    """
    runs, one, two = pair
    limit = min(runs.limits[one], runs.limits[two])
    if runs.lows[two] > runs.highs[one] + limit or runs.lows[one] > runs.highs[two] + limit:
        return False
    both = runs.wholes[one] != SEVERAL and runs.wholes[two] != SEVERAL
    if both and _same(parents, runs.wholes[one], runs.wholes[two]):
        return False
    joined = False
    for place in range(runs.starts[one], runs.starts[one + 1]):
        row = runs.order[place]
        for beside in range(runs.starts[two], runs.starts[two + 1]):
            other = runs.order[beside]
            if not both and _same(parents, row, other):
                continue
            if _are_linked(cloud, row, other, rule):
                join(parents, row, other)
                joined = True
                if both:
                    return True
    return joined


@compiled(borrowing=True)
def _are_linked(cloud: Polar, row: int, other: int, rule: Rule) -> bool:
    limit = rule.eps_m + rule.reach * min(cloud.ranges[row], cloud.ranges[other])
    square = 0.0
    for axis in range(3):
        square += (cloud.points[row, axis] - cloud.points[other, axis]) ** 2
    if square > limit * limit:
        return False
    # Within the angle, as the cosine of what is between them tells; on the axis there is none.
    along = 0.0
    for axis in range(2):
        middle = cloud.origin[axis]
        along += (cloud.points[row, axis] - middle) * (cloud.points[other, axis] - middle)
    both = cloud.ranges[row] * cloud.ranges[other]
    return bool(both > 0.0 and along >= rule.cosine * both)


# --------------------------------------------------------------------------------------------------
# Clustering by growth within a constrained scan angle (Zhang 2022, section 2.1).

SPACINGS = 2.0
"""Neighbours on a face across the beam are one spacing apart; one lost return is bridged."""
UPRIGHT = 0.05
"""Two returns of a column whose ranges differ by less than this share lie on an upright face."""


def cluster_range_angle(
    cloud: Cloud, *, eps_m: float = 0.02, angle_deg: float = 5.0, min_points: int = 30
) -> np.ndarray:
    """Grow clusters within a scan angle (Zhang 2022).

    Returns (N,) int64 labels, negative where a cluster has fewer than `min_points`.

    LiDAR returns nearer than or at epsilon in space (eq. 1), and within `angle_deg` of one
    another as the sensor turns, are linked.

    Readings taken. The printed epsilon of 0.02 m is less than the gap between two beams of the
    paper's VLP-16 from 0.6 m on and between two columns from 6 m on; here it is what noise adds
    to two spacings of the returns at the lesser of the two ranges, where the spacing is the
    wider of those between beams and between columns. The paper grows from a seed and then from
    the farthest returns in six directions until no return satisfies eq. 1 any more; that ends
    with the linked components, whichever seeds are taken first. The angle bounds links: a cluster
    goes on as long as returns follow one another. Zhang 2022's odometry cuts it by the angle.
    """
    for name, value in (("eps_m", eps_m), ("angle_deg", angle_deg), ("min_points", min_points)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive, got {value!r}")
    if not len(cloud):
        return np.empty(0, np.int64)
    reach = SPACINGS * spacing(cloud)
    # Beyond this angle even the nearest return is out of reach; a hair more, for rounding.
    nearest = max(float(_least_range(cloud.points, cloud.origin)), eps_m)
    share = eps_m / nearest + reach
    widest = np.pi if share >= 1.0 else 1e-9 + float(np.arcsin(share))
    angle = float(np.radians(angle_deg))
    within = min(angle, widest)
    cosine = float(np.cos(within)) if within < np.pi else -2.0
    rule = Rule(float(eps_m), reach, within, cosine)
    sets = linked_sets(cloud.points, cloud.origin, cloud.ring, rule)
    return _large_ones(sets, min_points)


def spacing(cloud: Cloud) -> float:
    """Return the angle in radians between neighbouring returns, beams or columns, the wider.

    It is measured on the returns: neither the cloud nor the paper's input names the beams.
    """
    return float(_spacing(cloud.points, cloud.ring, cloud.column, cloud.origin))


@compiled()
def _least_range(points: np.ndarray, origin: np.ndarray) -> float:
    """Return the horizontal distance of the nearest of (N, 3) points, metres."""
    least = np.inf
    for row in range(len(points)):
        x, y = points[row, 0] - origin[0], points[row, 1] - origin[1]
        least = min(least, x * x + y * y)
    return float(np.sqrt(least))


@compiled()
def _spacing(points: np.ndarray, ring: np.ndarray, column: np.ndarray, origin: np.ndarray) -> float:
    """Return the greater of two medians: of angles between beams and between columns."""
    rises, steps = np.empty(len(ring)), np.empty(len(ring))
    upright, turns, azimuth, opener = 0, 0, 0.0, -1
    here = 0.0
    for row in range(len(ring)):
        x, y = points[row, 0] - origin[0], points[row, 1] - origin[1]
        last, here = here, np.sqrt(x * x + y * y)
        if row == 0 or column[row] != column[row - 1]:
            before, azimuth = azimuth, np.arctan2(y, x)
            if opener >= 0:
                turn = abs((azimuth - before + np.pi) % (2 * np.pi) - np.pi)
                steps[turns] = turn / max(abs(column[row] - column[opener]), 1)
                turns += 1
            opener = row
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


@compiled()
def _large_ones(sets: np.ndarray, min_points: int) -> np.ndarray:
    """Return labels by first appearance of sets of at least `min_points`, else `OUTLIER`."""
    counts, labels, found = np.zeros(len(sets), np.int64), np.empty(len(sets), np.int64), 0
    for item in sets:
        counts[item] += 1
    for row in range(len(sets)):
        item = sets[row]
        if counts[item] >= min_points:
            # From here on it is the number of the cluster that is kept, below all counts.
            counts[item] = -1 - found
            found += 1
        labels[row] = -1 - counts[item] if counts[item] < 0 else OUTLIER
    return labels
