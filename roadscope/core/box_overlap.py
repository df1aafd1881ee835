"""Overlap of boxes: from above and in space, exact, with the generalised one."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled

CORNERS = 16
"""Room for corners: 8 are left at most when one rectangle is cut by another, a few more when
rounding bends a side."""
X, Y, AHEAD, ASIDE, COS, SIN, LOW, HIGH, REACH = range(9)
"""Columns of a table of boxes: centre, half length and half width, heading, lowest and highest z,
how far corners reach."""
INITIAL = 256
"""Room for pairs at first; it doubles when full."""


@compiled()
def box_overlaps(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return (N, M) intersection over union of (N, 5) and (M, 5) rectangles.

    Each rectangle is cut by the four sides of the other in the other's frame (Sutherland and
    Hodgman 1974), where the sides are x = +-l/2 and y = +-w/2; what is left is measured with
    the shoelace formula.
    """
    shares = np.zeros((len(one), len(other)))
    some, others = _table(one, 4), _table(other, 4)
    room = np.empty((2, CORNERS, 2))
    for i in range(len(one)):
        for j in range(len(other)):
            if _gap(some, others, (i, j)) < 0:
                common = _common_area(some, others, (i, j), room)
                whole = _area_of(some, i) + _area_of(others, j) - common
                shares[i, j] = min(common / whole, 1.0)
    return shares


