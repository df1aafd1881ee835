"""Headings of tracks that move: boxes show an axis, velocities show which of its ends is ahead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Tracks
from roadscope.core.pose import wrap_angle

# Chosen by hand. Road users hardly reverse faster.
MOVING_M_S = 1.0
"""Up to this speed along its axis, m/s, a track may belong to a standing object."""
SURE = 2.0
"""Standard deviations by which that speed must differ from 0 to show a direction of travel."""


def facing_ahead(tracks: Tracks, travels: np.ndarray | None = None) -> Tracks:
    """Return tracks whose headings are turned by half a turn where they point against the travel.

    travels: (N, 2), what `travel_directions` returns for them; computed without it.
    """
    travels = travel_directions(tracks) if travels is None else travels
    against = (travels * _unit_vectors(tracks.yaws)).sum(axis=1) < 0
    if not against.any():
        return tracks
    return replace(tracks, yaws=np.where(against, wrap_angle(tracks.yaws + np.pi), tracks.yaws))


def travel_directions(tracks: Tracks, earlier: np.ndarray | None = None) -> np.ndarray:
    """Return (N, 2) unit vectors along the axes of tracks, to the end towards which they travel.

    Where the speed along the axis is small or uncertain, they are the earlier ones, or 0; so they
    are in frame `ego`, where velocities are relative to an ego that may move.
    """
    if earlier is None:
        earlier = np.zeros((len(tracks), 2))
    if tracks.frame == "ego":
        return earlier
    axes = _unit_vectors(tracks.yaws)
    speeds = (axes * tracks.velocities).sum(axis=1)
    variances = np.einsum("ni,nij,nj->n", axes, tracks.covariances[:, 2:, 2:], axes)
    moving = np.abs(speeds) > np.maximum(MOVING_M_S, SURE * np.sqrt(np.maximum(variances, 0)))
    return np.where(moving[:, None], np.sign(speeds)[:, None] * axes, earlier)


def _unit_vectors(yaws: np.ndarray) -> np.ndarray:
    """Return (N, 2), the directions of yaws in radians."""
    return np.column_stack([np.cos(yaws), np.sin(yaws)])
