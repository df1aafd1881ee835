"""Trackers made of Stone Soup's parts: global nearest neighbour and joint data association."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from roadscope.core import Detections, Family, Requirement
from roadscope.core.arguments import check_not_negative, check_positive, check_shares
from roadscope.trackers._gating import chi_square_gate
from roadscope.trackers._motion import RELATIVE_SPEEDS
from roadscope.trackers._peers.adapter import LibraryTrack, TrackerAdapter
from roadscope.trackers._tracklets import LifeCycle

STONE_SOUP = Requirement("stonesoup", "pip install roadscope[peers]")


class StoneSoupGnnTracker(TrackerAdapter):
    """Stone Soup's `GNNWith2DAssignment` by Mahalanobis distance, with its Kalman filter."""

    requires: ClassVar = STONE_SOUP

    def __init__(
        self,
        *,
        gate_share: float = 0.997,
        confirm_hits: int = 3,
        coast_frames: int = 10,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        gate_share: share of right pairs that lie within the gate if the noise is as assumed.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`; Stone Soup leaves them to the
            user.
        position_m, speed_m_s, velocity_walk: see `StoneSoupNoise`.
        """
        if not 0 < gate_share < 1:
            raise ValueError(f"gate_share must lie between 0 and 1, got {gate_share!r}")
        noise = StoneSoupNoise(position_m, speed_m_s, velocity_walk)
        life = LifeCycle(confirm_hits, coast_frames)
        gate = float(np.sqrt(chi_square_gate(gate_share, 2)))
        super().__init__(
            lambda family: StoneSoup(
                NearestAssociation(StoneSoupFilter(noise, family), gate), life
            ),
            shown_misses,
        )


class StoneSoupJpdaTracker(TrackerAdapter):
    """Stone Soup's `JPDAwithEHM2` (Horridge 2006), the fastest of its exact associators.

    Stone Soup leaves to the user how tracks start and end. Here a detection starts a track if
    it more likely than not belongs to none, and a track has a detection if that is likelier than
    none.
    """

    requires: ClassVar = STONE_SOUP

    def __init__(
        self,
        *,
        gate_share: float = 0.997,
        detection: float = 0.9,
        clutter_m2: float = 1e-4,
        confirm_hits: int = 3,
        coast_frames: int = 10,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        gate_share: share of right pairs that lie within the gate if the noise is as assumed.
        detection: probability that a target is detected.
        clutter_m2: false detections per square metre.
        confirm_hits, coast_frames, shown_misses: see `LifeCycle`.
        position_m, speed_m_s, velocity_walk: see `StoneSoupNoise`.
        """
        if not 0 < gate_share < 1:
            raise ValueError(f"gate_share must lie between 0 and 1, got {gate_share!r}")
        check_shares(detection=detection)
        check_positive(clutter_m2=clutter_m2)
        noise = StoneSoupNoise(position_m, speed_m_s, velocity_walk)
        life = LifeCycle(confirm_hits, coast_frames)
        shares = {"prob_detect": detection, "prob_gate": gate_share}
        super().__init__(
            lambda family: StoneSoup(
                JointAssociation(
                    StoneSoupFilter(noise, family), clutter_spatial_density=clutter_m2, **shares
                ),
                life,
            ),
            shown_misses,
        )


MAPPING = (0, 2)
"""Components x and y of the state x, vx, y, vy."""
PLANAR_ORDER = [0, 2, 1, 3]
"""Components x, y, vx, vy of it."""


@dataclass(frozen=True, slots=True)
class StoneSoupNoise:
    """The noise of a tracker.

    position_m: standard deviation of a detection along each axis.
    speed_m_s: standard deviation of the velocity of a new vehicle along each axis; that of others
        is smaller by `RELATIVE_SPEEDS`.
    velocity_walk: m/s per root second, of velocities.
    """

    position_m: float
    speed_m_s: float
    velocity_walk: float

    def __post_init__(self) -> None:
        check_positive(position_m=self.position_m, speed_m_s=self.speed_m_s)
        check_not_negative(velocity_walk=self.velocity_walk)


class StoneSoupFilter:
    """Stone Soup's Kalman filter of x, vx, y, vy."""

    def __init__(self, noise: StoneSoupNoise, family: Family) -> None:
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
        speed_m_s = noise.speed_m_s * RELATIVE_SPEEDS[family]
        self._first_covariance = (
            np.diag([noise.position_m, speed_m_s, noise.position_m, speed_m_s]) ** 2
        )

    def started(self, detection: Any) -> Any:
        """Return a state at rest, with a wide spread, where something was detected."""
        from stonesoup.types.state import GaussianState

        x, y = detection.state_vector[:, 0]
        return GaussianState([x, 0, y, 0], self._first_covariance, timestamp=detection.timestamp)


class Associated(NamedTuple):
    """What an association of tracks and detections returns.

    states: of each track.
    detections: of each track the row of its detection, -1 for none.
    free: (M,) bool, which detections start new tracks.
    """

    states: list[Any]
    detections: list[int]
    free: np.ndarray


class Association(Protocol):
    """How tracks get their detections."""

    filter: StoneSoupFilter

    def associate(
        self, tracks: Sequence[Any], detections: Sequence[Any], now: datetime
    ) -> Associated:
        """Return the states of tracks after the detections of a tick."""


class NearestAssociation:
    """`GNNWith2DAssignment` by Mahalanobis distances up to a gate."""

    def __init__(self, filter_: StoneSoupFilter, gate: float) -> None:
        from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
        from stonesoup.hypothesiser.distance import DistanceHypothesiser
        from stonesoup.measures import Mahalanobis

        self.filter = filter_
        self._associator = GNNWith2DAssignment(
            DistanceHypothesiser(filter_.predictor, filter_.updater, Mahalanobis(), gate)
        )

    def associate(
        self, tracks: Sequence[Any], detections: Sequence[Any], now: datetime
    ) -> Associated:
        """Return states corrected by at most one detection each."""
        hypotheses = self._associator.associate(tracks, detections, now)
        free = np.ones(len(detections), bool)
        states, rows = [], []
        for track in tracks:
            hypothesis = hypotheses[track]
            if hypothesis:
                row = hypothesis.measurement.metadata["row"]
                free[row] = False
                states.append(self.filter.updater.update(hypothesis))
                rows.append(row)
            else:
                states.append(hypothesis.prediction)
                rows.append(-1)
        return Associated(states, rows, free)


class JointAssociation:
    """`JPDAwithEHM2`; detections with a probability below 1/2 of belonging to a track start one.

    settings: those of `PDAHypothesiser`.
    """

    def __init__(self, filter_: StoneSoupFilter, **settings: float) -> None:
        from stonesoup.dataassociator.probability import JPDAwithEHM2
        from stonesoup.hypothesiser.probability import PDAHypothesiser

        self.filter = filter_
        self._associator = JPDAwithEHM2(
            PDAHypothesiser(filter_.predictor, filter_.updater, **settings)
        )

    def associate(
        self, tracks: Sequence[Any], detections: Sequence[Any], now: datetime
    ) -> Associated:
        """Return states corrected by all detections, with the likeliest one for the box."""
        claimed = np.zeros(len(detections))
        states, likeliest = [], []
        events = self._associator.associate(tracks, detections, now) if tracks else {}
        for track in tracks:
            hypotheses = events[track]
            probabilities = np.array([float(each.probability) for each in hypotheses])
            rows = np.array(
                [each.measurement.metadata["row"] if each else -1 for each in hypotheses]
            )
            np.add.at(claimed, rows[rows >= 0], probabilities[rows >= 0])
            states.append(self._mixture_state(hypotheses, probabilities))
            likeliest.append(int(rows[probabilities.argmax()]))
        return Associated(states, likeliest, claimed < 0.5)

    def _mixture_state(self, hypotheses: Sequence[Any], probabilities: np.ndarray) -> Any:
        """Return one Gaussian for all hypotheses of a track."""
        from stonesoup.functions import gm_reduce_single
        from stonesoup.types.array import StateVectors
        from stonesoup.types.state import GaussianState

        updated = [
            self.filter.updater.update(each) if each else each.prediction for each in hypotheses
        ]
        mean, covariance = gm_reduce_single(
            StateVectors([each.state_vector for each in updated]),
            np.stack([each.covar for each in updated], axis=2),
            probabilities,
        )
        return GaussianState(mean, covariance, timestamp=updated[0].timestamp)


@dataclass(slots=True)
class _Target:
    track: Any
    number: int
    detection: int
    hits: int = 1
    misses: int = 0


class StoneSoup:
    """A loop over Stone Soup's parts as a `LibraryTracker`."""

    def __init__(self, association: Association, life_cycle: LifeCycle) -> None:
        self._association, self._life_cycle = association, life_cycle
        self._targets: list[_Target] = []
        self._now = datetime(2000, 1, 1)
        self._started_count = 0

    def follow(self, detections: Detections, period_s: float) -> list[LibraryTrack]:
        """Return all tracks after the detections of a tick."""
        self._now += timedelta(seconds=period_s)
        own = self._detections(detections)
        associated = self._association.associate([t.track for t in self._targets], own, self._now)
        rows = associated.detections
        for target, state, row in zip(self._targets, associated.states, rows, strict=True):
            target.track.append(state)
            target.detection = row
            target.hits += int(row >= 0)
            target.misses = 0 if row >= 0 else target.misses + 1
        self._targets = [t for t in self._targets if self._is_alive(t)]
        self._targets += [
            self._started(each) for each, free in zip(own, associated.free, strict=True) if free
        ]
        return [self._track(target) for target in self._targets]

    def _detections(self, detections: Detections) -> list[Any]:
        from stonesoup.types.detection import Detection

        model = self._association.filter.measured
        return [
            Detection(position, self._now, model, metadata={"row": row})
            for row, position in enumerate(detections.centres[:, :2])
        ]

    def _started(self, detection: Any) -> _Target:
        from stonesoup.types.track import Track

        self._started_count += 1
        started = self._association.filter.started(detection)
        return _Target(Track([started]), self._started_count, detection.metadata["row"])

    def _is_alive(self, target: _Target) -> bool:
        return bool(self._life_cycle.alive(np.array(target.hits), np.array(target.misses)))

    def _track(self, target: _Target) -> LibraryTrack:
        state = target.track.state
        mean = np.asarray(state.state_vector, np.float64)[PLANAR_ORDER, 0]
        covariance = np.asarray(state.covar, np.float64)[np.ix_(PLANAR_ORDER, PLANAR_ORDER)]
        confirmed = target.hits >= self._life_cycle.confirm_hits
        covariance = (covariance + covariance.T) / 2
        return LibraryTrack(target.number, mean, covariance, target.detection, confirmed)
