"""Global nearest neighbour: SORT in bird's-eye view, with Mahalanobis distances for overlaps."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.arguments import check_not_negative, check_shares
from roadscope.trackers._assignment import Pairs, assign_optimally
from roadscope.trackers._gating import chi_square_gate, determinants, pairs_by_likelihood
from roadscope.trackers._motion import ConstantVelocity, PositionFilter
from roadscope.trackers._tracklets import LifeCycle, Tracklets, TrackManager


class GnnTracker:
    """Assigns each detection to at most one track, so that all together are likeliest.

    As SORT (Bewley 2016): Kalman filter, optimal assignment, tracks confirmed after a few hits
    and dropped after a few misses. Detections are centres of vehicles in bird's-eye view, so the
    Mahalanobis distance takes the place of the overlap of image boxes.
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

        gate_share: share of right pairs that lie within the gate if the noise is as assumed.
        least_score: detections with a lower score are ignored.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`.
        position_m, speed_m_s: see `PositionFilter`.
        velocity_walk: see `ConstantVelocity`.
        """
        check_shares(least_score=least_score)
        check_not_negative(velocity_walk=velocity_walk)
        self._gate = chi_square_gate(gate_share, 2)
        self._least_score = least_score
        self._filter = PositionFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk))
        life_cycle = LifeCycle(confirm_hits, coast_frames, 0, shown_misses)
        self._manager = TrackManager(self._filter, life_cycle)

    def reset(self) -> None:
        """Forget all tracks."""
        self._manager.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._manager.start_tick(detections, ego_pose)
        detections = tick.detections.select(tick.detections.scores >= self._least_score)
        tracks = self._manager.predicted_tracks(tick)
        pairs = likeliest_pairs(tracks, detections, self._filter.R, self._gate)
        return self._manager.finish_tick(tick, tracks, detections, pairs)


def likeliest_pairs(tracks: Tracklets, detections: Detections, R: np.ndarray, gate: float) -> Pairs:
    """Return the pairs with the least sum of d2 + ln det S.

    d2 is the squared Mahalanobis distance, S the covariance of the innovation. The determinant
    keeps an uncertain track from taking a detection that a certain one expects.

    R: (2, 2) covariance of a detected position. gate: of d2.
    """
    S = tracks.beliefs.covariances[:, :2, :2] + R
    near = pairs_by_likelihood(tracks.positions, S, detections.centres[:, :2], gate)
    near = near.within_families(tracks.categories, detections.categories)
    log_determinants = np.log(determinants(S))
    # Being unassigned costs more than any pair within its gate.
    unassigned_cost = gate + log_determinants.max(initial=-np.inf)
    costs = near.costs + log_determinants[near.rows]
    return assign_optimally(near.with_costs(costs), unassigned_cost)
