"""Stone Soup's filter and associations, put together to a tracker of one family."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Protocol

import numpy as np

from roadscope.core import Detections, Family
from roadscope.trackers.life_cycle import LifeCycle, kept
from roadscope.trackers.peers.adapter import Told
from roadscope.trackers.place_filter import SPEED_SHARES
from roadscope.trackers.settings import check_not_negative, check_positive

MAPPING = (0, 2)
"""Where x and y stand in the state x, vx, y, vy."""
PLANAR = [0, 2, 1, 3]
"""x, y, vx, vy of it."""


@dataclass(frozen=True, slots=True)
class Noise:
    """What all of its trackers share.

    position_m: standard deviation of a detection along each axis.
    speed_m_s: standard deviation of a new vehicle's velocity along each axis; others' by
        `SPEED_SHARES`.
    velocity_walk: m/s per root second, by which velocities wander.
    """

    position_m: float
    speed_m_s: float
    velocity_walk: float

    def __post_init__(self) -> None:
        check_positive(position_m=self.position_m, speed_m_s=self.speed_m_s)
        check_not_negative(velocity_walk=self.velocity_walk)


class Filter:
    """Stone Soup's Kalman filter of x, vx, y, vy."""

    def __init__(self, noise: Noise, family: Family) -> None:
        from stonesoup.models.measurement.linear import LinearGaussian
        from stonesoup.models.transition.linear import (
            CombinedLinearGaussianTransitionModel,
            ConstantVelocity,
        )
        from stonesoup.predictor.kalman import KalmanPredictor
        from stonesoup.updater.kalman import KalmanUpdater

        axis = ConstantVelocity(noise.velocity_walk**2)
        self.measured = LinearGaussian(4, MAPPING, noise.position_m**2 * np.eye(2))
        self.predictor = KalmanPredictor(CombinedLinearGaussianTransitionModel([axis, axis]))
        self.updater = KalmanUpdater(self.measured)
        speed_m_s = noise.speed_m_s * SPEED_SHARES[family]
        self._started = np.diag([noise.position_m, speed_m_s, noise.position_m, speed_m_s]) ** 2

    def started(self, detection: Any) -> Any:
        """Begin at rest, more or less, where something was detected."""
        from stonesoup.types.state import GaussianState

        x, y = detection.state_vector[:, 0]
        return GaussianState([x, 0, y, 0], self._started, timestamp=detection.timestamp)


class Association(Protocol):
    """How tracks get their detections."""

    filter: Filter

    def after(
        self, tracks: Sequence[Any], detections: Sequence[Any], now: datetime
    ) -> tuple[list[tuple[Any, int]], np.ndarray]:
        """Return each track's state and the detection it took, and which open new ones."""


class Nearest:
    """`GNNWith2DAssignment` by Mahalanobis distances up to a gate."""

    def __init__(self, filter_: Filter, gate: float) -> None:
        from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
        from stonesoup.hypothesiser.distance import DistanceHypothesiser
        from stonesoup.measures import Mahalanobis

        self.filter = filter_
        self._associator = GNNWith2DAssignment(
            DistanceHypothesiser(filter_.predictor, filter_.updater, Mahalanobis(), gate)
        )

    def after(
        self, tracks: Sequence[Any], detections: Sequence[Any], now: datetime
    ) -> tuple[list[tuple[Any, int]], np.ndarray]:
        """Give every track one detection at most."""
        taken = self._associator.associate(tracks, detections, now)
        free = np.ones(len(detections), bool)
        states: list[tuple[Any, int]] = []
        for track in tracks:
            hypothesis = taken[track]
            if hypothesis:
                row = hypothesis.measurement.metadata["row"]
                free[row] = False
                states.append((self.filter.updater.update(hypothesis), row))
            else:
                states.append((hypothesis.prediction, -1))
        return states, free


