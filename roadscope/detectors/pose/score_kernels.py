"""Scores of the rotating pair at several angles at a time, one a lane of the processor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.filter_kernels import gaussian_taps, near_share, template_weights
from roadscope.detectors.pose.pair_kernels import Filter, Views, sweep

LANES = 8
"""Angles at a time. In all arrays of bins each bin has one entry a lane, side by side."""
ROWS = 16
"""Bins at a time: long runs without a branch let the compiler work on several entries at once."""


class Room(NamedTuple):
    """Work space for the responses along one axis of `LANES` angles.

    points: (2, N) metres. places: (L, N) of the points, bins. counts, smooth, below, sums:
    (B * L,), points by bin, smoothed, those below each bin's middle, and responses. axes: (2, L)
    unit vectors. sides: (L,), 1 where the sensor looks along the axis, -1 where against it.
    lows: (L,) each lane's first bin. rules: (2, ROWS * L) what a return in the bin of the near
    edge and one on the plateau give, over and over. tops: (L,) greatest responses. taps: of the
    Gaussian.
    """

    points: np.ndarray
    places: np.ndarray
    counts: np.ndarray
    smooth: np.ndarray
    below: np.ndarray
    sums: np.ndarray
    axes: np.ndarray
    sides: np.ndarray
    lows: np.ndarray
    rules: np.ndarray
    tops: np.ndarray
    taps: np.ndarray


@compiled()
def free_scores(views: Views, angles: np.ndarray, settings: Filter) -> np.ndarray:
    """Return (A,) scores of angles: those of `pair_kernels.sweep` of frames that are not tied.

    angles: (A,) radians of the long side. Sums are added up in another order.
    """
    scores, frames = np.zeros(len(angles)), len(views.stamps)
    room = _room(views, settings)
    for first in range(0, len(angles), LANES):
        found = scores[first : first + LANES]
        _turn(angles, first, 0.5 * np.pi, room.axes)
        _respond(views, (0, frames, settings.width, settings.length), settings, room)
        found += room.tops[: len(found)]
        _turn(angles, first, 0.0, room.axes)
        for f in range(frames):
            _respond(views, (f, f + 1, settings.length, settings.width), settings, room)
            found += room.tops[: len(found)]
    for a in range(len(angles)):
        if math.isnan(scores[a]):
            scores[a] = sweep(views, angles[a : a + 1], settings, False)[0, 0]
    return scores


@compiled()
def _room(views: Views, settings: Filter) -> Room:
    far = 0.0
    for f in range(len(views.stamps)):
        mx, my = views.means[f]
        for i in range(views.starts[f], views.starts[f + 1]):
            x, y = views.points[i]
            far = max(far, math.hypot(x, y), math.hypot(x + mx, y + my))
    taps = gaussian_taps(settings.sigma_m / settings.bin_m)
    bins = math.ceil(2.0 * far / settings.bin_m) + 4 + len(taps)
    size, longer = bins * LANES, bins + math.ceil(settings.length / settings.bin_m) + 2
    return Room(
        views.points.T.copy(), np.empty((LANES, len(views.points))),
        np.empty(size + len(taps) * LANES), np.empty(size), np.empty(longer * LANES),
        np.empty(size), np.empty((2, LANES)), np.empty(LANES), np.empty(LANES),
        np.empty((2, ROWS * LANES)), np.empty(LANES), taps,
    )  # fmt: skip


@compiled(borrowing=True)
def _turn(angles: np.ndarray, first: int, more: float, axes: np.ndarray) -> None:
    """Fill in the axes of angles from the first on, the last again in lanes that are left."""
    for lane in range(LANES):
        angle = angles[min(first + lane, len(angles) - 1)] + more
        axes[0, lane], axes[1, lane] = math.cos(angle), math.sin(angle)


@compiled(borrowing=True)
def _respond(
    views: Views, shown: tuple[int, int, float, float], settings: Filter, room: Room
) -> None:
    """Fill in each lane's greatest sum, at one place, of the responses of some frames.

    shown: the first frame and the one after the last; sides of the body along the axis and across
    it. A lane whose frames look at opposite ends of the body gets nan: their bins are in opposite
    order.
    """
    first, end, extent, other = shown
    bins = _place(views, (first, end), (extent, settings.bin_m), room)
    sums, tops = room.sums[: bins * LANES], room.tops
    sums[:] = 0.0
    for f in range(first, end):
        total = _count(views, f, bins, room)
        _smooth(bins, room)
        _weigh(views.sights[f], (extent, other), settings, room)
        _add(bins, extent / settings.bin_m, (total, settings.alpha), room)
    tops[:] = -np.inf
    for i in range(bins):
        for lane in range(LANES):
            value = sums[i * LANES + lane]
            tops[lane] = value if value > tops[lane] else tops[lane]
    for f in range(first + 1, end):
        for lane in range(LANES):
            if _side(views.sights[f], room.axes, lane) != room.sides[lane]:
                tops[lane] = np.nan


@compiled(borrowing=True)
def _side(sight: np.ndarray, axes: np.ndarray, lane: int) -> float:
    """1 where the sensor looks along a lane's axis, -1 where against it."""
    return 1.0 if sight[0] * axes[0, lane] + sight[1] * axes[1, lane] >= 0.0 else -1.0


