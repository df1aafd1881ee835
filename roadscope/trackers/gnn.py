"""Global nearest neighbour in bird's-eye view: SORT with Mahalanobis distances for overlaps."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.assignment import Pairs, assign_optimally, left_over
from roadscope.trackers.gating import barred, chi_square_gate, gated_distances, same_family
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.motion import ConstantVelocity
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.settings import check_not_negative, check_shares
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets


class GnnTracker:
    """Every detection goes to one track at most, so that the whole is likeliest.

    As SORT (Bewley 2016): Kalman filter, optimal assignment, tracks confirmed after a few hits
    and dropped after a few misses. Detections are vehicles' centres seen from above, so distance
    in units of the filter's own uncertainty takes the place of the overlap of image boxes.
    """

    def __init__(
        self,
        *,
        gate_share: float = 0.997,
        least_score: float = 0.0,
        confirm_hits: int = 3,
        coast_frames: int = 10,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        gate_share: share of right pairs that the gate lets through, if the noise is as said.
        least_score: detections below are not looked at.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`.
        position_m, speed_m_s: see `PlaceFilter`.
        velocity_walk: m/s per root second, by which velocities wander.
        """
        if not 0 < gate_share < 1:
            raise ValueError(f"gate_share must lie between 0 and 1, got {gate_share!r}")
        check_shares(least_score=least_score)
        check_not_negative(velocity_walk=velocity_walk)
        self._gate = chi_square_gate(gate_share, 2)
        self._least_score = least_score
        self._life = LifeCycle(confirm_hits, coast_frames, 0, shown_misses)
        self._filter = PlaceFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._tracks = Tracklets.empty(self._filter.dimensions)
        self._next_id = 0

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        targets = tick.targets.select(tick.targets.scores >= self._least_score)
        tracks = self._tracks.moved_on(self._filter.predicted(self._tracks.beliefs, tick.period_s))
        rows, columns = self._associated(tracks, targets)
        found = targets.select(columns)
        beliefs = self._filter.corrected(tracks.beliefs.select(rows), found.centres[:, :2])
        tracks = self._life.survivors(tracks.seen(rows, found, beliefs))
        new = targets.select(left_over(len(targets), columns))
        self._tracks = tracks.joined(
            Tracklets.opened(self._next_id, new, self._filter.started(new))
        )
        self._next_id += len(new)
        planar = self._filter.planar(self._tracks.beliefs)
        return self._tracks.report(
            planar, self._life.states(self._tracks), tick.frame, tick.stamp_s
        )

    def _associated(self, tracks: Tracklets, targets: Detections) -> Pairs:
        """Pair by d2 + ln det S: a vague track must not take what a sure one expects."""
        S = self._filter.expected(tracks.beliefs)
        distances = gated_distances(tracks.places, S, targets.centres[:, :2], self._gate)
        possible = same_family(tracks.categories, targets.categories)
        vagueness = np.log(S[:, 0, 0] * S[:, 1, 1] - S[:, 0, 1] ** 2)
        # Being alone costs more than any pair within its gate.
        alone = self._gate + vagueness.max(initial=-np.inf)
        distances += vagueness[:, None]
        return assign_optimally(barred(distances, possible), alone)