@compiled()
def box_overlaps_3d(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return (N, M) intersection over union of upright (N, 7) and (M, 7) boxes.

    A box is its centre x, y, z, length, width, height (metres) and yaw (radians).
    """
    shares = np.zeros((len(one), len(other)))
    rows, columns, found = overlapping_pairs(one, other, False, 0.0)
    for k in range(len(rows)):
        shares[rows[k], columns[k]] = found[k]
    return shares


@compiled()
def overlapping_pairs(
    one: np.ndarray, other: np.ndarray, generalised: bool, least: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (P,) rows, columns and overlaps above `least` of upright (N, 7) and (M, 7) boxes.

    By row, then by column. A box is its centre x, y, z, length, width, height (metres) and yaw
    (radians); the overlap is intersection over union, and `least` 0 or more, or the generalised
    one, -1 to 1. What the least upright prism around both leaves empty counts against that one
    (Rezatofighi et al. 2019), so that boxes apart are told from boxes further apart.

    Only pairs near enough along x are looked at: the work grows with those, not with N M.
    """
    rows, columns = np.empty(INITIAL, np.int64), np.empty(INITIAL, np.int64)
    shares = np.empty(INITIAL)
    size = 0
    if len(one) == 0 or len(other) == 0:
        return rows[:0], columns[:0], shares[:0]
    some, others = _table(one, 6), _table(other, 6)
    far = _far(some, others, generalised, least)
    order = np.argsort(others[:, X], kind="mergesort")
    others = others[order]
    xs, ys = others[:, X].copy(), others[:, Y].copy()
    room = np.empty((2, CORNERS, 2))
    for i in range(len(one)):
        first = size
        x, y = some[i, X], some[i, Y]
        for j in range(np.searchsorted(xs, x - far[i]), len(xs)):
            if xs[j] > x + far[i]:
                break
            if abs(ys[j] - y) > far[i]:
                continue
            pair = i, j
            if generalised:
                share = _generalised(some, others, pair, least, room)
            else:
                share = _overlap(some, others, pair, room)
            if share > least:
                if size == len(rows):
                    rows = np.concatenate((rows, rows))
                    columns = np.concatenate((columns, columns))
                    shares = np.concatenate((shares, shares))
                rows[size] = i
                _put_in_order(columns, shares, first, size, (order[j], share))
                size += 1
    return rows[:size], columns[:size], shares[:size]


@compiled()
def pair_overlaps(
    one: np.ndarray,
    other: np.ndarray,
    pairs: tuple[np.ndarray, np.ndarray],
    generalised: bool,
    least: float,
) -> np.ndarray:
    """Return (P,) overlaps of pairs of upright boxes, as `overlapping_pairs` does.

    pairs: (P,) rows and columns. What is seen to be below `least` without being worked out is -1.
    """
    some, others = _table(one, 6), _table(other, 6)
    room = np.empty((2, CORNERS, 2))
    rows, columns = pairs
    shares = np.empty(len(rows))
    for k in range(len(rows)):
        pair = rows[k], columns[k]
        if generalised:
            shares[k] = _generalised(some, others, pair, least, room)
        else:
            shares[k] = _overlap(some, others, pair, room)
    return shares


@compiled(borrowing=True)
def _put_in_order(
    columns: np.ndarray, shares: np.ndarray, first: int, at: int, pair: tuple[int, float]
) -> None:
    """Insert a pair among those of its row, by column."""
    while at > first and columns[at - 1] > pair[0]:
        columns[at], shares[at] = columns[at - 1], shares[at - 1]
        at -= 1
    columns[at], shares[at] = pair


@compiled()
def _table(boxes: np.ndarray, yaw: int) -> np.ndarray:
    """Return (N, 9) what is needed of each box; its heading is in column `yaw`."""
    table = np.zeros((len(boxes), 9))
    length = 3 if yaw == 6 else 2
    for i in range(len(boxes)):
        table[i, X], table[i, Y] = boxes[i, 0], boxes[i, 1]
        table[i, AHEAD], table[i, ASIDE] = boxes[i, length] / 2, boxes[i, length + 1] / 2
        table[i, COS], table[i, SIN] = np.cos(boxes[i, yaw]), np.sin(boxes[i, yaw])
        table[i, REACH] = np.sqrt(boxes[i, length] ** 2 + boxes[i, length + 1] ** 2) / 2
        if yaw == 6:
            table[i, LOW] = boxes[i, 2] - boxes[i, 5] / 2
            table[i, HIGH] = boxes[i, 2] + boxes[i, 5] / 2
    return table


@compiled()
def _far(some: np.ndarray, others: np.ndarray, generalised: bool, least: float) -> np.ndarray:
    """Return (N,) from which distance on no box can overlap by more than `least`."""
    far: np.ndarray = some[:, REACH] + others[:, REACH].max()
    if generalised:
        heights = others[:, HIGH] - others[:, LOW]
        most = (4 * others[:, AHEAD] * others[:, ASIDE] * heights).max()
        narrowest = 2 * np.minimum(others[:, AHEAD], others[:, ASIDE]).min()
        for i in range(len(some)):
            height = some[i, HIGH] - some[i, LOW]
            width = 2 * min(some[i, AHEAD], some[i, ASIDE]) + narrowest
            whole = 2 * (_area_of(some, i) * height + most)
            far[i] = max(far[i], whole / ((1 + least) * height * width))
    return far


@compiled(borrowing=True)
def _area_of(boxes: np.ndarray, i: int) -> float:
    return float(4 * boxes[i, AHEAD] * boxes[i, ASIDE])


@compiled(borrowing=True)
def _gap(some: np.ndarray, others: np.ndarray, pair: tuple[int, int]) -> float:
    """Return how far, squared, centres are beyond what corners reach; below 0 they may touch."""
    i, j = pair
    dx, dy = some[i, X] - others[j, X], some[i, Y] - others[j, Y]
    return float(dx * dx + dy * dy - (some[i, REACH] + others[j, REACH]) ** 2)


@compiled(borrowing=True)
def _overlap(
    some: np.ndarray, others: np.ndarray, pair: tuple[int, int], room: np.ndarray
) -> float:
    """Return intersection over union in space."""
    i, j = pair
    common = min(some[i, HIGH], others[j, HIGH]) - max(some[i, LOW], others[j, LOW])
    if common <= 0 or _gap(some, others, pair) >= 0:
        return 0.0
    common *= _common_area(some, others, pair, room)
    return float(min(common / (_volumes(some, others, pair) - common), 1.0))


@compiled(borrowing=True)
def _volumes(some: np.ndarray, others: np.ndarray, pair: tuple[int, int]) -> float:
    """Return the sum of both volumes."""
    i, j = pair
    one = _area_of(some, i) * (some[i, HIGH] - some[i, LOW])
    return float(one + _area_of(others, j) * (others[j, HIGH] - others[j, LOW]))


@compiled(borrowing=True)
def _generalised(
    some: np.ndarray, others: np.ndarray, pair: tuple[int, int], least: float, room: np.ndarray
) -> float:
    """Return generalised IoU, or -1 where it is seen to be below `least` without working it out."""
    i, j = pair
    both = _volumes(some, others, pair)
    if _gap(some, others, pair) >= 0:
        # The hull holds the four corners that lie farthest off the line of centres, and beyond
        # them the outer half of each box.
        dx, dy = some[i, X] - others[j, X], some[i, Y] - others[j, Y]
        within = _band(some, i, dx, dy) + _band(others, j, dx, dy)
        within += (_area_of(some, i) + _area_of(others, j)) / 2
        taller = max(some[i, HIGH] - some[i, LOW], others[j, HIGH] - others[j, LOW])
        if both < (1 + least) * taller * within:
            return -1.0
        _corners_within(some, others, pair, room)
        share, whole = 0.0, both
    else:
        share = _overlap(some, others, pair, room)
        whole = both / (1 + share)
        _corners_within(some, others, pair, room)
    height = max(some[i, HIGH], others[j, HIGH]) - min(some[i, LOW], others[j, LOW])
    around = max(_hull_area(others[j, AHEAD], others[j, ASIDE], room) * height, whole)
    return float(share - (around - whole) / around)


@compiled(borrowing=True)
def _band(boxes: np.ndarray, i: int, dx: float, dy: float) -> float:
    """Return how far a box reaches to either side of a line, times the line's length."""
    c, s = boxes[i, COS], boxes[i, SIN]
    along = boxes[i, AHEAD] * abs(c * dy - s * dx)
    return float(along + boxes[i, ASIDE] * abs(c * dx + s * dy))


@compiled(borrowing=True)
def _corners_within(
    some: np.ndarray, others: np.ndarray, pair: tuple[int, int], room: np.ndarray
) -> None:
    """Write one box's corners in the other's frame, counter-clockwise, into the first polygon."""
    i, j = pair
    dx, dy = some[i, X] - others[j, X], some[i, Y] - others[j, Y]
    c, s = others[j, COS], others[j, SIN]
    x, y = c * dx + s * dy, c * dy - s * dx
    cos, sin = c * some[i, COS] + s * some[i, SIN], c * some[i, SIN] - s * some[i, COS]
    for k in range(4):
        along = some[i, AHEAD] if k in (0, 3) else -some[i, AHEAD]
        across = some[i, ASIDE] if k in (0, 1) else -some[i, ASIDE]
        room[0, k, 0] = x + cos * along - sin * across
        room[0, k, 1] = y + sin * along + cos * across


@compiled(borrowing=True)
def _common_area(
    some: np.ndarray, others: np.ndarray, pair: tuple[int, int], room: np.ndarray
) -> float:
    """Return the area that two rectangles share."""
    _corners_within(some, others, pair, room)
    n = 4
    for turn in range(4):
        limit = others[pair[1], AHEAD if turn < 2 else ASIDE]
        n = _cut(room, turn % 2, n, turn // 2, limit if turn % 2 == 0 else -limit)
    return _area(room, 0, n)


@compiled(borrowing=True)
def _cut(room: np.ndarray, at: int, n: int, axis: int, limit: float) -> int:
    """Write the part of polygon `at` between 0 and a limit on an axis into the other of the two.

    Returns its number of corners.
    """
    side = 1.0 if limit > 0 else -1.0
    to, kept = 1 - at, 0
    before = n - 1
    for k in range(n):
        room_here = abs(limit) - side * room[at, k, axis]
        room_before = abs(limit) - side * room[at, before, axis]
        if (room_here >= 0) != (room_before >= 0):
            share = room_before / (room_before - room_here)
            for of in range(2):
                start = room[at, before, of]
                room[to, kept, of] = start + share * (room[at, k, of] - start)
            kept += 1
        if room_here >= 0:
            room[to, kept, 0], room[to, kept, 1] = room[at, k, 0], room[at, k, 1]
            kept += 1
        before = k
    return kept


@compiled(borrowing=True)
def _area(room: np.ndarray, at: int, n: int) -> float:
    """Return the area of a polygon of n corners, counter-clockwise (shoelace formula)."""
    twice = 0.0
    before = n - 1
    for k in range(n):
        twice += room[at, before, 0] * room[at, k, 1] - room[at, k, 0] * room[at, before, 1]
        before = k
    return float(max(twice / 2, 0.0))


@compiled(borrowing=True)
def _hull_area(ahead: float, aside: float, room: np.ndarray) -> float:
    """Return the area of the convex hull of two rectangles' corners (Andrew 1979).

    ahead, aside: half sides of the one in whose frame the first polygon has the other's corners.
    """
    for k in range(4):
        room[0, 4 + k, 0] = ahead if k in (0, 3) else -ahead
        room[0, 4 + k, 1] = aside if k in (0, 1) else -aside
    for k in range(1, 8):
        x, y, at = room[0, k, 0], room[0, k, 1], k
        while at > 0 and (room[0, at - 1, 0], room[0, at - 1, 1]) > (x, y):
            room[0, at, 0], room[0, at, 1] = room[0, at - 1, 0], room[0, at - 1, 1]
            at -= 1
        room[0, at, 0], room[0, at, 1] = x, y
    n, lower = 0, 1
    for step in range(15):
        k = step if step < 8 else 14 - step
        while n > lower and _turn(room, n, k) <= 0:
            n -= 1
        room[1, n, 0], room[1, n, 1] = room[0, k, 0], room[0, k, 1]
        n += 1
        if step == 7:
            lower = n
    return _area(room, 1, n - 1)


@compiled(borrowing=True)
def _turn(room: np.ndarray, n: int, k: int) -> float:
    """Return twice the area of the hull's last two corners and corner k, positive to the left."""
    ax, ay, bx, by = room[1, n - 2, 0], room[1, n - 2, 1], room[1, n - 1, 0], room[1, n - 1, 1]
    return float((bx - ax) * (room[0, k, 1] - ay) - (by - ay) * (room[0, k, 0] - ax))
