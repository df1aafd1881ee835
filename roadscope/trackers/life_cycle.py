"""When a track is believed, when it coasts, and when it is dropped."""

from __future__ import annotations

import numpy as np

from roadscope.core import TrackState


def track_states(
    hits: np.ndarray, misses: np.ndarray, *, confirm_hits: int, shown_misses: int
) -> np.ndarray:
    """Return (N,) int8 states.

    A track is tentative until it has `confirm_hits` detections. Then it is confirmed while it is
    seen and coasts while it is not; after more than `shown_misses` ticks without a detection the
    tracker goes on looking for it but answers for it no longer, so it is tentative again.
    """
    states = np.where(misses > 0, TrackState.COASTING, TrackState.CONFIRMED)
    states[(hits < confirm_hits) | (misses > shown_misses)] = TrackState.TENTATIVE
    return states.astype(np.int8)


def kept(
    hits: np.ndarray,
    misses: np.ndarray,
    *,
    confirm_hits: int,
    coast_frames: int,
    tentative_frames: int,
) -> np.ndarray:
    """Return (N,) bool, which tracks live on.

    A confirmed track outlives `coast_frames` ticks without a detection, one with fewer than
    `confirm_hits` detections `tentative_frames`.
    """
    patience = np.where(hits < confirm_hits, tentative_frames, coast_frames)
    alive: np.ndarray = misses <= patience
    return alive
