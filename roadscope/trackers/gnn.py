"""Global nearest neighbour in bird's-eye view: SORT with Mahalanobis distances for overlaps."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.assignment import Pairs, assign_optimally
from roadscope.trackers.gating import candidates_by_likelihood, chi_square_gate, determinants
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.management import TrackManager
from roadscope.trackers.motion import ConstantVelocity
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.settings import check_not_negative, check_shares
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
        check_shares(least_score=least_score)
        check_not_negative(velocity_walk=velocity_walk)
        self._gate = chi_square_gate(gate_share, 2)
        self._least_score = least_score
        self._filter = PlaceFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk))
        life = LifeCycle(confirm_hits, coast_frames, 0, shown_misses)
        self._manager = TrackManager(self._filter, life)

    def reset(self) -> None:
        """Forget all tracks."""
        self._manager.reset()

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._manager.arrived(detections, ego_pose)
        targets = tick.targets.select(tick.targets.scores >= self._least_score)
        tracks = self._manager.expected(tick)
        pairs = likeliest_pairs(tracks, targets, self._filter.R, self._gate)
        return self._manager.concluded(tick, tracks, targets, pairs, 0.0)


def likeliest_pairs(tracks: Tracklets, targets: Detections, R: np.ndarray, gate: float) -> Pairs:
    """Pair by d2 + ln det S: a vague track must not take what a sure one expects.

    R: (2, 2) covariance of a detected place; gate: of d2.
    """
    S = tracks.beliefs.covariances[:, :2, :2] + R
    near = candidates_by_likelihood(tracks.places, S, targets.centres[:, :2], gate)
    near = near.within_families(tracks.categories, targets.categories)
    vagueness = np.log(determinants(S))
    # Being alone costs more than any pair within its gate.
    alone = gate + vagueness.max(initial=-np.inf)
    return assign_optimally(near.costing(near.costs + vagueness[near.rows]), alone)
