"""Moving vehicles from a scan (Zhang 2017, section 1): temporal cue, geometric cue, box model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import numpy as np

from roadscope.core.jit import compiled
from roadscope.core.record import Record
from roadscope.detectors.moving.box_search import SCORE, YAW, BoxRule, BoxSides, boxes_in, fill_rows
from roadscope.detectors.moving.view import (
    EarlierView,
    View,
    carried,
    count_free_and_occupied,
    height_spans,
    is_seen_through,
    thinned,
)
from roadscope.detectors.shape.bodies import LONGEST_M, WIDEST_M

# --------------------------------------------------------------------------------------------------
# Candidates: evidence of motion and the boxes that hold it.

LOW_M, HIGH_M = 0.3, 2.8
"""Heights above the road of the returns in which motion is searched: above the ground, below
bridges and most of a tree's crown. Chosen by hand."""
SILL_M = 0.15
"""Least height of the other returns of a candidate: far away a single beam hits its lower half.
Chosen by hand."""
REACH_M = 120.0
"""Returns farther away along x or y, ego frame, are not used. Chosen by hand."""
SIDES = BoxSides(2.7, 1.3, 0.75, 0.75)
"""Such a box holds a car whose centre is off by half a stride of the search, and whose heading is
off by half a step."""
CELL_M, SLAB_M = 0.25, 0.3
"""Sides of voxels, in x and y and in height. One return of each is used, because a flank nearby has
thousands of returns. Chosen by hand."""
RULE = BoxRule(SIDES, CELL_M, limit=3.0, least=3.0)
"""The least evidence is that of three cells with weak evidence, see `motion`. Chosen by hand."""
NEIGHBOUR_M = 0.6
"""Side of the cells of `height_spans`: returns up to two sides apart count as one object. Chosen by
hand."""
MIN_VIEWS = 2
"""Least number of earlier scans."""
MIN_POINTS = 3
"""Least number of returns of a candidate."""
UNCOUNTED_FREE = 1
"""So many scans that show a place free are not counted: a ray may have missed a thin object. Chosen
by hand."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidate(Record):
    """Returns of one moving vehicle.

    points: (N, 3) float64, metres, ego frame at the scan's stamp, sorted. They are corrected for
        the sensor's motion during the sweep, but not for the vehicle's.
    rows: (N,) int64, the points' rows in the scan.
    times_s: (N,) float64, seconds after the stamp. time_s: their median.
    origin: (2,) float64, metres, where the sensor was then.
    box: (3,) float64, x, y in metres and yaw in radians of the box that holds it.
    evidence: evidence of motion, summed over the cells of the box.
    """

    points: np.ndarray
    rows: np.ndarray
    times_s: np.ndarray
    time_s: float
    origin: np.ndarray
    box: np.ndarray
    evidence: float


def extract(now: View, earlier: Sequence[EarlierView]) -> list[Candidate]:
    """Return the moving vehicles of a scan; none with fewer than `MIN_VIEWS` earlier scans."""
    rows = np.flatnonzero(_at_vehicle_height(now))
    points = now.points[rows]
    if len(earlier) < MIN_VIEWS or not (points[:, 2] > LOW_M).any():
        return []
    thin_rows, voxel = thinned(points, CELL_M, SLAB_M)
    thin = points[thin_rows]
    upright = thin[thin[:, 2] > LOW_M]
    weights = motion(upright, earlier)
    through = is_seen_through(upright, now.range_image)
    weights[through] = np.minimum(weights[through], 0.0)
    if not (weights > 0).any():
        return []
    origin = now.origin()
    boxes = boxes_in(upright, weights, origin, RULE)
    body, first_box = bodies(thin, boxes, origin, SIDES)
    return _candidates(now, rows, body[voxel], boxes[first_box])


def _at_vehicle_height(view: View) -> np.ndarray:
    """Geometric cue: return (N,) whether a return is at a vehicle's height and within reach."""
    x, y, z = view.points.T
    near = (np.abs(x) < REACH_M) & (np.abs(y) < REACH_M)
    return np.asarray((z > SILL_M) & (z < HIGH_M) & near)


def motion(points: np.ndarray, earlier: Sequence[EarlierView]) -> np.ndarray:
    """Return (N,) evidence that each of the places (N, 3), ego frame now, holds something moving.

    Temporal cue: where an earlier scan has a return, too, the return is background. Where its rays
    passed through the place, the object must have moved there since. A scan without a ray to the
    place counts for neither. A place where no scan has a return is weak evidence of motion, 1.
    Values lie between -4.5 and 6; the factors are chosen by hand.
    """
    counts, heights = np.zeros((2, len(points)), np.int64), height_spans(points, NEIGHBOUR_M)
    for then in earlier:
        places = carried(points, then.then_from_now)
        count_free_and_occupied(places, heights, then.view.range_image, counts)
    free, occupied = np.maximum(counts - [[UNCOUNTED_FREE], [0]], 0) / len(earlier)
    return np.where(
        free > 0, 1.0 + 5.0 * free - 4.5 * occupied, np.where(occupied > 0, -4.5 * occupied, 1)
    )


