"""Joint integrated probabilistic data association: JIPDA (Musicki and Evans 2004)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.jit import compiled
from roadscope.trackers.assignment import Pairs, assign_optimally, left_over
from roadscope.trackers.clutter import FIRST_M2, Clutter, Scores
from roadscope.trackers.gating import (
    Candidates,
    candidates_by_likelihood,
    chi_square_gate,
    determinants,
)
from roadscope.trackers.jpda_existence import Existence, Sighting
from roadscope.trackers.jpda_marginals import EXACT_LIMIT, association_marginals
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.life_cycle import told_states
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

    weighed = True

    def __init__(
        self,
        *,
        gate_share: float = 0.997,
        detection: float = 0.9,
        clutter_m2: float | None = None,
        birth_m2: float = 1e-5,
        lifetime_s: float = 30.0,
        visible_s: float = 10.0,
        hidden_s: float = 1.0,
        score_weight: float = 1.0,
        traits: str = "auto",
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
            `Sighting`; clutter_m2 None: counted while tracking.
        traits: what scores mean, see `ExistenceTracker`.
        confirm, drop: probabilities of existence from which a track is confirmed, and below which
            one is dropped or not even begun.
        shown_misses: ticks without a detection in which a track is still answered for.
        exact_limit: see `jpda_marginals`.
        position_m, speed_m_s: see `PlaceFilter`.
        velocity_walk: m/s per root second, by which velocities wander.
        """
        check_shares(confirm=confirm, drop=drop)
        check_counts(0, shown_misses=shown_misses)
        check_not_negative(velocity_walk=velocity_walk)
        self._gate = chi_square_gate(gate_share, 2)
        self._counts, first_m2 = clutter_m2 is None, FIRST_M2 if clutter_m2 is None else clutter_m2
        self._sighting = Sighting(
            detection, first_m2, birth_m2, lifetime_s, visible_s, hidden_s, score_weight
        )
        self._least, self._scores = drop, Scores(traits)
        self._confirm, self._shown_misses = confirm, shown_misses
        self._exact_limit = float(exact_limit)
        self._filter = PlaceFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._next_id = 0
        self._clutter = Clutter()
        self._scores.reset()
        self._followed = self._opened(Detections.empty(0.0), np.empty(0))

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        self._clutter.seen(tick)
        if self._counts:
            self._sighting = replace(self._sighting, clutter_m2=self._clutter.density_m2)
        targets, tracks, shares = tick.targets, self._followed.tracks, self._scores.shares(tick)
        tracks = tracks.moved_on(self._filter.predicted(tracks.beliefs, tick.period_s))
        existence = self._sighting.moved_on(self._followed.existence, tick.period_s)
        near = self._marginals(tracks, existence, targets, shares)
        unclaimed = np.clip(1 - np.bincount(near.columns, near.costs, len(targets)), 0, 1)
        existence = self._existence_after(existence, near)
        given = near.costing(near.costs / existence.there[near.rows])
        beliefs = merged(tracks.beliefs, targets.centres[:, :2], given, self._filter.R)
        rows, columns = likeliest(near, unclaimed)
        tracks = replace(tracks, beliefs=beliefs)
        tracks = tracks.seen(rows, targets.select(columns), beliefs.select(rows))
        new = left_over(len(targets), columns)
        opened = self._opened(targets.select(new), unclaimed[new] * self._new(shares[new]))
        self._clutter.lost(len(new) - len(opened.confirmed))
        self._followed = self._managed(Followed(tracks, existence, self._followed.confirmed))
        self._followed = self._followed.joined(opened)
        return self._report(tick)

    def _marginals(
        self, tracks: Tracklets, existence: Existence, targets: Detections, shares: np.ndarray
    ) -> Candidates:
        """Return pairs with beta for costs; weights are divided by those of free detections."""
        S = self._filter.expected(tracks.beliefs)
        near = candidates_by_likelihood(tracks.places, S, targets.centres[:, :2], self._gate)
        near = near.within_families(tracks.categories, targets.categories)
        found = existence.visible * self._sighting.detection
        highest = found / (2 * np.pi * np.sqrt(determinants(S)))
        gains = self._sighting.gains(shares)
        weights = np.exp(-near.costs / 2) * highest[near.rows] * gains[near.columns]
        alone = 1 - found, np.ones(len(targets))
        return near.costing(
            association_marginals(near.rows, near.columns, weights, alone, self._exact_limit)
        )

    def _existence_after(self, existence: Existence, near: Candidates) -> Existence:
        """Mix over the events: any detection proves existence, none leaves doubt."""
        seen = np.clip(np.bincount(near.rows, near.costs, len(existence)), 0, 1)
        missed = existence.missed(self._sighting.detection)
        return Existence(seen + (1 - seen) * missed.visible, (1 - seen) * missed.hidden)

    def _managed(self, followed: Followed) -> Followed:
        confirmed = followed.confirmed | (followed.existence.there >= self._confirm)
        kept = followed.existence.there >= self._drop
        self._clutter.lost(int(followed.tracks.hits[~kept & ~confirmed].sum()))
        return replace(followed, confirmed=confirmed).select(kept)

    @property
    def _drop(self) -> float:
        """Where clutter is dense even a target just seen is less likely than it should be."""
        return min(self._least, float(self._new(np.array([0.5]))[0]))

    def _new(self, shares: np.ndarray) -> np.ndarray:
        return self._sighting.new_shares(shares)

    def _opened(self, targets: Detections, there: np.ndarray) -> Followed:
        """Begin with detections that are, with these probabilities, of new targets."""
        tracks = Tracklets.opened(self._next_id, targets, self._filter.started(targets))
        self._next_id += len(targets)
        opened = Followed(tracks, Existence.first(there), there >= self._confirm)
        return opened.select(there >= self._drop)

    def _report(self, tick: Tick) -> Tracks:
        followed = self._followed
        tracks = replace(followed.tracks, scores=np.clip(followed.existence.there, 0, 1))
        states = told_states(followed.confirmed, tracks.misses, self._shown_misses)
        planar = self._filter.planar(tracks.beliefs)
        return tracks.report(planar, states, tick.frame, tick.stamp_s)


