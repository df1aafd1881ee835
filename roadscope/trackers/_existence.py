"""Bernoulli filters with traits of the detector: the recommended tracker."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks, TrackState
from roadscope.core.arguments import check_positive
from roadscope.trackers._assignment import Pairs, assign_optimally, unassigned
from roadscope.trackers._existence_targets import (
    BernoulliTargets,
    Measurements,
    Neighbours,
    expected_velocities,
    hidden_shares,
)
from roadscope.trackers._gating import pairs_by_distance, pairs_that_overlap
from roadscope.trackers._headings import facing_ahead, travel_directions
from roadscope.trackers._kalman import Gaussians
from roadscope.trackers._score_meaning import SETTLED_S, PendingDetections, ScoreMeaning
from roadscope.trackers._ticks import TrackerTick
from roadscope.trackers._traits import (
    SECTION_NUMBER,
    UNSCALED,
    TraitsChoice,
    read_detector,
    score_log_odds,
)

MOST_LOG_ODDS = 9.0
"""Log odds of existence are limited to this, on both sides: those of a score of 0.9999."""
MOST_DISTANCE = 12.0
"""Squared Mahalanobis distances of positions are limited to this; 1 right pair in 400 has more."""
GATE_MARGIN_M = 0.5
"""Added to the distance that the top speed allows between two ticks. Chosen by hand."""
DROP_LOG_ODDS = -4.0
"""A missed target with few detections is dropped if its log odds of existence after the last one
were below this. It only saves work; chosen by hand."""
FEW_VOTES = 2.0
"""A target has few detections while the sum of their scores is below this. Chosen by hand."""


class ExistenceTracker:
    """Reports targets by their log odds of existence; optimal assignment decides identities.

    Every detection raises or lowers the log odds by its score and by its distance from the expected
    position. Every miss lowers them, less so where nearer targets occlude the position. A detection
    where no target was expected is clutter more often than its score says. Clutter of real
    detectors is persistent: a bush is taken for a car in many frames. So the evidence of one frame
    decays with time instead of being added up.
    """

    weighed = True

    def __init__(
        self,
        *,
        traits: str = "auto",
        least_overlap: float = -0.3,
        coast_s: float = 1.5,
        coast_known_s: float = 3.0,
        shown_probability: float = 0.45,
    ) -> None:
        """Set the tracker up; the last four values were chosen by hand, not fitted.

        traits: those of the detector: a name in `roadscope/trackers/learned`, or a .toml file.
            `auto` chooses the known detector whose scores in training are most like those so far,
            or `unknown`, for which scores are probabilities unless detections contradict that. With
            `unscaled` only the order of scores counts.
        least_overlap: a pair must have a higher generalised IoU in space.
        coast_s: time after its last detection for which a target can be detected again.
        coast_known_s: the same, unless `coast_s` is longer, for a target with `KNOWN_HITS`
            detections whose probability of existence was at least `shown_probability`: it may be
            hidden. With 1.5 and 3 s HOTA of three detectors on a validation seed was 0.816 and
            0.820, 0.794 and 0.802, 0.858 and 0.863; with 3 s for all targets clutter was confirmed.
        shown_probability: probability of existence from which on a track is confirmed or coasting.
        """
        check_positive(coast_s=coast_s, coast_known_s=coast_known_s)
        if not -1 <= least_overlap < 1:
            raise ValueError(f"least_overlap must lie in -1 to 1, got {least_overlap!r}")
        if not 0 < shown_probability < 1:
            raise ValueError(
                f"shown_probability must lie between 0 and 1, got {shown_probability!r}"
            )
        self._choice, self._meaning = TraitsChoice(traits), ScoreMeaning()
        self._unscaled = read_detector(UNSCALED).traits
        self._least_overlap = least_overlap
        self._coast_s, self._coast_known_s = coast_s, coast_known_s
        self._shown = float(np.log(shown_probability / (1 - shown_probability)))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: TrackerTick | None = None
        self._next_id = 0
        self._choice.reset()
        self._meaning.reset()
        self._reappearances = Reappearances()
        self._noise = NoiseScale()
        self._traits = self._choice.update(np.empty(0), np.empty(0, np.int8))
        none = Measurements.of(Detections.empty(0.0), np.zeros(2), self._traits)
        self._targets = BernoulliTargets.started(
            np.empty(0, np.int64), none, Gaussians.empty(2), self._traits
        )

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick, tentative ones included."""
        tick = self._tick = TrackerTick.after(self._tick, detections, ego_pose)
        detections, dt, origin = tick.detections, tick.period_s, tick.sensor_position[:2]
        self._traits = self._choice.update(score_log_odds(detections.scores), detections.categories)
        learned = None
        if self._choice.is_unscaled or (
            self._choice.is_unknown and self._meaning.contradicts_scores
        ):
            self._traits = self._unscaled
            learned = self._meaning.probabilities(detections.scores, detections.categories)
        measured = Measurements.of(detections, origin, self._traits, self._noise.factor, learned)
        before = self._targets
        targets = before.predicted(dt, self._traits)
        rows, columns = self._assigned(targets, measured, dt)
        missed = np.ones(len(targets), bool)
        missed[rows] = False
        believed = targets.log_odds(self._traits) > self._shown
        visible = 1 - hidden_shares(targets.boxes, missed, believed, np.ascontiguousarray(origin))
        targets = replace(targets, away_s=targets.away_s + dt * np.where(missed, visible, 0.0))
        targets = targets.replaced(
            rows, self._detected(targets.select(rows), measured.select(columns), dt)
        )
        targets = self._missed(targets, origin)
        self._learn(detections, targets.select(rows), columns)
        survive = self._survive(targets)
        self._reappearances.count(before, targets, ~survive)
        targets = targets if survive.all() else targets.select(survive)
        new = measured.select(unassigned(len(measured), columns))
        neighbours = Neighbours.of(targets, origin, tick.ego_velocity)
        self._targets = targets.joined(self._started(new, neighbours))
        return self._report(tick)

    def _learn(
        self, detections: Detections, targets: BernoulliTargets, columns: np.ndarray
    ) -> None:
        """Learn what scores mean; columns: (N,) the detections of N targets."""
        streaks_s, ids = np.zeros(len(detections)), np.zeros(len(detections), np.int64)
        free = unassigned(len(detections), columns)
        ids[columns], ids[free] = targets.ids, self._next_id + np.arange(len(free))
        streaks_s[columns] = targets.streaks_s
        sections = SECTION_NUMBER[detections.categories]
        settled = streaks_s >= SETTLED_S
        pending = PendingDetections(detections.stamp_s, ids, detections.scores, sections, settled)
        self._meaning.count(pending, streaks_s)

    def _assigned(self, targets: BernoulliTargets, measured: Measurements, dt: float) -> Pairs:
        """Return the pairs of greatest total overlap among those that top speeds allow."""
        categories = targets.categories
        gates_m = (dt * self._traits.top_speed_m_s + GATE_MARGIN_M)[categories]
        positions = targets.beliefs.means[:, :2]
        near = pairs_by_distance(positions, measured.boxes[:, :2], gates_m)
        near = pairs_that_overlap(
            near.within_families(categories, measured.categories),
            targets.boxes,
            measured.boxes,
            overlap="giou",
            least=self._least_overlap,
        )
        return assign_optimally(near, 1 - self._least_overlap)

    def _detected(
        self, targets: BernoulliTargets, own: Measurements, dt: float
    ) -> BernoulliTargets:
        """Return targets after one detection each; log odds of existence tend to its evidence."""
        after, distances = targets.corrected(own, self._traits)
        self._noise.count(targets, distances)
        t, categories = self._traits, own.categories
        misfit = t.misfit[categories] * np.minimum(distances, MOST_DISTANCE)
        evidence = t.score_gain[categories] * own.evidence + t.seen_gain[categories] - misfit
        memory = np.exp(-dt / t.memory_s[categories])
        existence = _limited(memory * targets.existence + (1 - memory) * evidence)
        return replace(after, existence=existence, detected_existence=existence)

    def _missed(self, targets: BernoulliTargets, origin: np.ndarray) -> BernoulliTargets:
        """Return targets, missed ones with the log odds that they existed and are still there."""
        rows = np.flatnonzero(targets.misses)
        t, categories = self._traits, targets.categories[rows]
        offsets = targets.beliefs.means[rows, :2] - origin
        ranges_m = np.hypot(offsets[:, 0], offsets[:, 1])
        away_s = targets.away_s[rows]
        back = t.back[categories] + t.back_per_m[categories] * ranges_m
        back -= t.away_per_s[categories] * away_s
        back += self._reappearances.missed.log_odds_offset(t.returned)[categories]
        existence = targets.existence.copy()
        existence[rows] = _limited(log_odds_of_both(targets.detected_existence[rows], back))
        return replace(targets, existence=existence)

    def _survive(self, targets: BernoulliTargets) -> np.ndarray:
        """Return (N,) bool, False for targets missed for too long and missed ones of low odds."""
        few = targets.votes.sum(axis=1) < FEW_VOTES
        weak = (targets.misses > 0) & few & (targets.detected_existence < DROP_LOG_ODDS)
        known = (targets.hits >= KNOWN_HITS) & (targets.detected_existence > self._shown)
        longest_s = np.where(known, max(self._coast_known_s, self._coast_s), self._coast_s)
        survive: np.ndarray = ~weak & (targets.idle_s <= longest_s)
        return survive

    def _started(self, new: Measurements, neighbours: Neighbours) -> BernoulliTargets:
        ids = self._next_id + np.arange(len(new))
        self._next_id += len(new)
        offset = self._reappearances.new.log_odds_offset(self._traits.born)[new.categories]
        velocities = expected_velocities(new, neighbours, self._traits)
        started = BernoulliTargets.started(ids, new, velocities, self._traits)
        existence = new.evidence + offset
        return replace(started, existence=existence, detected_existence=existence)

    def _report(self, tick: TrackerTick) -> Tracks:
        targets = self._targets
        existence, missed = targets.log_odds(self._traits), np.flatnonzero(targets.misses)
        odds = existence.copy()
        odds[missed] = log_odds_of_both(odds[missed], _position_log_odds(targets, missed))
        believed = odds >= self._shown
        states = np.full(len(targets), TrackState.TENTATIVE, np.int8)
        states[believed] = np.where(
            targets.misses[believed] > 0, TrackState.COASTING, TrackState.CONFIRMED
        )
        beliefs = targets.beliefs
        covariances = beliefs.covariances.copy()
        surplus = self._traits.surplus[targets.categories, None, None]
        covariances[:, :2, :2] = surplus * (covariances[:, :2, :2] + targets.offsets)
        tracks = Tracks(
            ids=targets.ids,
            centres=np.column_stack([beliefs.means[:, :2], targets.heights[:, 0]]),
            sizes=targets.sizes,
            yaws=targets.yaws[:, 0],
            velocities=beliefs.means[:, 2:],
            covariances=covariances,
            categories=targets.categories,
            scores=1 / (1 + np.exp(-existence)),
            states=states,
            frame=tick.frame,
            stamp_s=tick.stamp_s,
        )
        travels = travel_directions(tracks, targets.travels)
        self._targets = replace(targets, travels=travels)
        return facing_ahead(tracks, travels)