def _candidates(
    now: View, rows: np.ndarray, body: np.ndarray, boxes: np.ndarray
) -> list[Candidate]:
    """Return the vehicles of boxes (B, 8) that have at least `MIN_POINTS` returns.

    rows: (K,) of returns. body: (K,) for each the box of its vehicle, -1 for none.
    """
    rows, starts = sorted_by_body(now.points, rows, body, len(boxes))
    parts = [(b, rows[i:j]) for b, (i, j) in enumerate(pairwise(starts.tolist()))]
    return [_candidate(now, part, boxes[b]) for b, part in parts if len(part) >= MIN_POINTS]


def sorted_by_body(
    points: np.ndarray, rows: np.ndarray, body: np.ndarray, bodies: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of returns by body, then by z, y and x, and where each body begins, (B + 1,).

    points: (N, 3) metres, of all returns. rows: (K,) int64, those that were used. body: (K,)
    int64, the body of each, below `bodies`; returns with -1 are left out.
    """
    rows, body = rows[body >= 0], body[body >= 0]
    x, y, z = points[rows].T
    order = np.lexsort((x, y, z, body))
    return rows[order], np.searchsorted(body[order], np.arange(bodies + 1))


def _candidate(now: View, rows: np.ndarray, box: np.ndarray) -> Candidate:
    times_s = now.times_s[rows]
    time_s = median(times_s.tolist())
    return Candidate(
        now.points[rows],
        rows,
        times_s,
        time_s,
        now.origin(time_s),
        box[: YAW + 1],
        float(box[SCORE]),
    )


# --------------------------------------------------------------------------------------------------
# From the part of a body in a box to all of its returns: compiled.

LINK_M = 1.0
"""Gaps between parts of one body are at most this long; cars in a queue keep longer gaps. Chosen by
hand."""
CAR_M = (5.6, 2.7)
"""Greatest length and width of a car, with noise on either side. Chosen by hand."""
TALL_M = 1.75
"""A body longer or wider than a car is at least this high. Chosen by hand."""


@compiled()
def bodies(
    points: np.ndarray, boxes: np.ndarray, origin: np.ndarray, sides: BoxSides
) -> tuple[np.ndarray, np.ndarray]:
    """Return which body each point belongs to, (N,), -1 for none, and each body's box, (K,).

    points: (N, 3) metres. boxes: (B, 8), best first. origin: (2,) metres, the sensor. A box
    whose returns mostly belong to an earlier body is left out.
    """
    body, first_box, count = np.full(len(points), -1), np.empty(len(boxes), np.int64), 0
    rows = np.empty(len(points), np.int64)
    for b in range(len(boxes)):
        part = rows[: fill_rows(rows, points, boxes[b], origin, sides)]
        free = part[body[part] < 0]
        if 2 * len(free) <= len(part):
            continue
        for row in whole_body(points, free):
            if body[row] < 0:
                body[row] = count
        first_box[count] = b
        count += 1
    return body, first_box[:count]


@compiled()
def whole_body(points: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return the rows of the body to which a part belongs.

    A box may hold only a part: the rear half of a slow vehicle is where its front was a second ago,
    and a lorry fills several boxes. If the connected returns are too large for a vehicle, the
    result is the part alone. points: (N, 3) metres, z from the ground. part: (K,) int64 rows.
    """
    rows = linked(points, part, LINK_M, LONGEST_M)
    grown = points[rows]
    # Lengths along and across the longest extent.
    x, y = grown[:, 0] - grown[:, 0].mean(), grown[:, 1] - grown[:, 1].mean()
    axis = 0.5 * np.arctan2(2.0 * (x * y).sum(), (x * x).sum() - (y * y).sum())
    along, across = np.cos(axis) * x + np.sin(axis) * y, np.cos(axis) * y - np.sin(axis) * x
    length, width = along.max() - along.min(), across.max() - across.min()
    tall = grown[:, 2].max() >= TALL_M
    longest, widest = (LONGEST_M, WIDEST_M) if tall else CAR_M
    return rows if length <= longest and width <= widest else part


@compiled()
def linked(points: np.ndarray, part: np.ndarray, link_m: float, reach_m: float) -> np.ndarray:
    """Return the rows (M,) int64, in rising order, that are connected with a part.

    points: (N, 3) metres, any frame. part: (K,) int64 rows, K at least 1. Seen from above, each
    connected row is within `link_m` of another one. Rows outside the part are less than `reach_m`
    from its first row in x and in y.
    """
    x, y = points[part[0], 0], points[part[0], 1]
    near = np.empty(len(points), np.int64)
    count = 0
    for row in range(len(points)):
        if abs(points[row, 0] - x) < reach_m and abs(points[row, 1] - y) < reach_m:
            near[count] = row
            count += 1
    near = near[:count]
    inside, queue = np.zeros(len(points), np.bool_), np.empty(len(points), np.int64)
    done, size = 0, len(part)
    queue[:size] = part
    for row in part:
        inside[row] = True
    while done < size:
        row = queue[done]
        done += 1
        for other in near:
            dx, dy = points[other, 0] - points[row, 0], points[other, 1] - points[row, 1]
            if not inside[other] and dx * dx + dy * dy <= link_m * link_m:
                inside[other] = True
                queue[size] = other
                size += 1
    return np.flatnonzero(inside)
