"""Interacting multiple models of motion (IMM, Blom and Bar-Shalom 1988)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.arguments import check_not_negative, check_positive, check_shares
from roadscope.core.jit import compiled
from roadscope.core.tables import ArrayTable
from roadscope.trackers._assignment import unassigned
from roadscope.trackers._gating import chi_square_gate
from roadscope.trackers._gnn import likeliest_pairs
from roadscope.trackers._kalman import Gaussians, corrected_with_likelihood
from roadscope.trackers._motion import (
    PLANAR,
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    PositionFilter,
)
from roadscope.trackers._ticks import TrackerTick
from roadscope.trackers._tracklets import LifeCycle, Tracklets


@dataclass(frozen=True, slots=True, eq=False)
class Modes(ArrayTable):
    """The states of N tracks under three motion models.

    velocity, acceleration, turn: estimates of each model, given that it is right.
    probabilities: (N, 3) that it is.
    """

    velocity: Gaussians
    acceleration: Gaussians
    turn: Gaussians
    probabilities: np.ndarray

    def __len__(self) -> int:
        return len(self.probabilities)

    @property
    def parts(self) -> tuple[Gaussians, ...]:
        """The estimates by model, in the order of `probabilities`."""
        return self.velocity, self.acceleration, self.turn

    @property
    def planar(self) -> Gaussians:
        """(3, N, ...) estimates of x, y, vx, vy by model."""
        return Gaussians(
            np.stack([part.means[:, :PLANAR] for part in self.parts]),
            np.stack([part.covariances[:, :PLANAR, :PLANAR] for part in self.parts]),
        )

    @property
    def mixture(self) -> Gaussians:
        """Mean and covariance of x, y, vx, vy over all models."""
        planar = self.planar
        return Gaussians(*_moments(planar.means, planar.covariances, self.probabilities))


@dataclass(frozen=True, slots=True, eq=False)
class ImmTracks(ArrayTable):
    """Tracks, whose beliefs are the mixtures of their modes."""

    tracks: Tracklets
    modes: Modes


class ImmTracker:
    """Constant velocity, constant acceleration and coordinated turn; associates like `GnnTracker`.

    Each detection also tells which model fits, so a track that drives straight on is smooth, and
    one that brakes or turns follows quickly.
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
        velocity_walk: float = 0.5,
        acceleration_walk: float = 2.0,
        turn_walk: float = 0.3,
        sojourn_s: float = 3.0,
    ) -> None:
        """Set the tracker up.

        gate_share: share of right pairs that lie within the gate if the noise is as assumed.
        least_score: detections with a lower score are ignored.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`.
        position_m, speed_m_s: see `PositionFilter`.
        velocity_walk, acceleration_walk, turn_walk: m/s, m/s2 and rad/s per root second, of
            velocities (in turns, too), accelerations and yaw rates.
        sojourn_s: see `ImmFilter`.
        """
        check_shares(least_score=least_score)
        check_not_negative(
            velocity_walk=velocity_walk, acceleration_walk=acceleration_walk, turn_walk=turn_walk
        )
        self._gate, self._least_score = chi_square_gate(gate_share, 2), least_score
        self._life_cycle = LifeCycle(confirm_hits, coast_frames, 0, shown_misses)
        self._R = position_m**2 * np.eye(2)
        velocity, acceleration, turn = (
            PositionFilter(position_m, speed_m_s, motion)
            for motion in (
                ConstantVelocity(velocity_walk),
                ConstantAcceleration(acceleration_walk),
                CoordinatedTurn(velocity_walk, turn_walk),
            )
        )
        self._filter = ImmFilter((velocity, acceleration, turn), sojourn_s)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: TrackerTick | None = None
        self._next_id = 0
        self._current = self._started(Detections.empty(0.0))

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._tick = TrackerTick.after(self._tick, detections, ego_pose)
        detections = tick.detections.select(tick.detections.scores >= self._least_score)
        modes = self._filter.predicted(self._current.modes, tick.period_s)
        tracks = self._current.tracks.predicted(modes.mixture)
        rows, columns = likeliest_pairs(tracks, detections, self._R, self._gate)
        own = detections.select(columns)
        corrected = self._filter.corrected(modes.select(rows), own.centres[:, :2])
        tracks = tracks.updated(rows, own, corrected.mixture)
        alive = self._life_cycle.alive(tracks.hits, tracks.misses)
        survivors = ImmTracks(tracks, modes.replaced(rows, corrected)).select(alive)
        new = detections.select(unassigned(len(detections), columns))
        self._current = survivors.joined(self._started(new))
        tracks = self._current.tracks
        return tracks.as_tracks(self._life_cycle.states(tracks), tick)

    def _started(self, detections: Detections) -> ImmTracks:
        modes = self._filter.started(detections)
        started = Tracklets.started(self._next_id, detections, modes.mixture)
        self._next_id += len(detections)
        return ImmTracks(started, modes)


