"""OC-SORT: observations before estimates (Cao 2023), for boxes in space."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.arguments import check_counts, check_not_negative, check_shares
from roadscope.core.tables import ArrayTable
from roadscope.trackers._assignment import Pairs, assign_optimally, unassigned
from roadscope.trackers._gating import CandidatePairs, boxes_of, check_overlap, pairs_by_overlap
from roadscope.trackers._kalman import Gaussians
from roadscope.trackers._motion import ConstantVelocity, PositionFilter
from roadscope.trackers._ticks import TrackerTick
from roadscope.trackers._tracklets import LifeCycle, Tracklets


@dataclass(frozen=True, slots=True, eq=False)
class Observations(ArrayTable):
    """What N tracks remember of their detections.

    boxes: (N, 7) of the last detection.
    positions: (N, K, 2) x and y in the last K ticks, the newest last, NaN without a detection.
    directions: (N, 2) unit vectors of the motion between detections, 0 where unknown.
    beliefs: right after the last detection.
    stamps: (N,) seconds, of the last detection.
    """

    boxes: np.ndarray
    positions: np.ndarray
    directions: np.ndarray
    beliefs: Gaussians
    stamps: np.ndarray

    @staticmethod
    def started(detections: Detections, beliefs: Gaussians, ticks: int) -> Observations:
        """Return observations of one detection each; they reach back by some ticks."""
        n = len(detections)
        positions = np.full((n, ticks + 1, 2), np.nan)
        positions[:, -1] = detections.centres[:, :2]
        stamps = np.full(n, detections.stamp_s)
        return Observations(boxes_of(detections), positions, np.zeros((n, 2)), beliefs, stamps)

    def next_tick(self) -> Observations:
        """Return observations at the next tick, without a detection as yet."""
        none = np.full((len(self.boxes), 1, 2), np.nan)
        return replace(self, positions=np.concatenate([self.positions[:, 1:], none], axis=1))

    def updated(
        self, rows: np.ndarray, detections: Detections, beliefs: Gaussians, moving_m: float
    ) -> Observations:
        """Return observations of which the rows of an index array got a detection each.

        moving_m: least distance between two positions that have a direction.
        """
        before = self.select(rows)
        positions = before.positions.copy()
        positions[:, -1] = detections.centres[:, :2]
        after = Observations(
            boxes=boxes_of(detections),
            positions=positions,
            directions=unit_vectors(positions[:, -1] - before.anchors, moving_m),
            beliefs=beliefs,
            stamps=np.full(len(rows), detections.stamp_s),
        )
        return self.replaced(rows, after)

    @property
    def anchors(self) -> np.ndarray:
        """(N, 2) the oldest stored position; without one, the position of the last box."""
        known = ~np.isnan(self.positions[..., 0])
        oldest = self.positions[np.arange(len(known)), known.argmax(axis=1)]
        anchors: np.ndarray = np.where(known.any(axis=1)[:, None], oldest, self.boxes[:, :2])
        return anchors


@dataclass(frozen=True, slots=True, eq=False)
class OcSortTracks(ArrayTable):
    """Tracks, and what they remember."""

    tracks: Tracklets
    observations: Observations


class OcSortTracker:
    """SORT that relies on detections more than on the estimates of the filter.

    Observation-centric momentum (OCM): a detection in the direction of the track's motion is
    preferred. Recovery (OCR): a track without a detection where it is expected may take one where
    its last detection was. Re-update (ORU): when a track gets a detection after a gap, the filter
    runs through the gap again, along a straight line between both detections.
    """

    def __init__(
        self,
        *,
        least_score: float = 0.3,
        overlap: str = "giou",
        least: float = -0.2,
        momentum: float = 0.2,
        momentum_ticks: int = 3,
        moving_m: float = 0.5,
        confirm_hits: int = 3,
        coast_frames: int = 30,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        least_score: detections with a lower score are ignored.
        overlap, least: `iou` or `giou` in space, and what a pair must exceed, as in the later code
            of AB3DMOT's authors, for cars.
        momentum: weight of directions relative to overlaps, lambda.
        momentum_ticks: number of ticks over which a direction is taken, delta t.
        moving_m: least distance between two positions that have a direction; without it parked
            cars would have that of their detector's noise.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`.
        position_m, speed_m_s: see `PositionFilter`.
        velocity_walk: see `ConstantVelocity`.
        """
        check_shares(least_score=least_score)
        check_overlap(overlap, least)
        check_not_negative(momentum=momentum, moving_m=moving_m, velocity_walk=velocity_walk)
        check_counts(1, momentum_ticks=momentum_ticks)
        self._least_score, self._overlap, self._least = least_score, overlap, least
        self._momentum, self._ticks, self._moving_m = momentum, momentum_ticks, moving_m
        self._life_cycle = LifeCycle(confirm_hits, coast_frames, 0, shown_misses)
        self._filter = PositionFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: TrackerTick | None = None
        self._next_id = 0
        self._stamps: list[float] = []
        self._current = self._started(Detections.empty(0.0))

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._tick = TrackerTick.after(self._tick, detections, ego_pose)
        detections = tick.detections.select(tick.detections.scores >= self._least_score)
        tracks, observations = self._current.tracks, self._current.observations.next_tick()
        tracks = tracks.predicted(self._filter.predicted(tracks.beliefs, tick.period_s))
        rows, columns = self._assigned(tracks, observations, detections)
        own = detections.select(columns)
        self._stamps = [t for t in self._stamps if t >= observations.stamps.min(initial=np.inf)]
        self._stamps.append(tick.stamp_s)
        beliefs = self._re_updated(observations.select(rows), own.centres[:, :2])
        current = OcSortTracks(
            tracks.updated(rows, own, beliefs),
            observations.updated(rows, own, beliefs, self._moving_m),
        )
        alive = self._life_cycle.alive(current.tracks.hits, current.tracks.misses)
        new = detections.select(unassigned(len(detections), columns))
        self._current = current.select(alive).joined(self._started(new))
        tracks = self._current.tracks
        return tracks.as_tracks(self._life_cycle.states(tracks), tick)

    def _assigned(
        self, tracks: Tracklets, observations: Observations, detections: Detections
    ) -> Pairs:
        """Return pairs by overlap and momentum (eq. 4), then by overlap with last boxes (OCR)."""
        unassigned_cost = 1 - self._least
        near = self._overlapping(tracks.boxes, tracks.categories, detections)
        costs = near.costs - self._momentum * self._agreement(near, observations, detections)
        # No pair costs more than this, so an opposite direction alone never rules a pair out.
        rows, columns = assign_optimally(near.with_costs(costs), unassigned_cost + self._momentum)
        missed, free = unassigned(len(tracks), rows), unassigned(len(detections), columns)
        near = self._overlapping(
            observations.boxes[missed], tracks.categories[missed], detections.select(free)
        )
        i, j = assign_optimally(near, unassigned_cost)
        return np.concatenate([rows, missed[i]]), np.concatenate([columns, free[j]])

    def _overlapping(
        self, boxes: np.ndarray, categories: np.ndarray, detections: Detections
    ) -> CandidatePairs:
        near = pairs_by_overlap(
            boxes, boxes_of(detections), overlap=self._overlap, least=self._least
        )
        return near.within_families(categories, detections.categories)

    def _agreement(
        self, pairs: CandidatePairs, observations: Observations, detections: Detections
    ) -> np.ndarray:
        """Return (P,) how well pairs continue the track's direction, -1/2 to 1/2.

        Weighted by the score of the detection, as in the authors' code; 0 without a direction.
        """
        ahead = detections.centres[pairs.columns, :2] - observations.anchors[pairs.rows]
        agreement = direction_agreement(
            observations.directions[pairs.rows], unit_vectors(ahead, self._moving_m)
        )
        weighted: np.ndarray = detections.scores[pairs.columns] * agreement
        return weighted

    def _re_updated(self, observations: Observations, positions: np.ndarray) -> Gaussians:
        """Return beliefs after (N, 2) new positions, filtered through all ticks since the last.

        Positions between are interpolated (ORU). Without a gap it is the ordinary update.
        """
        beliefs, start = observations.beliefs, observations.boxes[:, :2]
        now_s = self._stamps[-1]
        for before_s, stamp_s in itertools.pairwise(self._stamps):
            rows = np.flatnonzero(observations.stamps <= before_s)
            if not len(rows):
                continue
            since_s = observations.stamps[rows]
            share = ((stamp_s - since_s) / (now_s - since_s))[:, None]
            virtual = start[rows] + share * (positions[rows] - start[rows])
            predicted = self._filter.predicted(beliefs.select(rows), stamp_s - before_s)
            beliefs = beliefs.replaced(rows, self._filter.corrected(predicted, virtual))
        return beliefs

    def _started(self, detections: Detections) -> OcSortTracks:
        beliefs = self._filter.started(detections)
        started = Tracklets.started(self._next_id, detections, beliefs)
        self._next_id += len(detections)
        return OcSortTracks(started, Observations.started(detections, beliefs, self._ticks))


def unit_vectors(vectors: np.ndarray, least: float) -> np.ndarray:
    """Return (..., 2) vectors of length 1, or 0 where they are shorter than `least`."""
    lengths = np.hypot(vectors[..., 0], vectors[..., 1])[..., None]
    long = lengths >= max(least, 1e-9)
    units: np.ndarray = np.where(long, vectors / np.where(long, lengths, 1.0), 0.0)
    return units


def direction_agreement(directions: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return (P,) how well (P, 2) directions agree; they are unit vectors or 0.

    1/2 is the same direction, -1/2 the opposite one, 0 a right angle or unknown.
    """
    along = (directions * others).sum(axis=1)
    across = directions[:, 0] * others[:, 1] - directions[:, 1] * others[:, 0]
    known = (along != 0) | (across != 0)
    agreement: np.ndarray = np.where(known, 0.5 - np.arctan2(np.abs(across), along) / np.pi, 0.0)
    return agreement
