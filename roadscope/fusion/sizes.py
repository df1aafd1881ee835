"""Usual sizes of road users, and boxes completed where only a face was measured."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category

USUAL_M = np.array(
    [
        [4.5, 1.8, 1.5],
        [5.5, 2.0, 2.3],
        [9.0, 2.5, 3.4],
        [12.0, 2.55, 3.1],
        [2.2, 0.8, 1.4],
        [1.8, 0.6, 1.75],
        [0.5, 0.6, 1.72],
    ]
)
"""Length, width, height in metres by `Category`. Chosen by hand."""
SPREAD = np.array([0.08, 0.15, 0.12, 0.08, 0.1, 0.06, 0.07])
"""Standard deviation of the logarithm of heights by `Category`; people are 1.5 to 1.95 m. Chosen by
hand."""
REAR_SHARE = 1.3
"""The longer side of a vehicle's box that is less than this many usual widths is its front or rear.
Chosen by hand."""
LEAST_CAR_HEIGHT_M = 1.4
"""Least height of a car's box; other boxes have at least their usual height. Chosen by hand."""


def completed(
    centres: np.ndarray,
    sizes: np.ndarray,
    yaws: np.ndarray,
    origin: np.ndarray,
    categories: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return centres, sizes and yaws of boxes grown to usual sizes, away from the sensor.

    centres, sizes: (N, 3) metres, yaws: (N,) radians, boxes around the returns, ego frame. origin:
    (2,) metres, the sensor. categories: (N,) values of `Category`.

    If the longer side of a vehicle's box is only as long as its front or rear is wide, the box is
    turned by 90 degrees and grows across that side. Boxes stand on the ground z = 0.
    """
    usual = USUAL_M[categories]
    turned = (categories < Category.CYCLIST) & (sizes[:, 0] < REAR_SHARE * usual[:, 1])
    yaws = np.where(turned, yaws + np.pi / 2, yaws)
    measured = np.where(turned[:, None], sizes[:, [1, 0, 2]], sizes)
    grown = np.maximum(measured, usual)
    axes = np.stack([np.cos(yaws), np.sin(yaws)], axis=-1)
    left = np.stack([-axes[:, 1], axes[:, 0]], axis=-1)
    away = centres[:, :2] - origin
    away = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    shift = np.zeros((len(centres), 2))
    for axis, column in ((axes, 0), (left, 1)):
        along = (axis * away).sum(axis=1)
        # Along the line of sight only the near end is visible: the box grows away from it. Across
        # the line of sight both ends are visible: it grows to either side.
        shift += axis * (np.clip(2 * along, -1, 1) * (grown - measured)[:, column] / 2)[:, None]
    car_heights = np.maximum(measured[:, 2], LEAST_CAR_HEIGHT_M)
    heights = np.where(categories == Category.CAR, car_heights, grown[:, 2])
    placed = np.column_stack([centres[:, :2] + shift, heights / 2])
    return placed, np.column_stack([grown[:, :2], heights]), (yaws + np.pi) % (2 * np.pi) - np.pi