@dataclass(frozen=True, slots=True)
class ImmFilter:
    """Three filters that mix their estimates before every prediction.

    filters: in the order of `Modes`.
    sojourn_s: mean time for which a track keeps to one model; then it changes to either other.
    """

    filters: tuple[PositionFilter, PositionFilter, PositionFilter]
    sojourn_s: float = 3.0

    def __post_init__(self) -> None:
        check_positive(sojourn_s=self.sojourn_s)

    def started(self, detections: Detections) -> Modes:
        """Return modes of N new tracks, all models equally probable."""
        v, a, t = (each.started(detections) for each in self.filters)
        return Modes(v, a, t, np.full((len(detections), 3), 1 / 3))

    def transition(self, dt: float) -> np.ndarray:
        """Return (3, 3) probabilities of going from one model to another in dt seconds."""
        settled = np.exp(-1.5 * dt / self.sojourn_s)
        chain: np.ndarray = settled * np.eye(3) + (1 - settled) / 3
        return chain

    def predicted(self, modes: Modes, dt: float) -> Modes:
        """Return modes after mixing and a prediction by dt seconds."""
        flow = modes.probabilities[:, :, None] * self.transition(dt)
        probabilities = flow.sum(axis=1)
        mixing = flow / probabilities[:, None]
        planar = modes.planar
        v, a, t = (
            each.predicted(mixed(own, planar, mixing[:, :, j], j), dt)
            for j, (each, own) in enumerate(zip(self.filters, modes.parts, strict=True))
        )
        return Modes(v, a, t, probabilities)

    def corrected(self, modes: Modes, positions: np.ndarray) -> Modes:
        """Return modes after one measured position of each track, (N, 2)."""
        parts, log_likelihoods = [], np.empty_like(modes.probabilities)
        for j, (each, part) in enumerate(zip(self.filters, modes.parts, strict=True)):
            after, log_likelihoods[:, j] = corrected_with_likelihood(
                part, positions, each.H, each.R
            )
            parts.append(after)
        log_likelihoods -= log_likelihoods.max(axis=1, keepdims=True)
        probabilities = modes.probabilities * np.exp(log_likelihoods)
        probabilities = probabilities / probabilities.sum(axis=1, keepdims=True)
        return Modes(parts[0], parts[1], parts[2], probabilities)


def mixed(own: Gaussians, planar: Gaussians, weights: np.ndarray, j: int) -> Gaussians:
    """Return what model j starts from: mean and covariance over all models, by (N, 3) weights.

    own: the estimates of model j. planar: (3, N, ...) those of all models of x, y, vx, vy.
    The other models say nothing of the remaining components of model j. These keep the estimate of
    model j, independent of the other models (Granstrom, Willett and Bar-Shalom 2015).
    """
    means, covariances = own.means.copy(), own.covariances.copy()
    means[:, :PLANAR], covariances[:, :PLANAR, :PLANAR] = _moments(
        planar.means, planar.covariances, np.ascontiguousarray(weights)
    )
    covariances[:, :PLANAR, PLANAR:] *= weights[:, j, None, None]
    covariances[:, PLANAR:, :PLANAR] *= weights[:, j, None, None]
    return Gaussians(means, covariances)


@compiled()
def _moments(
    means: np.ndarray, covariances: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance of N mixtures.

    means: (K, N, D); covariances: (K, N, D, D); weights: (N, K).
    """
    K, N, D = means.shape
    mean, spread = np.zeros((N, D)), np.zeros((N, D, D))
    for n in range(N):
        for k in range(K):
            for a in range(D):
                mean[n, a] += weights[n, k] * means[k, n, a]
        for k in range(K):
            for a in range(D):
                deviation = means[k, n, a] - mean[n, a]
                for b in range(D):
                    square = deviation * (means[k, n, b] - mean[n, b])
                    spread[n, a, b] += weights[n, k] * (covariances[k, n, a, b] + square)
    return mean, spread
