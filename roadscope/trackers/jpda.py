"""Joint integrated probabilistic data association: JIPDA (Musicki and Evans 2004)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks, TrackState
from roadscope.trackers.assignment import Pairs, assign_optimally
from roadscope.trackers.gating import barred, chi_square_gate, gated_distances, same_family
from roadscope.trackers.jpda_existence import Existence, Sighting
from roadscope.trackers.jpda_marginals import EXACT_LIMIT, association_marginals
from roadscope.trackers.kalman import Gaussians, innovations, updated
from roadscope.trackers.motion import ConstantVelocity
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.rows import Rows
from roadscope.trackers.settings import check_counts, check_not_negative, check_shares
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets


@dataclass(frozen=True, slots=True, eq=False)
class Followed(Rows):
    """Tracks, whether they exist, and whether they were ever sure to: (N,) bool."""

    tracks: Tracklets
    existence: Existence
    confirmed: np.ndarray


class JpdaTracker:
    """Every track takes the mean of all detections in its gate, by their probabilities.

    Probabilities are marginals of all joint events, exact up to `exact_limit`. Tracks are managed
    by their probability of existence alone, which a miss lowers and a detection raises, not by
    counts of hits. Reported scores are these probabilities.

    How tracks begin the paper leaves open. Reading taken: a detection that stems from no track,
    rather than from the one that it stems from most likely, opens a new one.
    """

    def __init__(
        self,
        *,
        gate_share: float = 0.997,
        detection: float = 0.9,
        clutter_m2: float = 1e-4,
        birth_m2: float = 1e-5,
        lifetime_s: float = 30.0,
        visible_s: float = 10.0,
        hidden_s: float = 1.0,
        score_weight: float = 1.0,
        confirm: float = 0.99,
        drop: float = 0.02,
        shown_misses: int = 0,
        exact_limit: float = EXACT_LIMIT,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        gate_share: share of right pairs that the gate lets through, if the noise is as said.
        detection, clutter_m2, birth_m2, lifetime_s, visible_s, hidden_s, score_weight: see
            `Sighting`.
        confirm, drop: probabilities of existence from which a track is confirmed, and below which
            one is dropped or not even begun.
        shown_misses: ticks without a detection in which a track is still answered for.
        exact_limit: see `jpda_marginals`.
        position_m, speed_m_s: see `PlaceFilter`.
        velocity_walk: m/s per root second, by which velocities wander.
        """
        check_shares(gate_share=gate_share, confirm=confirm, drop=drop)
        check_counts(0, shown_misses=shown_misses)
        check_not_negative(velocity_walk=velocity_walk)
        self._gate = chi_square_gate(gate_share, 2)
        self._sighting = Sighting(
            detection, clutter_m2, birth_m2, lifetime_s, visible_s, hidden_s, score_weight
        )
        self._confirm, self._drop, self._shown_misses = confirm, drop, shown_misses
        self._exact_limit = float(exact_limit)
        self._filter = PlaceFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._next_id = 0
        self._followed = self._opened(Detections.empty(0.0), np.empty(0))

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        targets, tracks = tick.targets, self._followed.tracks
        tracks = tracks.moved_on(self._filter.predicted(tracks.beliefs, tick.period_s))
        existence = self._sighting.moved_on(self._followed.existence, tick.period_s)
        beta = self._marginals(tracks, existence, targets)
        unclaimed = np.clip(1 - beta.sum(axis=0), 0, 1)
        existence = self._existence_after(existence, beta)
        shares = beta / existence.there[:, None]
        beliefs = merged(self._filter, tracks.beliefs, targets.centres[:, :2], shares)
        rows, columns = likeliest(beta, unclaimed)
        tracks = replace(tracks, beliefs=beliefs)
        tracks = tracks.seen(rows, targets.select(columns), beliefs.select(rows))
        new = np.setdiff1d(np.arange(len(targets)), columns)
        opened = self._opened(targets.select(new), unclaimed[new])
        self._followed = self._managed(Followed(tracks, existence, self._followed.confirmed))
        self._followed = self._followed.joined(opened)
        return self._report(tick)

    def _marginals(
        self, tracks: Tracklets, existence: Existence, targets: Detections
    ) -> np.ndarray:
        """Return (N, M) beta; weights are divided by those of detections without a track."""
        S = self._filter.expected(tracks.beliefs)
        distances = gated_distances(tracks.places, S, targets.centres[:, :2], self._gate)
        distances = barred(distances, same_family(tracks.categories, targets.categories))
        densities = np.exp(-distances / 2) / (2 * np.pi * np.sqrt(np.linalg.det(S)))[:, None]
        known = self._sighting
        pairs = densities * (existence.visible * known.detection)[:, None]
        missed = 1 - existence.visible * known.detection
        ones = np.ones(len(targets))
        return association_marginals(
            pairs * known.gains(targets.scores), missed, ones, self._exact_limit
        )

    def _existence_after(self, existence: Existence, beta: np.ndarray) -> Existence:
        """Mix over the events: any detection proves existence, none leaves doubt."""
        seen = np.clip(beta.sum(axis=1), 0, 1)
        missed = existence.missed(self._sighting.detection)
        return Existence(seen + (1 - seen) * missed.visible, (1 - seen) * missed.hidden)

    def _managed(self, followed: Followed) -> Followed:
        confirmed = followed.confirmed | (followed.existence.there >= self._confirm)
        kept = followed.existence.there >= self._drop
        return replace(followed, confirmed=confirmed).select(kept)

    def _opened(self, targets: Detections, unclaimed: np.ndarray) -> Followed:
        """Begin with detections that are, with these probabilities, of no track."""
        there = unclaimed * self._sighting.new_shares(targets.scores)
        opened = Tracklets.opened(self._next_id, targets, self._filter.started(targets))
        self._next_id += len(targets)
        return self._managed(Followed(opened, Existence.first(there), np.zeros(len(there), bool)))

    def _report(self, tick: Tick) -> Tracks:
        followed = self._followed
        tracks = replace(followed.tracks, scores=np.clip(followed.existence.there, 0, 1))
        states = np.where(tracks.misses > 0, TrackState.COASTING, TrackState.CONFIRMED)
        states[~followed.confirmed | (tracks.misses > self._shown_misses)] = TrackState.TENTATIVE
        planar = self._filter.planar(tracks.beliefs)
        return tracks.report(planar, states.astype(np.int8), tick.frame, tick.stamp_s)