def _limited(log_odds: np.ndarray) -> np.ndarray:
    limited: np.ndarray = np.clip(log_odds, -MOST_LOG_ODDS, MOST_LOG_ODDS)
    return limited


def _position_log_odds(targets: BernoulliTargets, rows: np.ndarray) -> np.ndarray:
    """Return (K,) log odds that tracked positions are wrong by less than the target's width.

    In the plane the distance from the mean exceeds d with the probability exp(-d^2 / total
    variance), if both axes have equal variance.
    """
    variance = targets.beliefs.covariances[rows][:, [0, 1], [0, 1]].sum(axis=1)
    ratio = np.minimum(targets.sizes[rows, 1] ** 2 / variance, MOST_LOG_ODDS)
    odds: np.ndarray = np.log(np.expm1(ratio))
    return odds


def log_odds_of_both(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the (N,) log odds of two independent events together; one, other: (N,) those of each.

    p q / (1 - p q) is 1 / ((1 + 1 / odds) (1 + 1 / other odds) - 1).
    """
    a, b = np.exp(-one), np.exp(-other)
    odds: np.ndarray = -np.log(a + b + a * b)
    return odds


# What is counted while tracking. Round figures chosen by hand.
NOISE_WEIGHT = 50.0
"""Weight, in detections, of the noise in the traits."""
KNOWN_HITS = 5
"""Detections from which on the motion of a target is known."""
REAPPEARANCE_WEIGHT = 10.0
"""Weight, in targets, of a share in the traits."""
SOON_S = 0.3
"""Time within which a new target must be detected again to count as right."""


@dataclass(slots=True)
class NoiseScale:
    """The ratio of squared errors of detected positions to those in the traits.

    If the noise of a filter is right, the mean squared Mahalanobis distance in two dimensions is 2.
    The innovation is taken to be mostly noise of the measurement.
    """

    total: float = NOISE_WEIGHT
    detections: float = NOISE_WEIGHT

    @property
    def factor(self) -> float:
        """The factor by which variances in the traits are multiplied."""
        return self.total / self.detections

    def count(self, targets: BernoulliTargets, distances: np.ndarray) -> None:
        """Count (N,) squared Mahalanobis distances of detections of targets.

        Only targets that probably exist, with `KNOWN_HITS` detections and at most one miss, count.
        """
        settled = (targets.hits >= KNOWN_HITS) & (targets.misses <= 1) & (targets.existence > 0)
        limited = np.minimum(distances[settled], MOST_DISTANCE)
        self.total += self.factor * float(limited.sum()) / 2
        self.detections += len(limited)


@dataclass(slots=True)
class ReappearanceShare:
    """Of the targets that probably exist, how many were detected again and how many were lost.

    How often a detector misses targets and reports clutter is best estimated from the share of
    missed, or of new, targets that are detected again.
    """

    detected_again: int = 0
    lost: int = 0

    def count(self, detected_again: np.ndarray, lost: np.ndarray) -> None:
        """Count the true values of two arrays of bool."""
        self.detected_again += int(detected_again.sum())
        self.lost += int(lost.sum())

    def log_odds_offset(self, shares: np.ndarray) -> np.ndarray:
        """Return (7,) log odds of being detected again, minus those of (7,) shares in training."""
        again = self.detected_again + REAPPEARANCE_WEIGHT * shares
        lost = self.lost + REAPPEARANCE_WEIGHT * (1 - shares)
        offset: np.ndarray = np.log(again / lost) - np.log(shares / (1 - shares))
        return offset


@dataclass(slots=True)
class Reappearances:
    """Shares of missed targets, and of new ones, that are detected again.

    New ones must be detected again within `SOON_S`, for later dense clutter would be, too.
    """

    missed: ReappearanceShare = field(default_factory=ReappearanceShare)
    new: ReappearanceShare = field(default_factory=ReappearanceShare)

    def count(self, before: BernoulliTargets, after: BernoulliTargets, dropped: np.ndarray) -> None:
        """Count the same N targets a tick ago and now; dropped: (N,) bool, which end now."""
        detected = after.misses == 0
        self.missed.count(_is_missed(before) & detected, _is_missed(after) & dropped)
        late = dropped | (after.idle_s > SOON_S)
        is_new = _is_new(before)
        self.new.count(is_new & detected, is_new & ~detected & late)


def _is_missed(targets: BernoulliTargets) -> np.ndarray:
    """Return (N,) bool, which targets are missed now and probably existed at the last detection."""
    missed: np.ndarray = (targets.misses > 0) & (targets.detected_existence > 0)
    return missed


def _is_new(targets: BernoulliTargets) -> np.ndarray:
    """Return (N,) bool, which targets were detected once, within `SOON_S`, and probably exist."""
    soon = targets.idle_s <= SOON_S
    new: np.ndarray = (targets.hits == 1) & (targets.first_evidence > 0) & soon
    return new
