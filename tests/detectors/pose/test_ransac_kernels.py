"""The compiled fit against the obvious one."""

import numpy as np
import pytest

from roadscope.detectors.pose import fit_ransac, pointing_away

CORNER_POINTS = 2
LENGTH_M, WIDTH_M = 4.5, 1.8


@pytest.mark.parametrize("long_side", ["size", "main"])
@pytest.mark.parametrize("count", [2, 5, 20, 60])
def test_the_compiled_fit_is_the_obvious_one(count, long_side):
    rng = np.random.default_rng(count)
    for turn in rng.uniform(-np.pi, np.pi, 20):
        rear = np.column_stack([np.full(count, -LENGTH_M / 2), rng.uniform(-0.9, 0.9, count)])
        flank = np.column_stack([rng.uniform(-2.2, 2.2, count), np.full(count, -WIDTH_M / 2)])
        points = rng.permutation(np.concatenate([rear, flank]))[:count]
        points += 0.02 * rng.standard_normal(points.shape)
        cos, sin = np.cos(turn), np.sin(turn)
        points = points @ np.array([[cos, sin], [-sin, cos]]) + rng.uniform(-40, 40, 2)
        fitted = fit_ransac(
            points,
            np.zeros(2),
            np.random.default_rng(0),
            length_m=LENGTH_M,
            width_m=WIDTH_M,
            long_side=long_side,
        )
        x, y, yaw, share = obvious(points, np.zeros(2), np.random.default_rng(0), long_side)
        assert (fitted.x, fitted.y, fitted.score) == pytest.approx((x, y, share), abs=1e-9)
        assert abs((fitted.yaw - yaw + np.pi) % (2 * np.pi) - np.pi) < 1e-9


def obvious(points, place, rng, long_side):
    """Return x, y, yaw and the share of the returns on the two faces."""
    length_m, width_m, inlier_m, trials = LENGTH_M, WIDTH_M, 0.06, 100
    points = _by_range(points, place)
    mean = points.mean(axis=0)
    axis, held = _best_line(points, place, rng, (inlier_m, trials))
    axis, corner, second = _with_corner(points, axis, held, place, inlier_m)
    normal = np.array([-axis[1], axis[0]])
    depth = float(np.median((points[held] - mean) @ normal))
    along = (points[held] - mean) @ axis
    visible_m = float(np.ptp(along))
    is_flank = long_side == "main" or abs(visible_m - length_m) < abs(visible_m - width_m)
    extent, other = (length_m, width_m) if is_flank else (width_m, length_m)
    if corner is None:
        middle = (along.min() + along.max()) / 2
    else:
        middle = corner + np.copysign(extent / 2, np.median(along) - corner)
    behind = np.copysign(other / 2, (mean - place) @ normal)
    x, y = mean + middle * axis + (depth + behind) * normal
    heading = axis if is_flank else normal
    yaw = pointing_away(float(np.arctan2(heading[1], heading[0])), mean - place)
    share = float(np.mean(held | second))
    return x, y, yaw, share


def _by_range(points, place):
    """Sort by range, then side: the same pairs are drawn however the points were given."""
    sights = points - place
    middle = sights.mean(axis=0)
    sides = middle[0] * sights[:, 1] - middle[1] * sights[:, 0]
    # Rounded to micrometres, so that a turned scene sorts alike.
    keys = np.round(np.stack([sides, np.hypot(*sights.T)]), 6)
    return np.asarray(points[np.lexsort(keys)])


def _best_line(points, place, rng, settings):
    """Return the (2,) direction of the line with most points and the (N,) mask of those."""
    inlier_m, trials = settings
    first, second = rng.integers(0, len(points), (2, trials))
    ways = points[second] - points[first]
    lengths = np.hypot(*ways.T)
    drawn = lengths > 1e-9
    if not drawn.any():
        # One place has no line: a face square to the line of sight.
        sight = points.mean(axis=0) - place
        across = np.array([-sight[1], sight[0]]) / (np.hypot(*sight) or 1.0)
        axis = across if across.any() else np.array([1.0, 0.0])
        return axis, np.ones(len(points), bool)
    starts, ways = points[first[drawn]], ways[drawn] / lengths[drawn, None]
    crossed = np.multiply.outer(points[:, 1], ways[:, 0]) - np.multiply.outer(
        points[:, 0], ways[:, 1]
    )
    offsets = crossed - (starts[:, 1] * ways[:, 0] - starts[:, 0] * ways[:, 1])
    near = np.abs(offsets) <= inlier_m
    best = int(near.sum(axis=0).argmax())
    held = near[:, best]
    return _direction(_scatter(points[held])), held


def _with_corner(points, axis, held, place, inlier_m):
    """Find a second face behind an end of the first.

    Returns the direction fitted to both, where the corner lies along it from the points' mean
    (None without one), and the (N,) mask of the second face.
    """
    normal = np.array([-axis[1], axis[0]])
    mean = points.mean(axis=0)
    depths = (points - points[held].mean(axis=0)) @ normal
    along = (points - mean) @ axis
    low, high = along[held].min() + inlier_m, along[held].max() - inlier_m
    # What is seen between the ends lies over the face: a rear window over a boot.
    behind = ~held & (depths * ((mean - place) @ normal) > 0) & ((along < low) | (along > high))
    if behind.sum() < CORNER_POINTS:
        return axis, None, np.zeros(len(points), bool)
    places = along[behind]
    ordered = np.sort(places)
    last = np.searchsorted(ordered, places + inlier_m, "right")
    agreed = last - np.searchsorted(ordered, places - inlier_m, "left")
    chosen = places[agreed.argmax()]
    second: np.ndarray = behind & (np.abs(along - chosen) <= inlier_m)
    if second.sum() < CORNER_POINTS:
        return axis, None, np.zeros(len(points), bool)
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    both = _scatter(points[held]) + quarter @ _scatter(points[second]) @ quarter.T
    turned = _direction(both)
    turned = turned if turned @ axis >= 0 else -turned
    return turned, float(np.median((points[second] - mean) @ turned)), second


def _scatter(points):
    centred = points - points.mean(axis=0)
    return np.asarray(centred.T @ centred)


def _direction(scatter):
    """Return the unit vector of the greatest spread."""
    return np.asarray(np.linalg.eigh(scatter)[1][:, 1])