@compiled(borrowing=True)
def _place(views: Views, frames: tuple[int, int], sizes: tuple[float, float], room: Room) -> int:
    """Fill in sides, lows and places, and return how many bins the smoothed points reach.

    sizes: extent and width of a bin, metres. Places are turned so that the near end comes first,
    and moved by half the extent, as in `filter_kernels`.
    """
    axes, lows = room.axes, room.lows
    shift, scale, shared = 0.5 * sizes[0] / sizes[1], 1.0 / sizes[1], frames[1] - frames[0] > 1
    most, start, end = 0, views.starts[frames[0]], views.starts[frames[1]]
    for lane in range(LANES):
        room.sides[lane] = _side(views.sights[frames[0]], axes, lane)
        ax, ay = scale * room.sides[lane] * axes[0, lane], scale * room.sides[lane] * axes[1, lane]
        for f in range(frames[0], frames[1]):
            # A frame alone is placed from its own mean, several from the reference point.
            off = (views.means[f, 0] * ax + views.means[f, 1] * ay) if shared else 0.0
            x, y = room.points[0, views.starts[f] :], room.points[1, views.starts[f] :]
            places = room.places[lane, views.starts[f] : views.starts[f + 1]]
            for i in range(len(places)):
                places[i] = x[i] * ax + y[i] * ay + (off + shift)
        low, high = _ends(room.places[lane, start:end])
        lows[lane] = math.floor(low) - len(room.taps)
        most = max(most, math.floor(high - lows[lane]))
    return most + 2


@compiled(borrowing=True, fastmath=True)
def _ends(values: np.ndarray) -> tuple[float, float]:
    """Return the least and the greatest of (N,) finite values, N at least 1."""
    low, high = values[0], values[0]
    for i in range(len(values)):
        low = values[i] if values[i] < low else low
        high = values[i] if values[i] > high else high
    return low, high


@compiled(borrowing=True)
def _count(views: Views, f: int, bins: int, room: Room) -> float:
    """Share every point of a frame between its two neighbouring bins; return all weights."""
    counts, places, lows = room.counts, room.places, room.lows
    counts[: (bins + len(room.taps) - 1) * LANES] = 0.0
    total = 0.0
    for i in range(views.starts[f], views.starts[f + 1]):
        weight = views.weights[i]
        total += weight
        for lane in range(LANES):
            exact = places[lane, i] - lows[lane]
            k = int(exact)
            upper = weight * (exact - k)
            counts[k * LANES + lane] += weight - upper
            counts[(k + 1) * LANES + lane] += upper
    return total


@compiled(borrowing=True)
def _smooth(bins: int, room: Room) -> None:
    """Convolve the bins with the taps, and add up what lies below each one's middle.

    Bin 0 is empty: `_place` leaves as much room before the first point as there are taps.
    """
    counts, smooth, below, taps = room.counts, room.smooth[: bins * LANES], room.below, room.taps
    half = len(taps) // 2
    for m in range(len(smooth)):
        smooth[m] = taps[half] * counts[half * LANES + m]
    if half % 2:
        for m in range(len(smooth)):
            smooth[m] += taps[0] * (counts[m] + counts[2 * half * LANES + m])
    for k in range(half % 2, half, 2):
        one, other = taps[k], taps[k + 1]
        a, b = counts[k * LANES :], counts[(k + 1) * LANES :]
        c, d = counts[(2 * half - k - 1) * LANES :], counts[(2 * half - k) * LANES :]
        for m in range(len(smooth)):
            smooth[m] += one * (a[m] + d[m]) + other * (b[m] + c[m])
    below[:LANES] = 0.0
    for m in range(LANES, len(smooth)):
        below[m] = below[m - LANES] + 0.5 * (smooth[m - LANES] + smooth[m])


@compiled(borrowing=True)
def _weigh(sight: np.ndarray, sides: tuple[float, float], settings: Filter, room: Room) -> None:
    """Fill in the rules for a line of sight and sides of the body along and across the axis."""
    axis = room.tops[:2]
    for lane in range(LANES):
        axis[0], axis[1] = room.axes[0, lane], room.axes[1, lane]
        share = near_share(sight, axis, sides[0], sides[1], settings.power)
        edge, plateau = template_weights(share, sides[0], settings.bin_m, settings.sigma_m)
        room.rules[0, lane], room.rules[1, lane] = edge, plateau + settings.alpha
    for rule in room.rules:
        for i in range(LANES, len(rule)):
            rule[i] = rule[i - LANES]


@compiled(borrowing=True)
def _add(bins: int, far: float, rule: tuple[float, float], room: Room) -> None:
    """Add a frame's responses to the sums.

    far: extent of the body in bins. rule: all weights, and what a return outside costs.
    """
    total, alpha = rule
    sums, below, whole = room.sums[: bins * LANES], room.below, math.floor(far)
    part, cost = far - whole, alpha * total
    below[bins * LANES : (bins + whole + 1) * LANES] = total
    edges, plateaus = room.rules[0], room.rules[1]
    for m in range(0, len(sums), ROWS * LANES):
        here, smooth, passed = sums[m : m + ROWS * LANES], room.smooth[m:], below[m:]
        lower, upper = below[m + whole * LANES :], below[m + (whole + 1) * LANES :]
        for i in range(len(here)):
            held = (1.0 - part) * lower[i] + part * upper[i] - passed[i]
            here[i] += edges[i] * smooth[i] + plateaus[i] * held - cost
