"""From what the rays meet to what the receiver reports."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.envs.raycast.cast import NOTHING
from roadscope.envs.raycast.depth import Surfaces


class Firings(NamedTuple):
    """Where C columns of B beams look: azimuths (C, 2), elevations (B, 2), cosines and sines.

    order: (B,) beams as they fire.
    """

    azimuths: np.ndarray
    elevations: np.ndarray
    order: np.ndarray


class Way(NamedTuple):
    """How a sensor moves between K knots.

    matrices: (K, 4, 4), world_from_lidar. turns: (K, 3, 3), cross-product matrix of the unit axis
    about which it turns after the knot; angles: (K,), by how many radians until the next.
    """

    matrices: np.ndarray
    turns: np.ndarray
    angles: np.ndarray


@compiled()
def collect(
    surfaces: Surfaces,
    noise: np.ndarray,
    chances: np.ndarray,
    firings: Firings,
    limits: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return points, intensity, ring, column and owner of each return, in firing order.

    A surface sends back energy in proportion to reflectivity and cosine over range squared;
    below the limit it is lost. The receiver makes up for the range squared only in the far
    field, so intensity is reflectivity * cosine / (1 + (4 range / range_max)^2).

    noise: (B, C) normal, chances: (B, C) uniform.
    limits: range_min, range_max, noise, resolution in metres, dropout, detection limit.
    """
    ranges, owners, cosines, reflectivity = surfaces
    azimuths, elevations, order = firings
    near, far, sigma, step, dropout, limit = limits
    size = ranges.size
    points = np.empty((size, 3), np.float32)
    intensity, source = np.empty(size, np.float32), np.empty(size, np.int32)
    ring, column = np.empty(size, np.int16), np.empty(size, np.int32)
    count = 0
    for c in range(ranges.shape[1]):
        for j in order:
            true = np.float64(ranges[j, c])
            if owners[j, c] == NOTHING or chances[j, c] < dropout:
                continue
            signal = np.float64(reflectivity[j, c]) * np.float64(cosines[j, c])
            if signal * far * far < limit * true * true:
                continue
            measured = true + sigma * np.float64(noise[j, c])
            if step > 0.0:
                measured = step * np.rint(measured / step)
            if measured < near or measured > far:
                continue
            flat = measured * elevations[j, 0]
            points[count, 0], points[count, 1] = flat * azimuths[c, 0], flat * azimuths[c, 1]
            points[count, 2] = measured * elevations[j, 1]
            intensity[count] = signal / (1.0 + (4.0 * true / far) ** 2)
            ring[count], column[count], source[count] = j, c, owners[j, c]
            count += 1
    return points[:count], intensity[:count], ring[:count], column[:count], source[:count]


@compiled()
def interpolate_columns(
    way: Way, knots: np.ndarray, fractions: np.ndarray, azimuths: np.ndarray, columns: np.ndarray
) -> None:
    """Fill origin, direction and z axis of each column, (3, C, 3), from poses at the knots.

    knots, fractions: (C,) which knot is before a column, and the share of the way to the next.
    azimuths: (C, 2) cosines and sines.
    """
    matrices, turns, angles = way
    origins, ahead, up = columns[0], columns[1], columns[2]
    step, lidar = np.empty((3, 3)), np.empty((3, 3))
    for c in range(len(knots)):
        k, f = knots[c], fractions[c]
        after = min(k + 1, len(matrices) - 1)
        sine, rest = np.sin(f * angles[k]), 1.0 - np.cos(f * angles[k])
        for i in range(3):
            for j in range(3):
                square = 0.0
                for m in range(3):
                    square += turns[k, i, m] * turns[k, m, j]
                # Rodrigues' formula; a turn about z leaves the z axis as it is, to the bit.
                step[i, j] = (1.0 if i == j else 0.0) + sine * turns[k, i, j] + rest * square
        for i in range(3):
            for j in range(3):
                lidar[i, j] = 0.0
                for m in range(3):
                    lidar[i, j] += matrices[k, i, m] * step[m, j]
            start = matrices[k, i, 3]
            origins[c, i] = start + f * (matrices[after, i, 3] - start)
            ahead[c, i] = azimuths[c, 0] * lidar[i, 0] + azimuths[c, 1] * lidar[i, 1]
            up[c, i] = lidar[i, 2]
