"""Learns how the belief that a tracked target exists changes over time, for `tracker_traits`.

`ExistenceTracker` follows targets on training data. What it believed is then compared with what
was right, and the traits under which the right answers are likeliest are taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import NamedTuple

import numpy as np

from research.tracker_samples import (
    CLASSES,
    GATES_M,
    KittiSource,
    OwnClass,
    TrackedInput,
    TrafficSource,
    of_class,
    right_by_kitti,
    tracker_input,
    traffic_episodes,
)
from roadscope import Tracks
from roadscope.benchmarks.metrics.matching import match
from roadscope.core.jit import compiled
from roadscope.trackers import ExistenceTracker
from roadscope.trackers._existence import MOST_DISTANCE, MOST_LOG_ODDS
from roadscope.trackers._existence_targets import BernoulliTargets, Measurements, Neighbours

PERSISTENCE = {
    "memory_s": 0.5,
    "score_gain": 3.0,
    "seen_gain": 6.0,
    "misfit": 0.2,
    "back": 0.0,
    "back_per_m": 0.0,
    "away_per_s": 3.0,
}
"""Guessed, for classes with too few tracks to learn from."""
SHARES = {"returned": 0.5, "born": 0.5, "seen_once": 0.0, "surplus": 1.0}
"""Guessed too. Half of the missed targets return; `back` and its slopes describe which."""
POSITIVE = np.array([True, True, False, True, False, False, True])
"""Which of `PERSISTENCE` are positive; their logarithms are fitted."""
UNITS = np.array([1.0, 1.0, 3.0, 1.0, 1.0, 0.03, 1.0])
"""Standard deviations of the prior around the guess, of positive ones in their logarithm."""
LEAST_TRACKS = 150
"""With each KITTI sequence left out in turn, what was learned of 13 cyclists and 26 pedestrians
lowered HOTA: of pedestrians from 0.42 to 0.37, of cyclists offline from 0.57 to 0.56."""
LEAST_SIMULATED = 50
"""The same for simulated traffic, which is made for the purpose."""
FRAMES_ALIKE = 10
"""Successive ticks are correlated: this many count as one."""
COAST_S = 1.5
"""How long known targets are looked for in training; the tracker looks for them longer."""
NEWTON_STEPS = 50
"""Far more than needed."""
ROUNDS = 200
"""Of Powell's method; more than needed until the third decimal stands."""


@dataclass(frozen=True, slots=True, eq=False)
class TargetTicks:
    """N ticks of tracked targets, target by target.

    tracks, ticks: (N,) int64. detected: (N,) bool, whether the target was detected in that tick.
    evidence, distances: (N,) log odds of the detection and its squared Mahalanobis distance; 0
        without one.
    ranges_m, undetected_s, steps_s: (N,) from the ego, since the last detection, since the last
        tick.
    right: (N,) int8, 1 on an object, 0 not, -1 where neither counts.
    """

    tracks: np.ndarray
    ticks: np.ndarray
    detected: np.ndarray
    evidence: np.ndarray
    distances: np.ndarray
    ranges_m: np.ndarray
    undetected_s: np.ndarray
    steps_s: np.ndarray
    right: np.ndarray

    @staticmethod
    def joined(parts: Sequence[TargetTicks]) -> TargetTicks:
        """Put several sequences together; ids of different sequences stay different."""
        offsets = np.cumsum([0, *(int(p.tracks.max(initial=-1)) + 1 for p in parts)])
        columns = {
            f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(TargetTicks)
        }
        columns["tracks"] = np.concatenate(
            [p.tracks + o for p, o in zip(parts, offsets, strict=False)]
        )
        return TargetTicks(**columns)

    @property
    def objects(self) -> int:
        """Number of targets that were on an object in any tick."""
        return len(np.unique(self.tracks[self.right == 1]))


RightTracks = Callable[[Sequence[Tracks]], Mapping[tuple[int, int], bool]]
"""Returns, by tick and id, which tracks are on an object; tracks that are left out do not count."""


class RecordedTick(NamedTuple):
    """A target after an update; fields as in `TargetTicks`."""

    track: int
    tick: int
    detected: bool
    evidence: float
    distance: float
    range_m: float
    undetected_s: float
    step_s: float


class _Evidence(NamedTuple):
    log_odds: float
    distance: float


