"""Models of targets, which appear, hide and leave, and of their detections; for JPDA and PMBM.

The state of a target is a Markov chain: it exists and is visible, exists and is hidden, or does not
exist (Markov chain two of Musicki and Evans 2004). If a hidden target is not detected, this is no
evidence against its existence.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from roadscope.core import Category
from roadscope.core.arguments import check_counts, check_not_negative, check_positive, check_shares
from roadscope.core.tables import ArrayTable
from roadscope.trackers._motion import ConstantVelocity, PositionFilter
from roadscope.trackers._ticks import TrackerTick
from roadscope.trackers._traits import DetectorTraits, TraitsChoice, score_log_odds

EXTREME_SCORE = 0.98
"""Scores are clipped to this, and to one minus this; chosen by hand."""
FIRST_CLUTTER_M2 = 1e-4
"""Clutter density before anything was detected, per square metre and tick; chosen by hand."""
FIRST_CLUTTER_WEIGHT_M2 = 2e4
"""Weight of this density in the estimate, as area times ticks: that of two false detections."""
CELL_M = 10.0
"""Side of the grid cells around the ego that `ClutterDensity` counts; chosen by hand."""
BASE_RATE_RANGE_M = 25.0
"""Range at which the base rate of right detections is taken; chosen by hand."""


@dataclass(frozen=True, slots=True, eq=False)
class Existence(ArrayTable):
    """Probabilities of existence of N targets.

    visible, hidden: (N,) probabilities that they exist and are visible, or exist and are hidden.
    """

    visible: np.ndarray
    hidden: np.ndarray

    def __len__(self) -> int:
        return len(self.visible)

    @staticmethod
    def of_detected(probability: np.ndarray) -> Existence:
        """Return (N,) targets that are visible if they exist: they have just been detected."""
        return Existence(probability, np.zeros_like(probability))

    @property
    def probability(self) -> np.ndarray:
        """(N,) probabilities of existence."""
        total: np.ndarray = self.visible + self.hidden
        return total

    def after_miss(self, detection: float) -> Existence:
        """Return existence after a tick without a detection.

        detection: probability that a visible target is detected.
        """
        missed = 1 - self.visible * detection
        return Existence(self.visible * (1 - detection) / missed, self.hidden / missed)


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionModel:
    """How targets appear, hide and leave, and how often detectors err.

    detection: probability that a visible target is detected.
    clutter_m2: false detections per square metre and tick.
    birth_m2: new targets per square metre and tick.
    lifetime_s: mean time that a target stays in range.
    visible_s, hidden_s: mean times for which it is visible, and for which it is hidden.
    score_weight: how much scores count: 1 takes them as probabilities that a detection is of a
        target, 0 ignores them.
    """

    detection: float = 0.9
    clutter_m2: float = FIRST_CLUTTER_M2
    birth_m2: float = 1e-5
    lifetime_s: float = 30.0
    visible_s: float = 10.0
    hidden_s: float = 1.0
    score_weight: float = 1.0

    def __post_init__(self) -> None:
        check_shares(detection=self.detection)
        if self.detection in (0, 1):
            raise ValueError(f"detection must lie between 0 and 1, got {self.detection!r}")
        check_positive(
            clutter_m2=self.clutter_m2,
            birth_m2=self.birth_m2,
            lifetime_s=self.lifetime_s,
            visible_s=self.visible_s,
            hidden_s=self.hidden_s,
        )
        check_not_negative(score_weight=self.score_weight)

    def predicted(self, existence: Existence, dt: float) -> Existence:
        """Return existence after dt seconds of the Markov chain in continuous time."""
        hide_rate, show_rate = 1 / self.visible_s, 1 / self.hidden_s
        survival = np.exp(-dt / self.lifetime_s)
        settled = np.exp(-(hide_rate + show_rate) * dt)
        visible = existence.probability * show_rate / (hide_rate + show_rate)
        visible = visible + (existence.visible - visible) * settled
        return Existence(survival * visible, survival * (existence.probability - visible))

    def score_ratios(self, scores: np.ndarray) -> np.ndarray:
        """Return (M,) likelihood ratios of scores, target to clutter.

        Amplitude information (Lerro and Bar-Shalom 1993). For scores that are probabilities where
        targets and clutter are equally frequent the ratio is s / (1 - s).
        """
        s = np.clip(scores, 1 - EXTREME_SCORE, EXTREME_SCORE)
        ratios: np.ndarray = (s / (1 - s)) ** self.score_weight
        return ratios

    def association_gains(self, scores: np.ndarray) -> np.ndarray:
        """Return (M,) ratios, m2, of the weights of known targets to those of clutter or new ones.

        They are to be multiplied by the probability density, 1/m2, of the detected position.
        """
        ratios = self.score_ratios(scores)
        gains: np.ndarray = ratios / (self.clutter_m2 + self.birth_m2 * self.detection * ratios)
        return gains

    def birth_probabilities(self, scores: np.ndarray) -> np.ndarray:
        """Return (M,) probabilities that detections of no known target are of a new one."""
        births = self.birth_m2 * self.detection * self.score_ratios(scores)
        probabilities: np.ndarray = births / (births + self.clutter_m2)
        return probabilities

    def drop_threshold(self, drop: float) -> float:
        """Return the probability of existence below which a target is dropped: `drop` or less.

        Where clutter is dense, even a target that was just detected may be less likely than `drop`.
        """
        return min(drop, float(self.birth_probabilities(np.array([0.5]))[0]))


@dataclass(slots=True)
class ClutterDensity:
    """The density of false detections, those that never became a confirmed track.

    A sensor covers only a part of its surroundings, so the area is that of all grid cells around
    the ego with any detection so far.

    count: false detections so far. area_m2: sum over ticks of the area. cells: these cells.
    """

    count: float = 0.0
    area_m2: float = 0.0
    cells: set[tuple[int, int]] = field(default_factory=set)

    @property
    def density_m2(self) -> float:
        """False detections per square metre and tick."""
        count = self.count + FIRST_CLUTTER_M2 * FIRST_CLUTTER_WEIGHT_M2
        return count / (self.area_m2 + FIRST_CLUTTER_WEIGHT_M2)

    def add_area(self, tick: TrackerTick) -> None:
        """Count the area in which there was a detection, now or before."""
        positions = tick.detections.centres
        if tick.world_from_ego is not None:
            positions = tick.world_from_ego.inverse().apply(positions)
        cells = np.floor(positions[:, :2] / CELL_M).astype(np.int64)
        self.cells.update(map(tuple, cells.tolist()))
        self.area_m2 += len(self.cells) * CELL_M**2

    def add_false_detections(self, count: int) -> None:
        """Count detections, of this tick or earlier, that are taken for clutter."""
        self.count += count


class ScoreCalibration:
    """Probabilities that detections are right, from their scores and the traits of the detector.

    Traits give probabilities for the share of right detections in training. Here they are converted
    to those for equal numbers of right and false detections.
    """

    def __init__(self, traits: str) -> None:
        """Take a name, a file or `auto`, see `TraitsChoice`."""
        self._choice = TraitsChoice(traits)
        self.reset()

    def reset(self) -> None:
        """Forget all scores."""
        self._choice.reset()
        self._traits: DetectorTraits | None = None
        self._base_log_odds = np.zeros(len(Category))

    def probabilities(self, tick: TrackerTick) -> np.ndarray:
        """Return (M,) probabilities that detections are right if half of them are."""
        odds, categories = score_log_odds(tick.detections.scores), tick.detections.categories
        traits = self._choice.update(odds, categories)
        if traits is not self._traits:
            self._traits = traits
            self._base_log_odds = self._choice.base_log_odds(BASE_RATE_RANGE_M)
        ranges_m = np.hypot(*(tick.detections.centres[:, :2] - tick.sensor_position[:2]).T)
        odds = (
            traits.detection_log_odds(odds, categories, ranges_m) - self._base_log_odds[categories]
        )
        probabilities: np.ndarray = 1 / (1 + np.exp(-odds))
        return probabilities


@dataclass(frozen=True, slots=True, kw_only=True)
class BernoulliSettings:
    """Settings that the trackers JPDA and PMBM share.

    gate_share: share of right pairs that lie within the gate if the noise is as assumed.
    detection, birth_m2, lifetime_s, visible_s, hidden_s, score_weight: see `DetectionModel`.
    clutter_m2: false detections per square metre and tick; None estimates it while tracking.
    traits: what scores mean, see `ExistenceTracker`; but here scores of unknown detectors always
        are probabilities, also with `unscaled`.
    confirm, drop: probability of existence from which on a track is confirmed, and probability
        below which it is dropped or not started.
    shown_misses: see `LifeCycle`.
    position_m, speed_m_s: see `PositionFilter`.
    velocity_walk: see `ConstantVelocity`.
    """

    gate_share: float = 0.997
    detection: float = 0.9
    clutter_m2: float | None = None
    birth_m2: float = 1e-5
    lifetime_s: float = 30.0
    visible_s: float = 10.0
    hidden_s: float = 1.0
    score_weight: float = 1.0
    traits: str = "auto"
    confirm: float = 0.99
    drop: float = 0.02
    shown_misses: int = 0
    position_m: float = 0.3
    speed_m_s: float = 15.0
    velocity_walk: float = 2.0

    def __post_init__(self) -> None:
        check_shares(confirm=self.confirm, drop=self.drop)
        check_counts(0, shown_misses=self.shown_misses)
        check_not_negative(velocity_walk=self.velocity_walk)

    def detection_model(self) -> AdaptiveModel:
        """Return the model of targets and detections."""
        model = DetectionModel(
            detection=self.detection,
            birth_m2=self.birth_m2,
            lifetime_s=self.lifetime_s,
            visible_s=self.visible_s,
            hidden_s=self.hidden_s,
            score_weight=self.score_weight,
        )
        return AdaptiveModel(model, self.clutter_m2)

    def position_filter(self) -> PositionFilter:
        """Return the filter of positions."""
        motion = ConstantVelocity(self.velocity_walk)
        return PositionFilter(self.position_m, self.speed_m_s, motion)


class AdaptiveModel:
    """A detection model whose clutter density is estimated while tracking, unless it is known."""

    def __init__(self, model: DetectionModel, clutter_m2: float | None) -> None:
        """Take the model; clutter_m2: the density, or None to estimate it."""
        self._estimates_clutter = clutter_m2 is None
        self._first = model if clutter_m2 is None else replace(model, clutter_m2=clutter_m2)
        self.reset()

    def reset(self) -> None:
        """Forget all detections."""
        self.clutter = ClutterDensity()
        self.current = self._first

    def update(self, tick: TrackerTick) -> DetectionModel:
        """Take the detections of a tick and return the model to use for them."""
        self.clutter.add_area(tick)
        if self._estimates_clutter:
            self.current = replace(self.current, clutter_m2=self.clutter.density_m2)
        return self.current
