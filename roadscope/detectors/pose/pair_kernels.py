"""The rotating pair of perpendicular lines: both filters at every angle, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.filter_kernels import (
    gaussian_taps,
    greatest,
    grid_half,
    near_share,
    respond,
    summit,
)


class Views(NamedTuple):
    """One vehicle's returns in F frames.

    points: (N, 2) metres from the mean of their frame, frame after frame; starts: (F + 1,) where
    each begins. weights: (N,), together 1. means: (F, 2) from the reference point. sights: (F, 2)
    from the sensor to the mean. stamps: (F,) seconds from the reference frame's.
    """

    points: np.ndarray
    weights: np.ndarray
    starts: np.ndarray
    means: np.ndarray
    sights: np.ndarray
    stamps: np.ndarray


class Filter(NamedTuple):
    """Settings of the matched filter.

    bin_m: width of a bin. sigma_m: of the Gaussian that smooths the edges. alpha: what a return
    outside the body costs. length, width: of the body. power: of the cosine by which a face
    gives returns, 0 for no faces. tie: responses this near to the greatest are equal to it.
    """

    bin_m: float
    sigma_m: float
    alpha: float
    length: float
    width: float
    power: int
    tie: float


FIXED = 3
"""Columns of a sweep before those of the frames: score, velocity, place across."""
LAG_M = 0.5
"""How far from the frames' own places the velocity may move a frame."""


@compiled()
def sweep(views: Views, angles: np.ndarray, settings: Filter, tied: bool) -> np.ndarray:
    """Return (A, 3 + F): score, velocity, place across, and along for each frame.

    angles: (A,) radians of the long side. Places are those of the body's middle in metres along
    the turned axes from the reference point. tied: frames are moved by one velocity, else each
    by its own shift.
    """
    frames = len(views.stamps)
    along, across = _work(views, settings)
    taps = gaussian_taps(settings.sigma_m / settings.bin_m)
    found = np.zeros((len(angles), FIXED + frames))
    axis, normal = np.empty(2), np.empty(2)
    places = np.empty(len(views.points))
    for a in range(len(angles)):
        axis[0], axis[1] = math.cos(angles[a]), math.sin(angles[a])
        normal[0], normal[1] = -axis[1], axis[0]
        across[-1] = 0.0
        for f in range(frames):
            _respond(views, f, (normal, False), settings, (taps, places, across[:3]))
            across[-1] += across[2]
            _respond(views, f, (axis, True), settings, (taps, places, along[:3]))
            along[3 + f] = along[2]
        score, place = summit(across[-1], settings.tie)
        found[a, 2] = place * settings.bin_m
        ways = views.means @ axis
        if tied and frames > 1:
            found[a, 0] = score + _tied(along[3:], ways, views.stamps, settings, found[a])
        else:
            found[a, 0] = score + _free(along[3:], ways, views.stamps, settings, found[a])
    return found


@compiled()
def _work(views: Views, settings: Filter) -> tuple[np.ndarray, np.ndarray]:
    """Work space along, (3 + F, K), and across, (4, M): three rows for the filter, then sums."""
    near = far = 0.0
    for f in range(len(views.stamps)):
        mx, my = views.means[f]
        for i in range(views.starts[f], views.starts[f + 1]):
            x, y = views.points[i]
            near = max(near, math.hypot(x, y))
            far = max(far, math.hypot(x + mx, y + my))
    bin_m, sigma_m = settings.bin_m, settings.sigma_m
    lengthwise = 2 * grid_half(near, settings.length, bin_m, sigma_m) + 1
    crosswise = 2 * grid_half(far, settings.width, bin_m, sigma_m) + 1
    return np.empty((3 + len(views.stamps), lengthwise)), np.empty((4, crosswise))