class RecordingTracker(ExistenceTracker):
    """The tracker, with a record of its targets after each update."""

    def reset(self) -> None:
        """Forget all tracks and what was recorded."""
        super().reset()
        self.rows: list[RecordedTick] = []
        self._evidence: dict[int, _Evidence] = {}
        self._ticks = 0

    @property
    def counts(self) -> np.ndarray:
        """(2, 2) detected again and never again, of missed targets and of new targets."""
        kinds = self._reappearances.missed, self._reappearances.new
        return np.array([[share.detected_again, share.lost] for share in kinds])

    def _detected(
        self, targets: BernoulliTargets, own: Measurements, dt: float
    ) -> BernoulliTargets:
        _, distances = targets.corrected(own, self._traits)
        pairs = map(_Evidence, own.evidence.tolist(), distances.tolist())
        self._evidence = dict(zip(targets.ids.tolist(), pairs, strict=True))
        return super()._detected(targets, own, dt)

    def _started(self, new: Measurements, neighbours: Neighbours) -> BernoulliTargets:
        started = super()._started(new, neighbours)
        for number, log_odds in zip(started.ids.tolist(), started.existence.tolist(), strict=True):
            self._evidence[number] = _Evidence(log_odds, 0.0)
        return started

    def record(self, ego: np.ndarray, step_s: float) -> None:
        """Record all targets after an update; ego: (2,) place of the ego, world frame."""
        targets = self._targets
        ranges = np.hypot(*(targets.beliefs.means[:, :2] - ego).T)
        for k, number in enumerate(targets.ids.tolist()):
            detected = bool(targets.misses[k] == 0)
            evidence = self._evidence[number] if detected else _Evidence(0.0, 0.0)
            undetected_s = float(targets.away_s[k])
            self.rows.append(
                RecordedTick(
                    number,
                    self._ticks,
                    detected,
                    evidence.log_odds,
                    evidence.distance,
                    float(ranges[k]),
                    undetected_s,
                    step_s,
                )
            )
        self._ticks += 1


class RecordedTargets(NamedTuple):
    """Ticks of targets, and the counts of `RecordingTracker`."""

    ticks: TargetTicks
    counts: np.ndarray


def recorded_targets(
    tracker_inputs: TrackedInput, traits: str, right_tracks: RightTracks
) -> RecordedTargets:
    """Track with a file of traits and judge the targets."""
    tracker = RecordingTracker(traits=traits, coast_known_s=COAST_S)
    history, last_s = list[Tracks](), 0.0
    for detections, pose in zip(tracker_inputs.detections, tracker_inputs.poses, strict=True):
        history.append(tracker.update(detections, pose))
        tracker.record(pose.translation[:2], detections.stamp_s - last_s)
        last_s = detections.stamp_s
    known = right_tracks(history)
    rows = sorted(tracker.rows, key=lambda row: (row.track, row.tick))
    right = np.array([int(known.get((row.tick, row.track), -1)) for row in rows], np.int8)
    table = np.array(rows, float).reshape(-1, len(RecordedTick._fields))
    ids, ticks = table[:, :2].astype(np.int64).T
    evidence, distances, ranges_m, undetected_s, steps_s = np.ascontiguousarray(table[:, 3:].T)
    target_ticks = TargetTicks(
        tracks=ids,
        ticks=ticks,
        detected=table[:, 2] > 0,
        evidence=evidence,
        distances=distances,
        ranges_m=ranges_m,
        undetected_s=undetected_s,
        steps_s=steps_s,
        right=right,
    )
    return RecordedTargets(target_ticks, tracker.counts)


ClassTraits = dict[str, dict[str, float]]
"""By class, traits by name."""


def persistence_on_kitti(source: KittiSource, traits: str) -> ClassTraits:
    """Return the traits learned from sequences of each class, tracked with a file of traits."""
    parts = {
        kind: [
            recorded_targets(
                TrackedInput(s.detections, s.world_from_ego),
                traits,
                partial(right_by_kitti, sequence=s),
            )
            for s in source.read(category)
        ]
        for kind, category in CLASSES.items()
    }
    new = new_target_traits([part for some in parts.values() for part in some])
    return {
        kind: {**persistence(TargetTicks.joined([part.ticks for part in some])), **SHARES, **new}
        for kind, some in parts.items()
    }


def persistence_on_traffic(source: TrafficSource, traits: str) -> ClassTraits:
    """Return the traits learned from train seeds of our traffic.

    A class with too few targets gets those of all classes together.
    """
    parts: dict[str, list[RecordedTargets]] = {kind: [] for kind in CLASSES}
    for episode in traffic_episodes(source):
        for kind, collected in parts.items():
            own = of_class(kind, episode)
            judge = partial(_right_in_traffic, own=own, gate_m=GATES_M[kind])
            collected.append(recorded_targets(tracker_input(own.episode), traits, judge))
    ticks = {
        kind: TargetTicks.joined([part.ticks for part in some]) for kind, some in parts.items()
    }
    everybody = persistence(TargetTicks.joined(list(ticks.values())), least=LEAST_SIMULATED)
    new = new_target_traits([part for some in parts.values() for part in some])
    return {
        kind: {**persistence(each, LEAST_SIMULATED, everybody), **SHARES, **new}
        for kind, each in ticks.items()
    }


