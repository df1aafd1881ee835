"""How many floats of a raw file belong to a point: decided by what is in it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.beams import azimuths_of
from roadscope.benchmarks.formats.point_fields import (
    FEWEST_COLUMNS,
    FLOAT_BYTES,
    MOST_COLUMNS,
    read_floats,
    readable,
)
from roadscope.benchmarks.formats.table import FormatError

USUAL_WIDTH = 4
"""KITTI's: x y z intensity."""
WIDEST = 16
"""Points of up to so many floats are recognised, so that they are not taken for narrower ones; a
layout is needed to read those with more than `MOST_COLUMNS`."""
CLEARLY = 0.9
"""Of two possible widths the right one has points that differ by less than this share of the other
width's. Chosen by hand: 0.2 to 0.7 on scans of all rigs, read with four columns or five."""
LARGEST = 1e8
"""No coordinate is larger, in metres or millimetres; none but 0 is smaller than one over it."""
MOST_ODD = 0.05
"""Largest share of such numbers among the coordinates of a file."""
ALIKE = 0.1
"""Two columns hold the same kind of number if their distributions differ by less than this
(Kolmogorov-Smirnov), and by what chance explains. Chosen by hand: others differ by 0.3 or more."""
CHANCE = 2.0
"""The chance difference of two samples of n numbers, times the root of n; rarely exceeded."""
SOME_POINTS = 5000
"""Distributions are those of so many points, drawn at random but for all runs the same."""
SAME_DIRECTION_RAD = 0.1
"""Half of the neighbouring points of a file in the order of firing are nearer. Chosen by hand."""


def width_of(samples: Sequence[Path]) -> int:
    """Return how many floats a point has; ambiguous and unknown widths are refused."""
    arrays = [each for each in readable(read_floats, samples) if len(each)]
    if not arrays:
        return USUAL_WIDTH
    fitting = [w for w in range(FEWEST_COLUMNS, WIDEST + 1) if _fits(arrays, w)]
    # Three floats have no column that could tell against them.
    wider = [w for w in fitting if w > FEWEST_COLUMNS] or fitting
    # Half of a point may look like one, but two points are known to repeat.
    wider = [w for w in wider if not any(v > w and v % w == 0 for v in wider)]
    possible = [w for w in wider if _divides(arrays, w) and w <= MOST_COLUMNS]
    differences = {w: _difference(arrays, w) for w in wider}
    best = min(possible, key=differences.__getitem__, default=0)
    if not best or min(differences.values()) < CLEARLY * differences[best]:
        raise FormatError(_unknown(samples[0], arrays[0]))
    close = sorted(w for w in possible if CLEARLY * differences[w] < differences[best])
    if len(close) > 1:
        raise FormatError(
            f"{samples[0]}: its points may have {' or '.join(map(str, close))} floats: name the "
            "columns, such as --layout x,y,z,intensity"
        )
    return best


def _unknown(path: Path, numbers: np.ndarray) -> str:
    """Return that no points are recognised in the numbers of a file."""
    doubles = numbers[: len(numbers) // 2 * 2].view("<f8")
    what, remedy = "", "name the columns, such as --layout x,y,z,intensity,ring"
    if not _are_odd(doubles) and _are_odd(numbers):
        # A layout names columns of float32 too: it would make points of halves of these numbers.
        what, remedy = ", which look like float64", "save them as float32, or as .npy"
    return (
        f"{path}: expected float32 x y z intensity, {FLOAT_BYTES * USUAL_WIDTH} bytes a point, or "
        f"points of {FLOAT_BYTES * FEWEST_COLUMNS} to {FLOAT_BYTES * MOST_COLUMNS} bytes, got "
        f"{FLOAT_BYTES * len(numbers)} bytes{what}, in which no such points are recognised: "
        f"{remedy}"
    )


def _divides(arrays: Sequence[np.ndarray], width: int) -> bool:
    """Return whether most files have whole points of so many floats."""
    return 2 * sum(len(each) % width == 0 for each in arrays) > len(arrays)


def _fits(arrays: Sequence[np.ndarray], width: int) -> bool:
    """Return whether most files look like points of so many floats."""
    rows = [a[: len(a) // width * width].reshape(-1, width) for a in arrays if len(a) >= width]
    return 2 * sum(_looks_like_points(each) for each in rows) > len(rows)


def _looks_like_points(rows: np.ndarray) -> bool:
    """Return whether (N, W) rows may be x y z and then other numbers, one point a row."""
    width = rows.shape[1]
    if _are_odd(rows[:, :3]):
        return False
    # Coordinates are on both sides of 0, most other numbers are not below it.
    rows = rows[rows[:, :3].any(axis=1)]
    signed = width > FEWEST_COLUMNS and bool((rows[:, 3] < 0).any())
    if len(rows) > SOME_POINTS:
        rows = rows[np.random.default_rng(0).integers(len(rows), size=SOME_POINTS)]
    if signed and _are_alike(rows[:, 0], rows[:, 3]):
        return False
    parts = (w for w in range(FEWEST_COLUMNS, width) if width % w == 0)
    return not any(_repeats(rows, part) for part in parts)


def _are_odd(numbers: np.ndarray) -> bool:
    """Return whether many of some numbers are no coordinates.

    Bytes that are no floats mostly become very small or very large ones.
    """
    with np.errstate(invalid="ignore"):
        sizes = np.abs(numbers)
        odd = (sizes > LARGEST) | ((sizes > 0) & (sizes < 1 / LARGEST))
    return bool(odd.mean() > MOST_ODD)


def _repeats(rows: np.ndarray, width: int) -> bool:
    """Return whether rows hold several points of so many floats: a place, and then another.

    Neighbours are in the same direction, or their places have the same distribution.
    """
    first, second = rows[:, :3], rows[:, width : width + 3]
    known = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    known &= first.any(axis=1) & second.any(axis=1)
    if not known.any():
        return True
    turns = azimuths_of(first[known]) - azimuths_of(second[known])
    if np.median(np.abs(np.angle(np.exp(1j * turns)))) < SAME_DIRECTION_RAD:
        return True
    pairs = zip(first[known].T[:2], second[known].T[:2], strict=True)
    return all(_are_alike(one, other) for one, other in pairs)


def _are_alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Return whether two columns have the same distribution, by their largest difference."""
    one, other = np.sort(one[np.isfinite(one)]), np.sort(other[np.isfinite(other)])
    if not len(one) or not len(other):
        return False
    both = np.concatenate([one, other])
    shares = [np.searchsorted(each, both, "right") / len(each) for each in (one, other)]
    chance = CHANCE / np.sqrt(min(len(one), len(other)))
    return bool(np.abs(shares[0] - shares[1]).max() < ALIKE + chance)


def _difference(arrays: Sequence[np.ndarray], width: int) -> float:
    """Return how much numbers differ that are so many places apart.

    It is least if these are the same column of neighbouring points; infinite for single points.
    """
    with np.errstate(invalid="ignore"):
        steps = [np.abs(a[width:] - a[:-width]) for a in arrays if len(a) > width]
        means = [np.nanmean(each) for each in steps if not np.isnan(each).all()]
    return float(np.median(means)) if means else np.inf
