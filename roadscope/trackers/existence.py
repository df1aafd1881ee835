"""Follows boxes and asks of each whether there is something: the tracker to take."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks, TrackState
from roadscope.trackers.assignment import assign_optimally
from roadscope.trackers.existence_kernels import hidden_shares
from roadscope.trackers.existence_targets import Measured, Targets, log_odds
from roadscope.trackers.gating import candidates_by_overlap
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.learned import Choice
from roadscope.trackers.settings import check_counts, check_positive
from roadscope.trackers.ticks import Tick

CLUTTER_SPREAD = 4.0
"""How much wider than a target's, in variance, clutter's innovations are."""
SURE = 6.0
"""Log odds beyond which nothing is believed or disbelieved."""
GIVEN_UP = -5.0
"""Log odds below which an unseen target of few detections is no longer looked for."""
FEW = 2.0
"""Sum of scores."""


class ExistenceTracker:
    """Bernoulli filters: log odds of existence decide what is told, optimal assignment who is who.

    Every detection raises or lowers the log odds by what its score says and by how well it lies
    where it was expected; every miss lowers them, less where nearer targets hide the place.
    Clutter of real detectors is persistent, a bush is a car in many frames, so what one frame
    said counts less with time instead of adding up without end.
    """

    def __init__(
        self,
        *,
        traits: str = "auto",
        least_overlap: float = -0.3,
        coast_s: float = 1.5,
        detected: float = 0.9,
        clutter_detected: float = 0.4,
        memory_s: float = 0.6,
        shown_probability: float = 0.5,
        shown_misses: int = 0,
    ) -> None:
        """Set the tracker up.

        traits: what was learned of a detector, a name of `roadscope.trackers.learned` or a file;
            `auto`: the shipped one whose scores are likest to those met so far.
        least_overlap: generalised IoU in space that a pair must exceed.
        coast_s: how long a target is looked for after its last detection.
        detected: probability that a visible target is detected.
        clutter_detected: probability that clutter comes back at the same place.
        memory_s: time in which what a frame said of existence fades to 1/e.
        shown_probability: of existence, from which on a track is confirmed.
        shown_misses: ticks without a detection in which such a track is still answered for.
        """
        check_positive(coast_s=coast_s, memory_s=memory_s)
        check_counts(0, shown_misses=shown_misses)
        if not -1 <= least_overlap < 1:
            raise ValueError(f"least_overlap must lie in -1 to 1, got {least_overlap!r}")
        for name, share in (
            ("detected", detected), ("clutter_detected", clutter_detected),
            ("shown_probability", shown_probability),
        ):  # fmt: skip
            if not 0 < share < 1:
                raise ValueError(f"{name} must lie between 0 and 1, got {share!r}")
        self._choice = Choice(traits)
        self._least_overlap, self._coast_s, self._memory_s = least_overlap, coast_s, memory_s
        self._detected, self._clutter_detected = detected, clutter_detected
        self._shown = float(np.log(shown_probability / (1 - shown_probability)))
        self._shown_misses = shown_misses
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._next_id = 0
        self._choice.reset()
        self._traits = self._choice.after(np.empty(0), np.empty(0, np.int8))
        none = Measured.of(Detections.empty(0.0), np.zeros(2), self._traits)
        self._targets = Targets.opened(np.empty(0, np.int64), none, self._traits)

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks, tentative ones included."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        seen = tick.targets
        self._traits = self._choice.after(log_odds(seen.scores), seen.categories)
        eye = np.zeros(2) if ego_pose is None else ego_pose.translation[:2]
        measured = Measured.of(tick.targets, eye, self._traits)
        targets = self._targets.carried(tick.period_s, self._traits)
        rows, columns = self._pairs(targets, measured, tick.period_s)
        missed = np.ones(len(targets), bool)
        missed[rows] = False
        believed = targets.existence > self._shown
        visible = 1 - hidden_shares(targets.boxes, missed, believed, eye)
        targets = self._judged(targets, visible, tick.period_s)
        targets = targets.replaced(
            rows, self._confirmed(targets.select(rows), measured.select(columns), tick.period_s)
        )
        self._targets = self._kept(targets).joined(self._opened(measured, columns))
        return self._report(tick)

    def _pairs(
        self, targets: Targets, measured: Measured, dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pair boxes that overlap most, in sum, and that motion can have brought together."""
        kinds = targets.categories
        near = candidates_by_overlap(
            targets.boxes, measured.boxes, overlap="giou", least=self._least_overlap
        ).within_families(kinds, measured.categories)
        apart = targets.beliefs.means[near.rows, :2] - measured.boxes[near.columns, :2]
        reach = dt * self._traits.top_speed_m_s[kinds] + 0.5
        near = near.where(np.hypot(apart[:, 0], apart[:, 1]) < reach[near.rows])
        return assign_optimally(near, 1 - self._least_overlap)

    def _judged(self, targets: Targets, visible: np.ndarray, dt: float) -> Targets:
        """Hold against all targets that they were not detected; pairs are judged anew later."""
        missed = np.log((1 - self._detected * visible) / (1 - self._clutter_detected * visible))
        told = self._faded(targets.existence, dt) + missed
        return replace(targets, existence=np.clip(told, -SURE, SURE))

    def _confirmed(self, targets: Targets, found: Measured, dt: float) -> Targets:
        before = self._targets.existence[np.searchsorted(self._targets.ids, targets.ids)]
        after, distances = targets.seen(found, self._traits)
        fit = np.log(CLUTTER_SPREAD) - 0.5 * (1 - 1 / CLUTTER_SPREAD) * np.minimum(distances, 12.0)
        came = np.log(self._detected / self._clutter_detected)
        told = self._faded(before, dt) + found.evidence + fit + came
        return replace(after, existence=np.clip(told, -SURE, SURE))

    def _faded(self, existence: np.ndarray, dt: float) -> np.ndarray:
        faded: np.ndarray = existence * np.exp(-dt / self._memory_s)
        return faded

    def _kept(self, targets: Targets) -> Targets:
        """Drop who was unseen for too long, or hardly ever was there."""
        few = targets.votes.sum(axis=1) < FEW
        gone = (targets.misses > 0) & few & (targets.existence < GIVEN_UP)
        return targets.select(~gone & (targets.idle_s <= self._coast_s))

    def _opened(self, measured: Measured, taken: np.ndarray) -> Targets:
        new = measured.select(np.setdiff1d(np.arange(len(measured)), taken))
        ids = self._next_id + np.arange(len(new))
        self._next_id += len(new)
        return Targets.opened(ids, new, self._traits)

    def _report(self, tick: Tick) -> Tracks:
        targets = self._targets
        believed = targets.existence >= self._shown
        states = np.full(len(targets), TrackState.TENTATIVE, np.int8)
        states[believed & (targets.misses <= self._shown_misses)] = TrackState.COASTING
        states[believed & (targets.misses == 0)] = TrackState.CONFIRMED
        beliefs: Gaussians = targets.beliefs
        return Tracks(
            targets.ids, np.column_stack([beliefs.means[:, :2], targets.heights[:, 0]]),
            targets.sizes, targets.yaws[:, 0], beliefs.means[:, 2:], beliefs.covariances,
            targets.categories, 1 / (1 + np.exp(-targets.existence)), states,
            tick.frame, tick.stamp_s,
        )  # fmt: skip
