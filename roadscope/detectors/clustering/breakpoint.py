"""Clustering by adaptive breakpoints (Borges and Aldon 2004)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from roadscope.core import wrap_angle
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.sorting import order_by, order_within, starts_of

INCIDENCE_RAD = np.radians(10.0)
"""Smallest angle between a beam and a surface that is allowed for, as in the paper."""
MAX_STEPS = 3.5
"""Linked neighbours of a beam are less than so many columns apart: two lost returns are bridged."""


def cluster_breakpoint(cloud: Cloud, *, range_noise_m: float = 0.1) -> np.ndarray:
    """Link neighbours of a beam up to a breakpoint that grows with range.

    Returns (N,) int64 labels, none negative.

    Neighbouring returns of a beam are linked unless they are farther apart than
    D = r sin(step) / sin(incidence - step) + 3 sigma, the spacing on a surface at the smallest
    incidence. The paper has one beam. Here neighbouring beams of a column are linked too, up to the
    D of one step between columns. The paper's r is the earlier of the two ranges. Here it is the
    lesser one, so that the direction of the sweep does not matter. The default of `range_noise_m`
    is from the LUX's data sheet.
    """
    if len(cloud) < 2:
        return np.zeros(len(cloud), np.int64)
    azimuths, ranges = cloud.azimuths, cloud.ranges
    rings, columns = _along_rings(cloud.ring, azimuths), _along_columns(cloud.column, cloud.ring)
    steps = np.abs(wrap_angle(np.diff(azimuths[rings], axis=0)[0]))
    step = _resolution(steps, np.abs(np.diff(cloud.column[rings], axis=0)[0]))
    pairs = np.concatenate([rings, columns], axis=1)
    steps = np.concatenate([steps, np.full(columns.shape[1], step)])
    gaps = np.hypot(*(cloud.points[pairs[0], :2] - cloud.points[pairs[1], :2]).T)
    linked = gaps <= reach(ranges[pairs].min(axis=0), steps) + 3 * range_noise_m
    links = pairs[:, linked & (steps < MAX_STEPS * step)]
    graph = coo_array((np.ones(links.shape[1], bool), (links[0], links[1])), (len(cloud),) * 2)
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def reach(ranges: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return the spacing, (N,) metres, of two returns of a face at the smallest incidence.

    ranges: (N,) metres, of the nearer return. steps: (N,) radians between the two beams.
    """
    # At a step of the incidence angle the spacing would be infinite.
    steps = np.minimum(steps, 0.9 * INCIDENCE_RAD)
    spacing: np.ndarray = ranges * np.sin(steps) / np.sin(INCIDENCE_RAD - steps)
    return spacing


def _resolution(steps: np.ndarray, columns: np.ndarray) -> float:
    """Return radians from column to column, from the steps between returns of two columns."""
    several = columns > 0
    return float(np.median(steps[several] / columns[several])) if several.any() else 0.0


def _along_rings(ring: np.ndarray, azimuths: np.ndarray) -> np.ndarray:
    """Return pairs of neighbouring returns of a beam, also of its last and first one, (2, P)."""
    order = order_by(ring)
    starts = starts_of(ring[order])
    order = order[order_within(azimuths[order], starts)]
    pairs = np.stack([order[:-1], order[1:]])[:, ring[order[:-1]] == ring[order[1:]]]
    return np.concatenate([pairs, np.stack([order[starts[1:] - 1], order[starts[:-1]]])], axis=1)


def _along_columns(column: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Return pairs of returns of neighbouring beams in a column, (2, P)."""
    order = order_by(ring)
    order = order[order_by(column[order])]
    return np.stack([order[:-1], order[1:]])[:, column[order[:-1]] == column[order[1:]]]
