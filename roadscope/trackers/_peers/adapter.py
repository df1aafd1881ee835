"""The adapter for trackers of other libraries: it handles frames, families, boxes, identities.

All of them track points or boxes in a plane that stands still. Here it is the ground plane of the
world frame, in metres and seconds (of the ego frame if the ego pose is unknown). Each family of
road users has a tracker of its own, as is usual where a library has no classes.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from roadscope.core import Detections, Family, Pose, Tracks
from roadscope.core.arguments import check_counts
from roadscope.trackers._gating import FAMILIES
from roadscope.trackers._kalman import Gaussians
from roadscope.trackers._ticks import TrackerTick
from roadscope.trackers._tracklets import Tracklets, track_states


class LibraryTrack(NamedTuple):
    """What a library reports of one track after a tick.

    key: the library's identifier of the track; no other track ever gets it.
    mean, covariance: (4,) and (4, 4) of x, y, vx, vy.
    detection: the row of the detection that it took, -1 for none; new tracks have one.
    confirmed: whether the library reports it when it has a detection.
    """

    key: Hashable
    mean: np.ndarray
    covariance: np.ndarray
    detection: int
    confirmed: bool


class LibraryTracker(Protocol):
    """A tracker of a library for one family of road users."""

    def follow(self, detections: Detections, period_s: float) -> list[LibraryTrack]:
        """Return all tracks after the detections of a tick, tentative and missed ones included.

        period_s: seconds since the last tick.
        """


class TrackerAdapter:
    """Runs a library's tracker for each family and reports like our trackers.

    It remembers what the library does not: height, size and heading of the last detection of each
    track, its category and score, and the ticks since then.
    """

    def __init__(self, start: Callable[[Family], LibraryTracker], shown_misses: int) -> None:
        """Set the adapter up.

        start: starts the library's tracker for a family.
        shown_misses: see `LifeCycle`.
        """
        check_counts(0, shown_misses=shown_misses)
        self._start, self._shown_misses = start, shown_misses
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: TrackerTick | None = None
        self._libraries = {family: self._start(family) for family in Family}
        self._tracks = Tracklets.empty(4)
        self._rows: dict[Hashable, int] = {}
        self._next_id = 0

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._tick = TrackerTick.after(self._tick, detections, ego_pose)
        reported = self._reported(tick)
        old = [track for track in reported if track.key in self._rows]
        new = [track for track in reported if track.key not in self._rows]
        rows = np.array([self._rows[track.key] for track in old], np.int64)
        tracks = self._tracks.select(rows).predicted(_beliefs(old))
        detection = np.array([track.detection for track in old], np.int64)
        detected = np.flatnonzero(detection >= 0)
        own = tick.detections.select(detection[detected])
        tracks = tracks.updated(detected, own, tracks.beliefs.select(detected))
        first = tick.detections.select(np.array([track.detection for track in new], np.int64))
        started = Tracklets.started(self._next_id, first, _beliefs(new))
        self._tracks = tracks.joined(started)
        self._next_id += len(new)
        self._rows = {track.key: row for row, track in enumerate([*old, *new])}
        confirmed = np.array([track.confirmed for track in [*old, *new]], bool)
        states = track_states(confirmed, self._tracks.misses, self._shown_misses)
        return self._tracks.as_tracks(states, tick)

    def _reported(self, tick: TrackerTick) -> list[LibraryTrack]:
        """Return the tracks of all families; their detections are rows of the tick's detections."""
        families = FAMILIES[tick.detections.categories]
        reported = []
        for number, (family, library) in enumerate(self._libraries.items()):
            index = np.flatnonzero(families == number)
            # A track without a detection has the index -1: that of the last entry, which is -1.
            row_of = np.append(index, -1)
            for track in library.follow(tick.detections.select(index), tick.period_s):
                row = int(row_of[track.detection])
                reported.append(track._replace(key=(family, track.key), detection=row))
        return reported


def _beliefs(tracks: Sequence[LibraryTrack]) -> Gaussians:
    n = len(tracks)
    return Gaussians(
        np.reshape([track.mean for track in tracks], (n, 4)).astype(float),
        np.reshape([track.covariance for track in tracks], (n, 4, 4)).astype(float),
    )
