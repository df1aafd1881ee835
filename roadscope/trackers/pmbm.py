"""Poisson multi-Bernoulli mixture filter (Garcia-Fernandez, Williams, Granstrom, Svensson 2018)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.trackers.clutter import FIRST_M2, Clutter, Scores
from roadscope.trackers.gating import candidates_by_likelihood, chi_square_gate, determinants
from roadscope.trackers.jpda_existence import Existence, Sighting
from roadscope.trackers.life_cycle import told_states
from roadscope.trackers.motion import ConstantVelocity
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.pmbm_hypotheses import Parts, all_continued
from roadscope.trackers.pmbm_mixture import Bernoullis, Members, Mixture, Roster
from roadscope.trackers.settings import check_counts, check_not_negative, check_shares
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets


class PmbmTracker:
    """Many hypotheses of which detection was whose, from the first tick on, with their weights.

    Targets not yet seen are a Poisson process, here as dense everywhere and at all times, so each
    detection may be a new target's or clutter. Of every hypothesis the likeliest ways to go on
    are kept (Murty); targets that compete for nothing have hypotheses of their own. Visibility is
    part of a target's state, as in `JpdaTracker`; scores count as amplitude information does.

    Reported are the targets of the likeliest hypothesis, and those of earlier reports that any
    hypothesis still has, as tentative ones. Reported scores are probabilities of existence over
    all hypotheses.
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
        hypotheses: int = 10,
        least_share: float = 1e-3,
        confirm: float = 0.99,
        drop: float = 0.02,
        shown_misses: int = 0,
        position_m: float = 0.3,
        speed_m_s: float = 15.0,
        velocity_walk: float = 2.0,
    ) -> None:
        """Set the tracker up.

        gate_share: share of right pairs that the gate lets through, if the noise is as said.
        detection, clutter_m2, birth_m2, lifetime_s, visible_s, hidden_s, score_weight: see
            `Sighting`; clutter_m2 None: counted while tracking.
        traits: what scores mean, see `ExistenceTracker`.
        hypotheses: those kept of each cluster of targets that compete; HOTA with 10 was that with
            50 within 0.002 on validation seeds.
        least_share: less likely than the likeliest by this factor, a hypothesis is dropped.
        confirm, drop: probabilities of existence from which a track is confirmed, and below which
            a hypothesis does without it, be it old or new.
        shown_misses: ticks without a detection in which a track is still answered for.
        position_m, speed_m_s: see `PlaceFilter`.
        velocity_walk: m/s per root second, by which velocities wander.
        """
        check_shares(confirm=confirm, drop=drop, least_share=least_share)
        check_counts(0, shown_misses=shown_misses)
        check_counts(1, hypotheses=hypotheses)
        check_not_negative(velocity_walk=velocity_walk)
        self._gate = chi_square_gate(gate_share, 2)
        self._counts, first_m2 = clutter_m2 is None, FIRST_M2 if clutter_m2 is None else clutter_m2
        self._sighting = Sighting(
            detection, first_m2, birth_m2, lifetime_s, visible_s, hidden_s, score_weight
        )
        self._least, self._hypotheses, self._scores = drop, hypotheses, Scores(traits)
        self._gap = -float(np.log(least_share)) if least_share > 0 else np.inf
        self._confirm, self._shown_misses = confirm, shown_misses
        self._filter = PlaceFilter(position_m, speed_m_s, ConstantVelocity(velocity_walk))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._next_id = 0
        self._clutter = Clutter()
        self._scores.reset()
        self._mixture = Mixture.empty(self._newborn(Detections.empty(0.0), np.empty(0)))

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return the tracks that matter."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        self._clutter.seen(tick)
        if self._counts:
            self._sighting = replace(self._sighting, clutter_m2=self._clutter.density_m2)
        shares, before = self._scores.shares(tick), self._mixture
        ahead = self._predicted(tick.period_s)
        parts = self._continued(ahead, tick.targets, shares)
        mixture = self._updated(ahead, parts, tick.targets, shares)
        # Where clutter is dense even a target just seen is less likely than `drop`.
        drop = min(self._least, self._sighting.new_shares(np.array([0.5])).item())
        self._mixture = mixture.pruned(drop, self._hypotheses, self._gap)
        self._clutter.lost(self._fruitless(before, len(shares)))
        return self._report(tick)

    def _fruitless(self, before: Mixture, detections: int) -> int:
        """Count detections that no target is thought of now, and those of targets given up."""
        mixture = self._mixture
        found = mixture.here & (mixture.bernoullis.tracks.misses[mixture.likeliest] == 0)
        told = before.roster.shown & ~before.roster.confirmed
        gone = told & ~np.isin(before.roster.ids, mixture.roster.ids)
        hits = before.bernoullis.tracks.hits[before.likeliest[gone]]
        return int(detections - found.sum() + hits.sum())

    def _predicted(self, dt: float) -> Mixture:
        bernoullis = self._mixture.bernoullis
        beliefs = self._filter.predicted(bernoullis.tracks.beliefs, dt)
        existence = self._sighting.moved_on(bernoullis.existence, dt)
        return replace(
            self._mixture, bernoullis=Bernoullis(bernoullis.tracks.moved_on(beliefs), existence)
        )

    def _continued(self, mixture: Mixture, targets: Detections, shares: np.ndarray) -> Parts:
        """Weigh each local hypothesis with each detection and take the best.

        All weights are divided by those of detections that are new or clutter.
        """
        tracks, existence = mixture.bernoullis.tracks, mixture.bernoullis.existence
        known = self._sighting
        S = self._filter.expected(tracks.beliefs)
        near = candidates_by_likelihood(tracks.places, S, targets.centres[:, :2], self._gate)
        near = near.within_families(tracks.categories, targets.categories)
        missed = 1 - existence.visible * known.detection
        seen = existence.visible * known.detection / (2 * np.pi * np.sqrt(determinants(S)))
        costs = near.costs / 2 - np.log(seen / missed)[near.rows]
        costs -= np.log(known.gains(shares))[near.columns]
        m = mixture.members
        unseen = np.bincount(m.hypothesis, np.log(missed)[m.local], len(mixture.cluster))
        return all_continued(
            (mixture.cluster, mixture.log_weights + unseen),
            (m.hypothesis, m.target, m.local),
            (near.rows, near.columns, costs),
            (len(mixture.roster.ids), *near.shape),
            (self._hypotheses, self._gap),
        )

    def _updated(
        self, mixture: Mixture, parts: Parts, targets: Detections, shares: np.ndarray
    ) -> Mixture:
        """Make each local hypothesis that some global one needs, once; new targets come last."""
        cluster, log_weights, (hypothesis, target, before, column) = parts
        codes = before * (len(targets) + 1) + column + 1
        kinds, local = np.unique(codes, return_inverse=True)
        rows, detected = kinds // (len(targets) + 1), kinds % (len(targets) + 1) - 1
        old = rows < len(mixture.bernoullis)
        bernoullis = self._branched(mixture.bernoullis.select(rows[old]), detected[old], targets)
        newborn = self._newborn(targets, shares)
        return Mixture(
            bernoullis.joined(newborn.select(detected[~old])),
            mixture.roster.joined(Roster.new(newborn.tracks.ids)),
            cluster, log_weights, Members(hypothesis, target, local),
        )  # fmt: skip

    def _branched(
        self, bernoullis: Bernoullis, detected: np.ndarray, targets: Detections
    ) -> Bernoullis:
        """Give each local hypothesis its detection, or -1: a miss."""
        rows = np.flatnonzero(detected >= 0)
        found = targets.select(detected[rows])
        tracks = bernoullis.tracks
        beliefs = self._filter.corrected(tracks.beliefs.select(rows), found.centres[:, :2])
        existence = bernoullis.existence.missed(self._sighting.detection)
        existence = existence.replaced(rows, Existence.first(np.ones(len(rows))))
        return Bernoullis(tracks.seen(rows, found, beliefs), existence)

    def _newborn(self, targets: Detections, shares: np.ndarray) -> Bernoullis:
        opened = Tracklets.opened(self._next_id, targets, self._filter.started(targets))
        self._next_id += len(targets)
        there = self._sighting.new_shares(shares)
        return Bernoullis(opened, Existence.first(there))

    def _report(self, tick: Tick) -> Tracks:
        mixture, roster = self._mixture, self._mixture.roster
        here, existence = mixture.here, mixture.existence
        confirmed = roster.confirmed | (here & (existence >= self._confirm))
        shown = roster.shown | here
        roster = replace(roster, shown=shown, confirmed=confirmed)
        self._mixture = replace(mixture, roster=roster)
        tracks = mixture.bernoullis.tracks.select(mixture.likeliest[shown])
        tracks = replace(tracks, scores=np.clip(existence[shown], 0, 1))
        states = told_states((here & confirmed)[shown], tracks.misses, self._shown_misses)
        planar = self._filter.planar(tracks.beliefs)
        return tracks.report(planar, states, tick.frame, tick.stamp_s)