def merged(beliefs: Gaussians, places: np.ndarray, near: Candidates, R: np.ndarray) -> Gaussians:
    """Return the Gaussian with mean and covariance of each track's mixture.

    near: pairs of tracks and (M, 2) places with probabilities for costs, given that the track
    exists; what they lack to 1 leaves the track where it was predicted. R: of a place.
    """
    shown = places[near.columns] - beliefs.means[near.rows, :2]
    return Gaussians(
        *_merged(beliefs.means, beliefs.covariances, near.rows, (shown, near.costs), R)
    )


@compiled()
def _merged(
    means: np.ndarray,
    covariances: np.ndarray,
    rows: np.ndarray,
    shown: tuple[np.ndarray, np.ndarray],
    R: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return means and covariances.

    shown: (P, 2) residuals and (P,) probabilities. The covariance changes by K (spread of the
    residuals - their probability S) K'.
    """
    after, spread = means.copy(), covariances.copy()
    residuals, weights = shown
    k, D = 0, means.shape[1]
    K = np.empty((D, 2))
    for n in range(len(means)):
        seen, x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        while k < len(rows) and rows[k] == n:
            w, dx, dy = weights[k], residuals[k, 0], residuals[k, 1]
            seen, x, y = seen + w, x + w * dx, y + w * dy
            xx, xy, yy = xx + w * dx * dx, xy + w * dx * dy, yy + w * dy * dy
            k += 1
        P = covariances[n]
        a, b, c = P[0, 0] + R[0, 0], P[0, 1] + R[0, 1], P[1, 1] + R[1, 1]
        xx, xy, yy = xx - x * x - seen * a, xy - x * y - seen * b, yy - y * y - seen * c
        determinant = a * c - b * b
        for i in range(D):
            K[i, 0] = (c * P[i, 0] - b * P[i, 1]) / determinant
            K[i, 1] = (a * P[i, 1] - b * P[i, 0]) / determinant
            after[n, i] += K[i, 0] * x + K[i, 1] * y
            for j in range(i + 1):
                change = K[i, 0] * (xx * K[j, 0] + xy * K[j, 1])
                change += K[i, 1] * (xy * K[j, 0] + yy * K[j, 1])
                spread[n, i, j] += change
                spread[n, j, i] = spread[n, i, j]
    return after, spread


def likeliest(near: Candidates, unclaimed: np.ndarray) -> Pairs:
    """Pair tracks and detections one to one for the greatest sum of marginals.

    near: with marginals for costs; unclaimed: (M,) probabilities that a detection is of no track,
    which a pair must exceed.
    """
    return assign_optimally(near.costing(unclaimed[near.columns] - near.costs), 0.0)