def new_target_traits(parts: Sequence[RecordedTargets]) -> dict[str, float]:
    """Return `DetectorTraits.born` and `DetectorTraits.seen_once` of all classes together.

    New targets of each class alone differ as much from their scores, but of some classes there are
    few.
    """
    again, lost = np.sum([part.counts for part in parts], axis=0)[1]
    every = TargetTicks.joined([part.ticks for part in parts])
    first = np.flatnonzero(np.diff(every.tracks, prepend=-1))
    known = first[every.right[first] >= 0]
    once = likeliest_shift(every.evidence[known], every.right[known])
    return {"born": round(float((again + 1) / (again + lost + 2)), 2), "seen_once": round(once, 2)}


def likeliest_shift(log_odds: np.ndarray, right: np.ndarray) -> float:
    """Return the shift of (N,) log odds under which (N,) 1 and 0 are likeliest, by Newton's method.

    Its prior has a standard deviation of 1.
    """
    shift = 0.0
    for _ in range(NEWTON_STEPS):
        chance = 1 / (1 + np.exp(-(log_odds + shift)))
        slope = float((right - chance).sum()) - shift
        shift += float(np.clip(slope / (1 + (chance * (1 - chance)).sum()), -1, 1))
    return shift


def _right_in_traffic(
    history: Sequence[Tracks], own: OwnClass, gate_m: float
) -> dict[tuple[int, int], bool]:
    """Return for each (tick, id) that counts whether it is on an object."""
    right: dict[tuple[int, int], bool] = {}
    pairings = own.rule.pairings(history, own.episode.truths, own.episode.parked)
    for tick, (tracks, pairing) in enumerate(zip(history, pairings, strict=True)):
        fate = match(pairing, gate_m)
        right |= {(tick, int(i)): True for i in tracks.ids[fate.detected]}
        right |= {(tick, int(i)): False for i in tracks.ids[fate.false_alarms]}
    return right


def persistence(
    ticks: TargetTicks, least: int = LEAST_TRACKS, otherwise: Mapping[str, float] = PERSISTENCE
) -> Mapping[str, float]:
    """Return the traits under which the labels right and not right are likeliest.

    least: number of targets on objects, below which `otherwise` is returned.
    """
    if ticks.objects < least:
        return otherwise
    from scipy.optimize import minimize

    guess = _packed(np.array(list(PERSISTENCE.values())))

    def cost(shift: np.ndarray) -> float:
        return log_loss(ticks, _unpacked(guess + shift * UNITS)) + 0.5 * float(shift @ shift)

    options = {"maxiter": ROUNDS, "xtol": 1e-5, "ftol": 1e-9}
    best = minimize(cost, np.zeros(len(guess)), method="Powell", options=options)
    values = _unpacked(guess + best.x * UNITS).tolist()
    return dict(zip(PERSISTENCE, (round(v, 3) for v in values), strict=True))


def log_loss(ticks: TargetTicks, values: np.ndarray) -> float:
    """Return the log loss of existence under values in the order of `PERSISTENCE`."""
    log_odds = existence_log_odds(ticks.tracks, ticks.detected, _columns(ticks), values)
    counts = ticks.right >= 0
    signed = np.where(ticks.right == 1, -log_odds, log_odds)[counts]
    return float(np.logaddexp(0, signed).sum()) / FRAMES_ALIKE


def _columns(ticks: TargetTicks) -> np.ndarray:
    return np.column_stack(
        [ticks.evidence, ticks.distances, ticks.ranges_m, ticks.undetected_s, ticks.steps_s]
    )


@compiled()
def existence_log_odds(
    tracks: np.ndarray, detected: np.ndarray, columns: np.ndarray, values: np.ndarray
) -> np.ndarray:
    """Return the (N,) log odds of existence that `ExistenceTracker` computes.

    columns: (N, 5) evidence, distances, ranges_m, undetected_s, steps_s of `TargetTicks`.
    """
    memory_s, gain, base, misfit, back, back_per_m, away_per_s = values
    out, now, at_detection = np.empty(len(tracks)), 0.0, 0.0
    for i in range(len(tracks)):
        evidence, distance, range_m, undetected_s, step_s = columns[i]
        if i == 0 or tracks[i] != tracks[i - 1]:
            now = at_detection = evidence
        elif detected[i]:
            share = np.exp(-step_s / memory_s)
            new = gain * evidence + base - misfit * min(distance, MOST_DISTANCE)
            now = share * now + (1 - share) * new
            now = at_detection = min(max(now, -MOST_LOG_ODDS), MOST_LOG_ODDS)
        else:
            a = np.exp(-at_detection)
            b = np.exp(away_per_s * undetected_s - back - back_per_m * range_m)
            now = min(max(-np.log(a + b + a * b), -MOST_LOG_ODDS), MOST_LOG_ODDS)
        out[i] = now
    return out


def _packed(values: np.ndarray) -> np.ndarray:
    return np.where(POSITIVE, np.log(np.where(POSITIVE, values, 1.0)), values)


def _unpacked(packed: np.ndarray) -> np.ndarray:
    return np.where(POSITIVE, np.exp(np.where(POSITIVE, packed, 0.0)), packed)
