"""When a track is believed, when it coasts, and when it is dropped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import TrackState
from roadscope.trackers.settings import check_counts
from roadscope.trackers.tracklets import Tracklets

TENTATIVE, CONFIRMED, COASTING = (np.int8(state) for state in TrackState)


@dataclass(frozen=True, slots=True)
class LifeCycle:
    """Confirmed after a few detections, dropped after a few ticks without one.

    confirm_hits: detections after which a track is confirmed.
    coast_frames: ticks without a detection that a confirmed track outlives.
    tentative_frames: likewise of one that is not confirmed yet.
    shown_misses: of these ticks the first in which a confirmed track is still answered for.
    """

    confirm_hits: int = 3
    coast_frames: int = 10
    tentative_frames: int = 0
    shown_misses: int = 0

    def __post_init__(self) -> None:
        check_counts(1, confirm_hits=self.confirm_hits)
        check_counts(
            0, coast_frames=self.coast_frames, tentative_frames=self.tentative_frames,
            shown_misses=self.shown_misses,
        )  # fmt: skip

    def alive(self, tracks: Tracklets) -> np.ndarray:
        """Return (N,) bool, which have not been unseen for too long."""
        return kept(
            tracks.hits, tracks.misses, confirm_hits=self.confirm_hits,
            coast_frames=self.coast_frames, tentative_frames=self.tentative_frames,
        )  # fmt: skip

    def survivors(self, tracks: Tracklets) -> Tracklets:
        """Drop what has been unseen for too long."""
        return tracks.select(self.alive(tracks))

    def states(self, tracks: Tracklets) -> np.ndarray:
        """Return (N,) int8 states."""
        return track_states(
            tracks.hits, tracks.misses,
            confirm_hits=self.confirm_hits, shown_misses=self.shown_misses,
        )  # fmt: skip


def track_states(
    hits: np.ndarray, misses: np.ndarray, *, confirm_hits: int, shown_misses: int
) -> np.ndarray:
    """Return (N,) int8 states.

    A track is tentative until it has `confirm_hits` detections. Then it is confirmed while it is
    seen and coasts while it is not; after more than `shown_misses` ticks without a detection the
    tracker goes on looking for it but answers for it no longer, so it is tentative again.
    """
    return told_states(hits >= confirm_hits, misses, shown_misses)


def told_states(confirmed: np.ndarray, misses: np.ndarray, shown_misses: int) -> np.ndarray:
    """Return (N,) int8 states of tracks that are (N,) bool confirmed, or tentative as yet."""
    seen = np.where(misses > 0, COASTING, CONFIRMED)
    return np.where(confirmed & (misses <= shown_misses), seen, TENTATIVE)


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
