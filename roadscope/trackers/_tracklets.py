"""The table of a tracker's tracks, their life cycle, and the update that many trackers share."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks, TrackState
from roadscope.core.arguments import check_counts
from roadscope.core.tables import ArrayTable
from roadscope.trackers._assignment import Pairs, unassigned
from roadscope.trackers._headings import facing_ahead
from roadscope.trackers._kalman import Gaussians
from roadscope.trackers._motion import PositionFilter, planar
from roadscope.trackers._ticks import TrackerTick

TENTATIVE, CONFIRMED, COASTING = (np.int8(state) for state in TrackState)


@dataclass(frozen=True, slots=True, eq=False)
class Tracklets(ArrayTable):
    """N tracks, in the frame of the detections from which they come.

    ids: (N,) int64.
    beliefs: (N, D) means and their covariances; the first two of D are x and y.
    heights, sizes, yaws: (N,), (N, 3), (N,) z of the centre, length width height, heading.
    categories: (N,) int8, values of `Category`.
    scores: (N,) 0 to 1.
    hits: (N,) detections so far.
    misses: (N,) ticks since the last detection.
    """

    ids: np.ndarray
    beliefs: Gaussians
    heights: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    categories: np.ndarray
    scores: np.ndarray
    hits: np.ndarray
    misses: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    @staticmethod
    def empty(dimensions: int) -> Tracklets:
        """Return no tracks, of states with D dimensions."""
        return Tracklets.started(0, Detections.empty(0.0), Gaussians.empty(dimensions))

    @staticmethod
    def started(first_id: int, detections: Detections, beliefs: Gaussians) -> Tracklets:
        """Return a new track for each of N detections, with ids from `first_id` on."""
        zeros = np.zeros(len(detections), np.int64)
        return Tracklets(
            ids=first_id + np.arange(len(detections)),
            beliefs=beliefs,
            heights=detections.centres[:, 2],
            sizes=detections.sizes,
            yaws=detections.yaws,
            categories=detections.categories,
            scores=detections.scores,
            hits=zeros + 1,
            misses=zeros,
        )

    @property
    def positions(self) -> np.ndarray:
        """(N, 2) x and y, metres."""
        return self.beliefs.means[:, :2]

    @property
    def boxes(self) -> np.ndarray:
        """(N, 7) centre x y z, length width height, yaw."""
        return np.column_stack([self.positions, self.heights, self.sizes, self.yaws])

    def predicted(self, beliefs: Gaussians) -> Tracklets:
        """Return the tracks at the next tick, where they are expected, not detected yet."""
        return replace(self, beliefs=beliefs, misses=self.misses + 1)

    def updated(self, rows: np.ndarray, detections: Detections, beliefs: Gaussians) -> Tracklets:
        """Return tracks of which the rows of an index array got a detection.

        beliefs: of these rows, corrected by their detections.
        """

        def with_rows(column: np.ndarray, values: np.ndarray | int) -> np.ndarray:
            changed = column.copy()
            changed[rows] = values
            return changed

        return Tracklets(
            ids=self.ids,
            beliefs=self.beliefs.replaced(rows, beliefs),
            heights=with_rows(self.heights, detections.centres[:, 2]),
            sizes=with_rows(self.sizes, detections.sizes),
            yaws=with_rows(self.yaws, detections.yaws),
            categories=with_rows(self.categories, detections.categories),
            scores=with_rows(self.scores, detections.scores),
            hits=with_rows(self.hits, self.hits[rows] + 1),
            misses=with_rows(self.misses, 0),
        )

    def as_tracks(self, states: np.ndarray, tick: TrackerTick) -> Tracks:
        """Return the record that a tracker reports.

        states: (N,) values of `TrackState`. Beliefs must begin with x, y, vx, vy.
        """
        belief = planar(self.beliefs)
        tracks = Tracks(
            ids=self.ids,
            centres=np.column_stack([self.positions, self.heights]),
            sizes=self.sizes,
            yaws=self.yaws,
            velocities=belief.means[:, 2:],
            covariances=belief.covariances,
            categories=self.categories,
            scores=self.scores,
            states=states,
            frame=tick.frame,
            stamp_s=tick.stamp_s,
        )
        return facing_ahead(tracks)


@dataclass(frozen=True, slots=True)
class LifeCycle:
    """Tracks are confirmed after some detections and dropped after some ticks without one.

    confirm_hits: detections after which a track is confirmed.
    coast_frames: ticks without a detection that a confirmed track outlives.
    tentative_frames: ticks without a detection that a tentative track outlives.
    shown_misses: ticks without a detection during which a confirmed track is reported as coasting;
        afterwards it is reported as tentative, while the tracker goes on looking for it.
    """

    confirm_hits: int = 3
    coast_frames: int = 10
    tentative_frames: int = 0
    shown_misses: int = 0

    def __post_init__(self) -> None:
        check_counts(1, confirm_hits=self.confirm_hits)
        check_counts(
            0,
            coast_frames=self.coast_frames,
            tentative_frames=self.tentative_frames,
            shown_misses=self.shown_misses,
        )

    def alive(self, hits: np.ndarray, misses: np.ndarray) -> np.ndarray:
        """Return (N,) bool, which tracks have not been missed for too long."""
        tentative = hits < self.confirm_hits
        alive: np.ndarray = misses <= np.where(tentative, self.tentative_frames, self.coast_frames)
        return alive

    def survivors(self, tracks: Tracklets) -> Tracklets:
        """Return the tracks that have not been missed for too long."""
        return tracks.select(self.alive(tracks.hits, tracks.misses))

    def states(self, tracks: Tracklets) -> np.ndarray:
        """Return (N,) int8 values of `TrackState`."""
        return track_states(tracks.hits >= self.confirm_hits, tracks.misses, self.shown_misses)


def track_states(confirmed: np.ndarray, misses: np.ndarray, shown_misses: int) -> np.ndarray:
    """Return (N,) int8 values of `TrackState`.

    confirmed: (N,) bool, whether a track may be reported as confirmed or coasting.
    misses, shown_misses: see `Tracklets` and `LifeCycle`.
    """
    states = np.where(misses > 0, COASTING, CONFIRMED)
    return np.where(confirmed & (misses <= shown_misses), states, TENTATIVE)


class TrackManager:
    """Predicts, corrects, starts and drops tracks; what is left to a tracker is association.

    In each update a tracker calls `start_tick`, then `predicted_tracks`, pairs these tracks with
    detections and hands the pairs to `finish_tick`.
    """

    def __init__(self, position_filter: PositionFilter, life_cycle: LifeCycle) -> None:
        self._filter, self._life_cycle = position_filter, life_cycle
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: TrackerTick | None = None
        self._tracks = Tracklets.empty(self._filter.motion.dimensions)
        self._next_id = 0

    def start_tick(self, detections: Detections, ego_pose: Pose | None) -> TrackerTick:
        """Return the tick that begins."""
        self._tick = TrackerTick.after(self._tick, detections, ego_pose)
        return self._tick

    def predicted_tracks(self, tick: TrackerTick) -> Tracklets:
        """Return the tracks where they are expected now."""
        return self._tracks.predicted(self._filter.predicted(self._tracks.beliefs, tick.period_s))

    def finish_tick(
        self,
        tick: TrackerTick,
        tracks: Tracklets,
        detections: Detections,
        pairs: Pairs,
        *,
        new_score: float = 0.0,
    ) -> Tracks:
        """Correct tracks by their detections and return the report.

        pairs: rows of tracks and the detections that they get.
        new_score: detections without a track start one if their score is at least this.
        """
        rows, columns = pairs
        own = detections.select(columns)
        beliefs = self._filter.corrected(tracks.beliefs.select(rows), own.centres[:, :2])
        tracks = self._life_cycle.survivors(tracks.updated(rows, own, beliefs))
        free = unassigned(len(detections), columns)
        new = detections.select(free[detections.scores[free] >= new_score])
        started = Tracklets.started(self._next_id, new, self._filter.started(new))
        self._next_id += len(new)
        self._tracks = tracks = tracks.joined(started)
        return tracks.as_tracks(self._life_cycle.states(tracks), tick)