@compiled(borrowing=True)
def _respond(
    views: Views,
    f: int,
    turned: tuple[np.ndarray, bool],
    settings: Filter,
    room: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Fill row 2 of the work space with one frame's response along a unit axis.

    turned: the axis, and whether it is lengthwise: then from the frame's own mean, otherwise from
    the reference point of all. room: the taps, (N,) to hold places, and the work space.
    """
    axis, lengthwise = turned
    taps, places, work = room
    first, last = views.starts[f], views.starts[f + 1]
    mean = views.means[f]
    start = 0.0 if lengthwise else mean[0] * axis[0] + mean[1] * axis[1]
    for i in range(first, last):
        places[i] = views.points[i, 0] * axis[0] + views.points[i, 1] * axis[1] + start
    extent, other = settings.length, settings.width
    if not lengthwise:
        extent, other = other, extent
    sight = views.sights[f]
    side = 1.0 if sight[0] * axis[0] + sight[1] * axis[1] >= 0.0 else -1.0
    share = near_share(sight, axis, extent, other, settings.power)
    grid = settings.bin_m, settings.sigma_m, settings.alpha
    weighed = places[first:last], views.weights[first:last]
    respond(weighed, (side, extent, share), grid, taps, work)


@compiled()
def _free(
    along: np.ndarray, ways: np.ndarray, stamps: np.ndarray, settings: Filter, row: np.ndarray
) -> float:
    """Place every frame at its own greatest response; return their sum."""
    score = 0.0
    for f in range(len(stamps)):
        top, place = summit(along[f], settings.tie)
        score += top
        row[FIXED + f] = ways[f] + place * settings.bin_m
    row[1] = _slope(stamps, row[FIXED:])
    return score


@compiled()
def _slope(stamps: np.ndarray, places: np.ndarray) -> float:
    """Velocity of places by least squares, 0 of a single frame."""
    times = stamps - stamps.mean()
    spread = (times * times).sum()
    return (times * places).sum() / spread if spread > 0.0 else 0.0


@compiled()
def _tied(
    along: np.ndarray, ways: np.ndarray, stamps: np.ndarray, settings: Filter, row: np.ndarray
) -> float:
    """Place all frames at the velocity and the place of the greatest common response.

    Velocities are searched around that of the frames' own places, in steps that move the
    outermost frame by one bin. Only bins where every frame responds well enough for the sum to
    come near the one at that velocity are looked at, and all of them beside the best velocity.
    """
    most = _free(along, ways, stamps, settings, row)
    step = settings.bin_m / np.abs(stamps).max()
    count = math.ceil(LAG_M / settings.bin_m)
    tops, common = np.empty(2 * count + 1), np.empty(along.shape[1])
    floors = np.array([along[f].min() for f in range(len(stamps))])
    least = _overlay(along, (stamps * row[1] - ways) / settings.bin_m, floors, common)
    windows = _windows(along, most - least + 2 * settings.tie)
    for k in range(-count, count + 1):
        shifts = (stamps * (row[1] + k * step) - ways) / settings.bin_m
        tops[k + count] = _overlay_within(along, shifts, windows)
    best = int(tops.argmax())
    for k in (max(best - 1, 0), min(best + 1, 2 * count)):
        shifts = (stamps * (row[1] + (k - count) * step) - ways) / settings.bin_m
        tops[k] = _overlay(along, shifts, floors, common)
    velocity = row[1] + summit(tops, settings.tie)[1] * step
    _overlay(along, (stamps * velocity - ways) / settings.bin_m, floors, common)
    score, place = summit(common, settings.tie)
    row[1] = velocity
    for f in range(len(stamps)):
        row[FIXED + f] = place * settings.bin_m + stamps[f] * velocity
    return score


@compiled()
def _overlay(
    along: np.ndarray, shifts: np.ndarray, floors: np.ndarray, common: np.ndarray
) -> float:
    """Sum the frames' responses, each moved back by its shift; return the greatest sum.

    along: (F, K), each from its frame's own mean; between bins they are straight lines. shifts:
    (F,) bins. floors: (F,) responses outside the rows. common: (K,).
    """
    size = len(common)
    common[:] = floors.sum()
    for f in range(len(shifts)):
        whole = math.floor(shifts[f])
        part, floor = shifts[f] - whole, floors[f]
        first, last = max(0, -whole), min(size, size - 1 - whole)
        if last <= first:
            continue
        # Views from zero let the compiler work on several bins at a time.
        sums = common[first:last]
        lower, upper = along[f, first + whole : last + whole], along[f, first + whole + 1 :]
        for i in range(len(sums)):
            sums[i] += (1.0 - part) * lower[i] + part * upper[i] - floor
    return greatest(common)


@compiled()
def _windows(along: np.ndarray, slack: float) -> np.ndarray:
    """Return (F, 2) first and last bin at which each frame's response is near its greatest."""
    windows = np.empty((len(along), 2), np.int64)
    for f in range(len(along)):
        least, first, last = greatest(along[f]) - slack, 0, along.shape[1] - 1
        while along[f, first] < least:
            first += 1
        while along[f, last] < least:
            last -= 1
        windows[f] = first, last
    return windows


@compiled()
def _overlay_within(along: np.ndarray, shifts: np.ndarray, windows: np.ndarray) -> float:
    """Return what `_overlay` does if the greatest sum lies within every frame's window.

    Else a lower one, the least of all where windows do not meet. windows: (F, 2) bins.
    """
    first, last = -along.shape[1], 2 * along.shape[1]
    for f in range(len(shifts)):
        whole = math.floor(shifts[f])
        # Between two bins the response is near its greatest if it is so at either.
        first = max(first, max(windows[f, 0] - 1, 0) - whole)
        last = min(last, min(windows[f, 1], along.shape[1] - 2) - whole)
    top = -np.inf
    for i in range(max(first, 0), min(last, along.shape[1] - 1) + 1):
        total = 0.0
        for f in range(len(shifts)):
            place = i + math.floor(shifts[f])
            part = shifts[f] - math.floor(shifts[f])
            total += (1.0 - part) * along[f, place] + part * along[f, place + 1]
        top = max(top, total)
    return top


@compiled()
def merge(points: np.ndarray, weights: np.ndarray, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return one point for each occupied cell of a square grid, at the mean of those in it.

    points: (N, 2) about zero; weights: (N,), summed.
    """
    reach = np.abs(points).max()
    # Beyond 256 cells to either side clearing the grid would take longer than it saves.
    cell = max(cell_m, reach / 256.0)
    half = math.floor(reach / cell) + 1
    slots = np.full((2 * half, 2 * half), -1, np.int64)
    merged, sums = np.zeros((len(points), 2)), np.zeros(len(points))
    count = 0
    for i in range(len(points)):
        column = math.floor(points[i, 0] / cell) + half
        row = math.floor(points[i, 1] / cell) + half
        slot = slots[column, row]
        if slot < 0:
            slot = slots[column, row] = count
            count += 1
        sums[slot] += weights[i]
        merged[slot, 0] += weights[i] * points[i, 0]
        merged[slot, 1] += weights[i] * points[i, 1]
    for slot in range(count):
        merged[slot] /= sums[slot]
    return merged[:count], sums[:count]