def merged(
    kalman: PlaceFilter, beliefs: Gaussians, places: np.ndarray, shares: np.ndarray
) -> Gaussians:
    """Return the Gaussian with mean and covariance of each track's mixture.

    shares: (N, M) probabilities, given that the track exists, that it has each of (M, 2) places;
        what they lack to 1 leaves the track where it was predicted.
    """
    rows, columns = np.nonzero(shares)
    weights = shares[rows, columns]
    residuals = places[columns] - beliefs.means[rows, :2]
    n = len(beliefs)
    mean = _sums(rows, weights[:, None] * residuals, n)
    squares = residuals[:, :, None] * residuals[:, None, :] * weights[:, None, None]
    spread = _sums(rows, squares.reshape(-1, 4), n).reshape(-1, 2, 2)
    spread -= mean[:, :, None] * mean[:, None, :]
    innovation = innovations(beliefs, beliefs.means[:, :2] + mean, kalman.H, kalman.R)
    after = updated(beliefs, innovation, kalman.H, kalman.R)
    seen = np.bincount(rows, weights, n)[:, None, None]
    K = innovation.gains
    covariances = seen * after.covariances + (1 - seen) * beliefs.covariances
    covariances += K @ spread @ K.transpose(0, 2, 1)
    return Gaussians(after.means, 0.5 * (covariances + covariances.transpose(0, 2, 1)))


def _sums(rows: np.ndarray, values: np.ndarray, n: int) -> np.ndarray:
    """Return (n, K) sums of (P, K) values by row."""
    return np.column_stack([np.bincount(rows, column, n) for column in values.T])


def likeliest(beta: np.ndarray, unclaimed: np.ndarray) -> Pairs:
    """Pair tracks and detections one to one for the greatest sum of marginals.

    beta: (N, M); unclaimed: (M,) probabilities that a detection is of no track, which a pair must
    exceed.
    """
    costs = unclaimed - beta
    return assign_optimally(barred(costs, beta > 0), 0.0)