class Likeliest:
    """`JPDAwithEHM2`: what no track claims by half opens new ones.

    settings: those of `PDAHypothesiser`.
    """

    def __init__(self, filter_: Filter, **settings: float) -> None:
        from stonesoup.dataassociator.probability import JPDAwithEHM2
        from stonesoup.hypothesiser.probability import PDAHypothesiser

        self.filter = filter_
        self._associator = JPDAwithEHM2(
            PDAHypothesiser(filter_.predictor, filter_.updater, **settings)
        )

    def after(
        self, tracks: Sequence[Any], detections: Sequence[Any], now: datetime
    ) -> tuple[list[tuple[Any, int]], np.ndarray]:
        """Give every track its share of all, and for a box the likeliest."""
        claimed = np.zeros(len(detections))
        states = []
        events = self._associator.associate(tracks, detections, now) if tracks else {}
        for track in tracks:
            hypotheses = events[track]
            chances = np.array([float(each.probability) for each in hypotheses])
            rows = np.array(
                [each.measurement.metadata["row"] if each else -1 for each in hypotheses]
            )
            np.add.at(claimed, rows[rows >= 0], chances[rows >= 0])
            states.append((self._merged(hypotheses, chances), int(rows[chances.argmax()])))
        return states, claimed < 0.5

    def _merged(self, hypotheses: Sequence[Any], chances: np.ndarray) -> Any:
        """Make one Gaussian of a track's hypotheses."""
        from stonesoup.functions import gm_reduce_single
        from stonesoup.types.array import StateVectors
        from stonesoup.types.state import GaussianState

        updated = [
            self.filter.updater.update(each) if each else each.prediction for each in hypotheses
        ]
        mean, covariance = gm_reduce_single(
            StateVectors([each.state_vector for each in updated]),
            np.stack([each.covar for each in updated], axis=2),
            chances,
        )
        return GaussianState(mean, covariance, timestamp=updated[0].timestamp)


@dataclass(slots=True)
class _Target:
    track: Any
    number: int
    row: int
    hits: int = 1
    misses: int = 0


class StoneSoup:
    """A loop over Stone Soup's parts as a library of `Adapter`."""

    def __init__(self, association: Association, life: LifeCycle) -> None:
        self._association, self._life = association, life
        self._targets: list[_Target] = []
        self._now = datetime(2000, 1, 1)
        self._born = 0

    def follow(self, targets: Detections, period_s: float) -> Told:
        """Take the detections of a tick, so long after the last one."""
        self._now += timedelta(seconds=period_s)
        found = self._detections(targets)
        states, free = self._association.after([t.track for t in self._targets], found, self._now)
        for target, (state, row) in zip(self._targets, states, strict=True):
            target.track.append(state)
            target.row = row
            target.hits += int(row >= 0)
            target.misses = 0 if row >= 0 else target.misses + 1
        self._targets = [t for t in self._targets if self._alive(t)]
        self._targets += [
            self._opened(each) for each, is_free in zip(found, free, strict=True) if is_free
        ]
        return Told.of([self._told(target) for target in self._targets])

    def _detections(self, targets: Detections) -> list[Any]:
        from stonesoup.types.detection import Detection

        return [
            Detection(place, self._now, self._association.filter.measured, metadata={"row": row})
            for row, place in enumerate(targets.centres[:, :2])
        ]

    def _opened(self, detection: Any) -> _Target:
        from stonesoup.types.track import Track

        self._born += 1
        started = self._association.filter.started(detection)
        return _Target(Track([started]), self._born, detection.metadata["row"])

    def _alive(self, target: _Target) -> bool:
        life = self._life
        return bool(
            kept(
                np.array(target.hits), np.array(target.misses), confirm_hits=life.confirm_hits,
                coast_frames=life.coast_frames, tentative_frames=life.tentative_frames,
            )
        )  # fmt: skip

    def _told(self, target: _Target) -> tuple[int, np.ndarray, np.ndarray, int, bool]:
        state = target.track.state
        mean = np.asarray(state.state_vector, np.float64)[PLANAR, 0]
        covariance = np.asarray(state.covar, np.float64)[np.ix_(PLANAR, PLANAR)]
        confirmed = target.hits >= self._life.confirm_hits
        return target.number, mean, (covariance + covariance.T) / 2, target.row, confirmed
