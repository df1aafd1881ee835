"""Poisson multi-Bernoulli mixture filter (Garcia-Fernandez, Williams, Granstrom, Svensson 2018)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.arguments import check_counts, check_shares
from roadscope.core.tables import ArrayTable
from roadscope.trackers._detection_model import BernoulliSettings, Existence, ScoreCalibration
from roadscope.trackers._gating import chi_square_gate, determinants, pairs_by_likelihood
from roadscope.trackers._pmbm_hypotheses import (
    Continuations,
    Hypotheses,
    HypothesisLimits,
    PairCosts,
    Sizes,
    continue_all,
)
from roadscope.trackers._ticks import TrackerTick
from roadscope.trackers._tracklets import Tracklets, track_states


@dataclass(frozen=True, slots=True, kw_only=True)
class PmbmSettings(BernoulliSettings):
    """Settings of the tracker.

    hypotheses: greatest number for each cluster of targets that compete for detections; HOTA with
        10 and with 50 differed by less than 0.002 on validation seeds.
    least_share: a hypothesis is dropped if its weight is less than this share of the greatest.
    The others: see `BernoulliSettings`. In a hypothesis, a target is dropped if its probability of
    existence is below `drop`.
    """

    hypotheses: int = 10
    least_share: float = 1e-3

    def __post_init__(self) -> None:
        BernoulliSettings.__post_init__(self)
        check_shares(least_share=self.least_share)
        check_counts(1, hypotheses=self.hypotheses)

    def limits(self) -> HypothesisLimits:
        """Return the limits for pruning."""
        gap = -float(np.log(self.least_share)) if self.least_share > 0 else np.inf
        return HypothesisLimits(self.hypotheses, gap)


class PmbmTracker:
    """Keeps the likeliest global hypotheses: assignments of all detections so far to targets.

    Undetected targets are a Poisson process with the same density everywhere, so every detection
    may be of a new target or clutter. The best continuations of each hypothesis are computed by
    Murty's algorithm (1968). Clusters of targets that compete for detections have hypotheses of
    their own. Visibility and scores are modelled as in `JpdaTracker`.

    The targets of the likeliest hypothesis are reported and, as tentative ones, targets that were
    reported earlier and are in another hypothesis. Scores are probabilities of existence over all
    hypotheses.
    """

    weighed = True

    def __init__(self, settings: PmbmSettings = PmbmSettings()) -> None:
        self._model, self._filter = settings.detection_model(), settings.position_filter()
        self._scores = ScoreCalibration(settings.traits)
        self._gate, self._limits = chi_square_gate(settings.gate_share, 2), settings.limits()
        self._confirm, self._least = settings.confirm, settings.drop
        self._shown_misses = settings.shown_misses
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: TrackerTick | None = None
        self._next_id = 0
        self._model.reset()
        self._scores.reset()
        self._mixture = Mixture.empty(self._newborn(Detections.empty(0.0), np.empty(0)))

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._tick = TrackerTick.after(self._tick, detections, ego_pose)
        model, scores = self._model.update(tick), self._scores.probabilities(tick)
        before = self._mixture
        predicted = self._predicted(tick.period_s)
        continuations = self._continued(predicted, tick.detections, scores)
        mixture = self._updated(predicted, continuations, tick.detections, scores)
        self._mixture = mixture.pruned(model.drop_threshold(self._least), self._limits)
        self._model.clutter.add_false_detections(self._false_detections(before, len(scores)))
        return self._report(tick)

    def _false_detections(self, before: Mixture, detections: int) -> int:
        """Return the number of detections without a target, and of those of dropped tentative ones.

        before: the mixture before the tick. detections: the number of detections of the tick.
        """
        mixture = self._mixture
        misses = mixture.bernoullis.tracks.misses[mixture.likeliest]
        detected = mixture.in_likeliest & (misses == 0)
        tentative = before.reported.shown & ~before.reported.confirmed
        dropped = tentative & ~np.isin(before.reported.ids, mixture.reported.ids)
        hits = before.bernoullis.tracks.hits[before.likeliest[dropped]]
        return int(detections - detected.sum() + hits.sum())

    def _predicted(self, dt: float) -> Mixture:
        bernoullis = self._mixture.bernoullis
        beliefs = self._filter.predicted(bernoullis.tracks.beliefs, dt)
        existence = self._model.current.predicted(bernoullis.existence, dt)
        tracks = bernoullis.tracks.predicted(beliefs)
        return replace(self._mixture, bernoullis=Bernoullis(tracks, existence))

    def _continued(
        self, mixture: Mixture, detections: Detections, scores: np.ndarray
    ) -> Continuations:
        """Return the best continuations of all hypotheses.

        All weights are relative to that of a detection that is clutter or a new target.
        """
        tracks, existence = mixture.bernoullis.tracks, mixture.bernoullis.existence
        model, members = self._model.current, mixture.members
        S = self._filter.innovation_covariances(tracks.beliefs)
        near = pairs_by_likelihood(tracks.positions, S, detections.centres[:, :2], self._gate)
        near = near.within_families(tracks.categories, detections.categories)
        missed = 1 - existence.visible * model.detection
        peak_density = existence.visible * model.detection / (2 * np.pi * np.sqrt(determinants(S)))
        costs = near.costs / 2 - np.log(peak_density / missed)[near.rows]
        costs -= np.log(model.association_gains(scores))[near.columns]
        log_missed = np.bincount(
            members.hypothesis, np.log(missed)[members.local], len(mixture.cluster)
        )
        return continue_all(
            Hypotheses(
                mixture.cluster,
                mixture.log_weights + log_missed,
                members.hypothesis,
                members.target,
                members.local,
            ),
            PairCosts(near.rows, near.columns, costs),
            Sizes(len(mixture.reported.ids), *near.shape),
            self._limits,
        )

    def _updated(
        self,
        mixture: Mixture,
        continuations: Continuations,
        detections: Detections,
        scores: np.ndarray,
    ) -> Mixture:
        """Return the mixture with each local hypothesis that is used, those of new targets last."""
        choices = len(detections) + 1
        codes = continuations.local * choices + continuations.detection + 1
        distinct, local = np.unique(codes, return_inverse=True)
        rows, detection = distinct // choices, distinct % choices - 1
        old = rows < len(mixture.bernoullis)
        bernoullis = self._branched(
            mixture.bernoullis.select(rows[old]), detection[old], detections
        )
        newborn = self._newborn(detections, scores)
        return Mixture(
            bernoullis=bernoullis.joined(newborn.select(detection[~old])),
            reported=mixture.reported.joined(ReportedTargets.new(newborn.tracks.ids)),
            cluster=continuations.cluster,
            log_weights=continuations.log_weights,
            members=HypothesisMembers(continuations.hypothesis, continuations.target, local),
        )

    def _branched(
        self, bernoullis: Bernoullis, detection: np.ndarray, detections: Detections
    ) -> Bernoullis:
        """Return local hypotheses after one detection each; (L,) detection is -1 for a miss."""
        rows = np.flatnonzero(detection >= 0)
        own = detections.select(detection[rows])
        tracks = bernoullis.tracks
        beliefs = self._filter.corrected(tracks.beliefs.select(rows), own.centres[:, :2])
        existence = bernoullis.existence.after_miss(self._model.current.detection)
        existence = existence.replaced(rows, Existence.of_detected(np.ones(len(rows))))
        return Bernoullis(tracks.updated(rows, own, beliefs), existence)

    def _newborn(self, detections: Detections, scores: np.ndarray) -> Bernoullis:
        started = Tracklets.started(self._next_id, detections, self._filter.started(detections))
        self._next_id += len(detections)
        probability = self._model.current.birth_probabilities(scores)
        return Bernoullis(started, Existence.of_detected(probability))

    def _report(self, tick: TrackerTick) -> Tracks:
        mixture, reported = self._mixture, self._mixture.reported
        in_likeliest, existence = mixture.in_likeliest, mixture.existence
        confirmed = reported.confirmed | (in_likeliest & (existence >= self._confirm))
        shown = reported.shown | in_likeliest
        reported = replace(reported, shown=shown, confirmed=confirmed)
        self._mixture = replace(mixture, reported=reported)
        tracks = mixture.bernoullis.tracks.select(mixture.likeliest[shown])
        tracks = replace(tracks, scores=np.clip(existence[shown], 0, 1))
        states = track_states((in_likeliest & confirmed)[shown], tracks.misses, self._shown_misses)
        return tracks.as_tracks(states, tick)


@dataclass(frozen=True, slots=True, eq=False)
class Bernoullis(ArrayTable):
    """L local hypotheses: where a target is if it exists, and whether it exists.

    Several may be of one target, for different histories of detections; they share its id.
    """

    tracks: Tracklets
    existence: Existence

    def __len__(self) -> int:
        return len(self.existence)


@dataclass(frozen=True, slots=True, eq=False)
class ReportedTargets(ArrayTable):
    """What the tracker has reported of T targets.

    ids: (T,) int64.
    shown, confirmed: (T,) bool, whether they were ever reported, and ever reported as confirmed.
    """

    ids: np.ndarray
    shown: np.ndarray
    confirmed: np.ndarray

    @staticmethod
    def new(ids: np.ndarray) -> ReportedTargets:
        """Return targets that were never reported."""
        never = np.zeros(len(ids), bool)
        return ReportedTargets(ids, never, never)


@dataclass(frozen=True, slots=True, eq=False)
class HypothesisMembers(ArrayTable):
    """The targets of all hypotheses, E entries sorted by hypothesis.

    hypothesis, target, local: (E,) int64, the last the local hypothesis of the target.
    """

    hypothesis: np.ndarray
    target: np.ndarray
    local: np.ndarray

    def __len__(self) -> int:
        return len(self.local)

    def of(self, hypotheses: np.ndarray, count: int) -> HypothesisMembers:
        """Return the entries of some hypotheses, which are numbered anew in the order of the index.

        hypotheses: index array. count: the number of all hypotheses.
        """
        number = np.full(count, -1)
        number[hypotheses] = np.arange(len(hypotheses))
        members = self.select(number[self.hypothesis] >= 0)
        members = replace(members, hypothesis=number[members.hypothesis])
        return members.select(np.argsort(members.hypothesis, kind="stable"))


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """H global hypotheses of T targets with L local hypotheses, in independent clusters.

    cluster: (H,) int64, rising: hypotheses of one cluster exclude each other.
    log_weights: (H,) of probabilities that sum to 1 in each cluster, falling within it.
    members: the targets of each hypothesis.
    """

    bernoullis: Bernoullis
    reported: ReportedTargets
    cluster: np.ndarray
    log_weights: np.ndarray
    members: HypothesisMembers

    @staticmethod
    def empty(no_bernoullis: Bernoullis) -> Mixture:
        """Return a mixture without targets."""
        none = np.empty(0, np.int64)
        members = HypothesisMembers(none, none, none)
        return Mixture(no_bernoullis, ReportedTargets.new(none), none, np.empty(0), members)

    @property
    def existence(self) -> np.ndarray:
        """(T,) probabilities of existence over all hypotheses."""
        m = self.members
        weights = np.exp(self.log_weights)[m.hypothesis]
        weights = weights * self.bernoullis.existence.probability[m.local]
        return np.bincount(m.target, weights, len(self.reported.ids))

    @property
    def likeliest(self) -> np.ndarray:
        """(T,) the local hypothesis of each target in the likeliest hypothesis that has it."""
        rows = np.empty(len(self.reported.ids), np.int64)
        # Of several values for one target the last stays: that of the first, likeliest hypothesis.
        rows[self.members.target[::-1]] = self.members.local[::-1]
        return rows

    @property
    def in_likeliest(self) -> np.ndarray:
        """(T,) bool, which targets the likeliest hypothesis of their cluster has."""
        best = np.zeros(len(self.cluster), bool)
        best[_first_rows(self.cluster)] = True
        in_likeliest = np.zeros(len(self.reported.ids), bool)
        in_likeliest[self.members.target[best[self.members.hypothesis]]] = True
        return in_likeliest

    def pruned(self, drop: float, limits: HypothesisLimits) -> Mixture:
        """Return the mixture without unlikely targets and hypotheses; equal hypotheses are merged.

        drop: local hypotheses whose probability of existence is below this are dropped.
        limits: of the hypotheses of each cluster.
        """
        likely = self.bernoullis.existence.probability >= drop
        members = self.members.select(likely[self.members.local])
        codes = _signatures(self.cluster, members)
        _, first, same = np.unique(codes, return_index=True, return_inverse=True)
        weights = np.full(len(first), -np.inf)
        np.logaddexp.at(weights, same, self.log_weights)
        order = np.lexsort([first, -weights, self.cluster[first]])
        weights, first = weights[order], first[order]
        starts, sizes = _extents(self.cluster[first])
        rank = np.arange(len(first)) - np.repeat(starts, sizes)
        best = np.repeat(weights[starts], sizes)
        likeliest = (rank < limits.most) & (weights >= best - limits.gap)
        weights, first = weights[likeliest], first[likeliest]
        cluster = self.cluster[first]
        if len(first):
            starts, sizes = _extents(cluster)
            weights = weights - np.repeat(np.logaddexp.reduceat(weights, starts), sizes)
        members = members.of(first, len(self.cluster))
        pruned = Mixture(self.bernoullis, self.reported, cluster, weights, members)
        return pruned._split()._compact()

    def _split(self) -> Mixture:
        """Return the mixture in which targets on which all hypotheses agree have own clusters."""
        m, T = self.members, len(self.reported.ids)
        if not len(self.cluster):
            return self
        _, sizes = _extents(self.cluster)
        cluster_size = np.repeat(sizes, sizes)
        least, most = np.full(T, len(self.bernoullis)), np.full(T, -1)
        np.minimum.at(least, m.target, m.local)
        np.maximum.at(most, m.target, m.local)
        needed = np.zeros(T, np.int64)
        needed[m.target] = cluster_size[m.hypothesis]
        agreed = (least == most) & (np.bincount(m.target, minlength=T) == needed)
        # A cluster with one hypothesis is split up: all of its targets are agreed on.
        ambiguous, settled = np.flatnonzero(cluster_size > 1), np.flatnonzero(agreed)
        disputed = m.select(~agreed[m.target]).of(ambiguous, len(self.cluster))
        new_rows = len(ambiguous) + np.arange(len(settled))
        settled_members = HypothesisMembers(new_rows, settled, least[settled])
        number = np.cumsum(np.diff(self.cluster[ambiguous], prepend=-1) != 0) - 1
        after = number.max(initial=-1) + 1 + np.arange(len(settled))
        return Mixture(
            bernoullis=self.bernoullis,
            reported=self.reported,
            cluster=np.concatenate([number, after]),
            log_weights=np.concatenate([self.log_weights[ambiguous], np.zeros(len(settled))]),
            members=disputed.joined(settled_members),
        )

    def _compact(self) -> Mixture:
        """Return the mixture without local hypotheses and targets that are in no hypothesis."""
        m = self.members
        targets = np.zeros(len(self.reported.ids), bool)
        locals_ = np.zeros(len(self.bernoullis), bool)
        targets[m.target], locals_[m.local] = True, True
        members = HypothesisMembers(
            m.hypothesis, (np.cumsum(targets) - 1)[m.target], (np.cumsum(locals_) - 1)[m.local]
        )
        return replace(
            self,
            bernoullis=self.bernoullis.select(locals_),
            reported=self.reported.select(targets),
            members=members,
        )


def _first_rows(cluster: np.ndarray) -> np.ndarray:
    """Return (C,) the first row of each cluster."""
    return np.flatnonzero(np.diff(cluster, prepend=-1))


def _extents(cluster: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (C,) the first row of each cluster and its number of rows."""
    starts = _first_rows(cluster)
    return starts, np.diff(np.append(starts, len(cluster)))


def _signatures(cluster: np.ndarray, members: HypothesisMembers) -> np.ndarray:
    """Return (H,) uint64, equal for hypotheses of one cluster with equal members.

    It is the sum of a hash of each member. Among a million different hypotheses, two have equal
    sums by chance less than once in ten million ticks.
    """
    signatures = _hashed(2 * cluster)
    np.add.at(signatures, members.hypothesis, _hashed(2 * members.local + 1))
    return signatures


def _hashed(values: np.ndarray) -> np.ndarray:
    """Return (N,) uint64 hashes of integers (SplitMix64; Steele, Lea and Flood 2014)."""
    z = (values.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    hashes: np.ndarray = z ^ (z >> np.uint64(31))
    return hashes
