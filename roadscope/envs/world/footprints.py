"""Convex outlines seen from above."""

from __future__ import annotations

import numpy as np

from roadscope.envs.world.prisms import MAX_EDGES


def rectangle(length_m: float, width_m: float, centre_x_m: float = 0.0) -> np.ndarray:
    """(4, 2) corners of a rectangle along x, counter-clockwise."""
    half = np.array([length_m, width_m]) / 2
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half + (centre_x_m, 0.0)


def rounded(
    length_m: float, width_m: float, radius_m: float, centre_x_m: float = 0.0
) -> np.ndarray:
    """(12, 2) corners of a rectangle along x whose corners are arcs of three points.

    Its extents are exactly length and width; the radius is cut to half the shorter side.
    """
    radius = min(radius_m, 0.499 * length_m, 0.499 * width_m)
    arc = radius * np.array([[0.0, -1.0], [np.sqrt(0.5), -np.sqrt(0.5)], [1.0, 0.0]])
    x, y = length_m / 2 - radius, width_m / 2 - radius
    turned = arc[:, ::-1] * (-1, 1)
    quarters = np.stack([arc, turned, -arc, -turned])
    middles = np.array([[x, -y], [x, y], [-x, y], [-x, -y]])
    middles += np.array([centre_x_m, 0.0])
    corners: np.ndarray = (quarters + middles[:, None]).reshape(12, 2)
    return corners


def ellipse(length_m: float, width_m: float, corners: int = 8) -> np.ndarray:
    """(corners, 2) polygon inscribed in an ellipse, touching its four extreme points.

    corners: a multiple of four up to 12.
    """
    angles = 2 * np.pi * np.arange(corners) / corners
    return np.stack([length_m / 2 * np.cos(angles), width_m / 2 * np.sin(angles)], axis=1)


def placed(template: np.ndarray, centres: np.ndarray, yaws: np.ndarray) -> np.ndarray:
    """Turn and shift (K, 2) or (m, K, 2) outlines to (m, 2) centres and (m,) yaws: (m, K, 2)."""
    cos, sin = np.cos(yaws), np.sin(yaws)
    turn = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], 1)
    result: np.ndarray = template @ turn + centres[:, None, :]
    return result


def padded(outlines: np.ndarray) -> np.ndarray:
    """Repeat the last corner of (m, K, 2) outlines up to 12 corners."""
    missing = MAX_EDGES - outlines.shape[1]
    return np.concatenate([outlines, np.repeat(outlines[:, -1:], missing, axis=1)], axis=1)
