"""Joint integrated probabilistic data association: JIPDA (Musicki and Evans 2004)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.jit import compiled
from roadscope.core.tables import ArrayTable
from roadscope.trackers._assignment import Pairs, assign_optimally, unassigned
from roadscope.trackers._detection_model import BernoulliSettings, Existence, ScoreCalibration
from roadscope.trackers._gating import (
    CandidatePairs,
    chi_square_gate,
    determinants,
    pairs_by_likelihood,
)
from roadscope.trackers._jpda_marginals import EXACT_LIMIT, association_marginals
from roadscope.trackers._kalman import Gaussians
from roadscope.trackers._ticks import TrackerTick
from roadscope.trackers._tracklets import Tracklets, track_states


@dataclass(frozen=True, slots=True, kw_only=True)
class JpdaSettings(BernoulliSettings):
    """Settings of the tracker.

    exact_limit, pruned: see `association_marginals`. The others: see `BernoulliSettings`.
    """

    exact_limit: float = EXACT_LIMIT
    pruned: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class JpdaTracks(ArrayTable):
    """N tracks, their probabilities of existence, and (N,) whether they were ever confirmed."""

    tracks: Tracklets
    existence: Existence
    confirmed: np.ndarray


class JpdaTracker:
    """Every track is corrected by all detections in its gate, weighted by their probabilities.

    Probabilities are marginals of joint events, exact up to `exact_limit`. Of joint events with the
    same tracks and the same detections, which differ in the pairs, only the likeliest counts
    (JPDA*, Blom and Bloem 2000). In clusters that are too large for this, such as 10 tracks with 9
    detections, all events count, as in JPDA; the limit is `exact_limit`. Tracks are confirmed and
    dropped by their probability of existence alone, which is also their score.

    The paper does not say how tracks start. Here a detection starts a track unless it is assigned
    to an existing one, see `one_to_one_pairs`.
    """

    weighed = True

    def __init__(self, settings: JpdaSettings = JpdaSettings()) -> None:
        self._model, self._filter = settings.detection_model(), settings.position_filter()
        self._scores = ScoreCalibration(settings.traits)
        self._gate = chi_square_gate(settings.gate_share, 2)
        self._exact_limit, self._pruned = settings.exact_limit, settings.pruned
        self._confirm, self._least = settings.confirm, settings.drop
        self._shown_misses = settings.shown_misses
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: TrackerTick | None = None
        self._next_id = 0
        self._model.reset()
        self._scores.reset()
        self._current = self._started(Detections.empty(0.0), np.empty(0))

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._tick = TrackerTick.after(self._tick, detections, ego_pose)
        model, scores = self._model.update(tick), self._scores.probabilities(tick)
        tracks, detections = self._current.tracks, tick.detections
        tracks = tracks.predicted(self._filter.predicted(tracks.beliefs, tick.period_s))
        existence = model.predicted(self._current.existence, tick.period_s)
        pairs = self._marginals(tracks, existence, detections, scores)
        free = np.clip(1 - np.bincount(pairs.columns, pairs.costs, len(detections)), 0, 1)
        existence = existence_after(existence, pairs, model.detection)
        given_existence = pairs.with_costs(pairs.costs / existence.probability[pairs.rows])
        positions = detections.centres[:, :2]
        beliefs = mixture_moments(tracks.beliefs, positions, given_existence, self._filter.R)
        rows, columns = one_to_one_pairs(pairs, free)
        tracks = replace(tracks, beliefs=beliefs)
        tracks = tracks.updated(rows, detections.select(columns), beliefs.select(rows))
        new = unassigned(len(detections), columns)
        started = self._started(
            detections.select(new), free[new] * model.birth_probabilities(scores[new])
        )
        self._model.clutter.add_false_detections(len(new) - len(started.confirmed))
        survivors = self._managed(JpdaTracks(tracks, existence, self._current.confirmed))
        self._current = survivors.joined(started)
        return self._report(tick)

    def _marginals(
        self, tracks: Tracklets, existence: Existence, detections: Detections, scores: np.ndarray
    ) -> CandidatePairs:
        """Return pairs with their association probabilities (beta) in place of costs.

        All weights are relative to that of a free detection, which is clutter or a new target.
        """
        model = self._model.current
        S = self._filter.innovation_covariances(tracks.beliefs)
        near = pairs_by_likelihood(tracks.positions, S, detections.centres[:, :2], self._gate)
        near = near.within_families(tracks.categories, detections.categories)
        detected = existence.visible * model.detection
        peak_density = detected / (2 * np.pi * np.sqrt(determinants(S)))
        gains = model.association_gains(scores)
        weights = np.exp(-near.costs / 2) * peak_density[near.rows] * gains[near.columns]
        marginals = association_marginals(
            near.rows,
            near.columns,
            weights,
            1 - detected,
            np.ones(len(detections)),
            self._exact_limit,
            self._pruned,
        )
        return near.with_costs(marginals)

    def _managed(self, current: JpdaTracks) -> JpdaTracks:
        """Return the tracks that are not dropped, some of them newly confirmed."""
        probability = current.existence.probability
        confirmed = current.confirmed | (probability >= self._confirm)
        stays = probability >= self._model.current.drop_threshold(self._least)
        false = current.tracks.hits[~stays & ~confirmed].sum()
        self._model.clutter.add_false_detections(int(false))
        return replace(current, confirmed=confirmed).select(stays)

    def _started(self, detections: Detections, probability: np.ndarray) -> JpdaTracks:
        """Return tracks of detections that are, with (M,) probabilities, of new targets."""
        tracks = Tracklets.started(self._next_id, detections, self._filter.started(detections))
        self._next_id += len(detections)
        existence = Existence.of_detected(probability)
        started = JpdaTracks(tracks, existence, probability >= self._confirm)
        return started.select(probability >= self._model.current.drop_threshold(self._least))

    def _report(self, tick: TrackerTick) -> Tracks:
        current = self._current
        scores = np.clip(current.existence.probability, 0, 1)
        tracks = replace(current.tracks, scores=scores)
        return tracks.as_tracks(
            track_states(current.confirmed, tracks.misses, self._shown_misses), tick
        )


def existence_after(existence: Existence, pairs: CandidatePairs, detection: float) -> Existence:
    """Return existence, averaged over the joint events.

    In an event in which a track has a detection its target exists; in the others it was missed.

    pairs: their costs are association probabilities. detection: see `Existence.after_miss`.
    """
    detected = np.clip(np.bincount(pairs.rows, pairs.costs, len(existence)), 0, 1)
    missed = existence.after_miss(detection)
    return Existence(detected + (1 - detected) * missed.visible, (1 - detected) * missed.hidden)


def mixture_moments(
    beliefs: Gaussians, positions: np.ndarray, pairs: CandidatePairs, R: np.ndarray
) -> Gaussians:
    """Return mean and covariance of each track's mixture over its detections.

    pairs: of tracks and (M, 2) positions; their costs are association probabilities, given that
        the track exists. The prediction has the weight 1 minus their sum.
    R: (2, 2) covariance of a measured position.
    """
    residuals = positions[pairs.columns] - beliefs.means[pairs.rows, :2]
    return Gaussians(
        *_mixture_moments(beliefs.means, beliefs.covariances, pairs.rows, residuals, pairs.costs, R)
    )


@compiled()
def _mixture_moments(
    means: np.ndarray,
    covariances: np.ndarray,
    rows: np.ndarray,
    residuals: np.ndarray,
    probabilities: np.ndarray,
    R: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return means and covariances of the mixtures.

    The covariance changes by K (spread of the residuals - their total probability * S) K'.

    rows, residuals, probabilities: (P,), (P, 2), (P,) of pairs, sorted by row.
    """
    after, spread = means.copy(), covariances.copy()
    k, D = 0, means.shape[1]
    K = np.empty((D, 2))
    for n in range(len(means)):
        total, x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        while k < len(rows) and rows[k] == n:
            w, dx, dy = probabilities[k], residuals[k, 0], residuals[k, 1]
            total, x, y = total + w, x + w * dx, y + w * dy
            xx, xy, yy = xx + w * dx * dx, xy + w * dx * dy, yy + w * dy * dy
            k += 1
        P = covariances[n]
        a, b, c = P[0, 0] + R[0, 0], P[0, 1] + R[0, 1], P[1, 1] + R[1, 1]
        xx, xy, yy = xx - x * x - total * a, xy - x * y - total * b, yy - y * y - total * c
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


def one_to_one_pairs(pairs: CandidatePairs, free: np.ndarray) -> Pairs:
    """Return the one-to-one pairs of tracks and detections of greatest total probability.

    It is the sum of marginal probabilities, minus the probabilities that the detections are of no
    track; each pair must be more probable than that.

    pairs: their costs are marginal probabilities. free: (M,) probabilities that a detection is of
        no track.
    """
    return assign_optimally(pairs.with_costs(free[pairs.columns] - pairs.costs), 0.0)
