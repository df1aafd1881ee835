"""Headings of moving tracks: boxes show an axis, velocities show which of its ends is the front."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Tracks
from roadscope.core.pose import wrap_angle

MOVING_M_S = 1.0
"""A track shows a direction of travel above this speed along its axis; slower ones may stand or
reverse. Chosen by hand."""
LEAST_DEVIATIONS = 2.0
"""Least ratio of that speed to its standard deviation. Chosen by hand."""


def facing_ahead(tracks: Tracks, travels: np.ndarray | None = None) -> Tracks:
    """Return tracks with headings turned by half a turn where they point against the travel.

    travels: (N, 2) as from `travel_directions`; None to compute them.
    """
    travels = travel_directions(tracks) if travels is None else travels
    against = (travels * _unit_vectors(tracks.yaws)).sum(axis=1) < 0
    if not against.any():
        return tracks
    return replace(tracks, yaws=np.where(against, wrap_angle(tracks.yaws + np.pi), tracks.yaws))


def travel_directions(tracks: Tracks, earlier: np.ndarray | None = None) -> np.ndarray:
    """Return (N, 2) unit vectors along the axes of tracks in the direction of travel.

    Where the speed along the axis is small or uncertain, they are those of `earlier`, or 0 without
    it. The same holds for all tracks in frame `ego`, where velocities are relative to a moving ego.
    """
    if earlier is None:
        earlier = np.zeros((len(tracks), 2))
    if tracks.frame == "ego":
        return earlier
    axes = _unit_vectors(tracks.yaws)
    speeds = (axes * tracks.velocities).sum(axis=1)
    variances = np.einsum("ni,nij,nj->n", axes, tracks.covariances[:, 2:, 2:], axes)
    deviations = np.sqrt(np.maximum(variances, 0))
    moving = np.abs(speeds) > np.maximum(MOVING_M_S, LEAST_DEVIATIONS * deviations)
    return np.where(moving[:, None], np.sign(speeds)[:, None] * axes, earlier)


def _unit_vectors(yaws: np.ndarray) -> np.ndarray:
    """Return (N, 2), the directions of yaws in radians."""
    return np.column_stack([np.cos(yaws), np.sin(yaws)])
