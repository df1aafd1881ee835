"""Follows boxes and asks of each whether there is something: the tracker to take."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks, TrackState
from roadscope.trackers.assignment import assign_optimally, left_over
from roadscope.trackers.existence_kernels import hidden_shares
from roadscope.trackers.existence_noise import Noise
from roadscope.trackers.existence_priors import Neighbours, expected_velocities
from roadscope.trackers.existence_returns import Returns, both
from roadscope.trackers.existence_targets import Measured, Targets, log_odds
from roadscope.trackers.gating import candidates_by_distance, overlapping
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.learned.choice import Choice
from roadscope.trackers.settings import check_positive
from roadscope.trackers.ticks import Tick

# None of these was fitted to anything: 9 is what scores of 0.9999 say, 12 is exceeded by one right
# pair in 400, the rest are round figures set by hand, which only spare work on what is given up.
SURE = 9.0
"""Log odds beyond which nothing is believed or disbelieved."""
FURTHEST = 12.0
"""Squared Mahalanobis distance beyond which places fit no worse."""
GIVEN_UP = -4.0
"""Log odds at the last detection below which a target of few is not looked for unseen."""
FEW = 2.0
"""Sum of scores."""


class ExistenceTracker:
    """Bernoulli filters: log odds of existence decide what is told, optimal assignment who is who.

    Every detection raises or lowers the log odds by what its score says and by how well it lies
    where it was expected; every miss lowers them, less where nearer targets hide the place.
    A detection that nothing led to expect is likelier clutter than its score says.
    Clutter of real detectors is persistent, a bush is a car in many frames, so what one frame
    said counts less with time instead of adding up without end.
    """

    weighed = True

    def __init__(
        self,
        *,
        traits: str = "auto",
        least_overlap: float = -0.3,
        coast_s: float = 1.5,
        shown_probability: float = 0.45,
    ) -> None:
        """Set the tracker up.

        traits: what was learned of a detector, a name of `roadscope.trackers.learned` or a file;
            `auto`: the shipped one whose scores are likest to those met so far.
        least_overlap: generalised IoU in space that a pair must exceed.
        coast_s: how long a target is looked for after its last detection.
        shown_probability: of existence, from which on a track is confirmed or, unseen, coasts.

        The last three are set by hand, and to nothing in particular.
        """
        check_positive(coast_s=coast_s)
        if not -1 <= least_overlap < 1:
            raise ValueError(f"least_overlap must lie in -1 to 1, got {least_overlap!r}")
        if not 0 < shown_probability < 1:
            given = f"got {shown_probability!r}"
            raise ValueError(f"shown_probability must lie between 0 and 1, {given}")
        self._choice = Choice(traits)
        self._least_overlap, self._coast_s = least_overlap, coast_s
        self._shown = float(np.log(shown_probability / (1 - shown_probability)))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._next_id = 0
        self._choice.reset()
        self._returns = Returns()
        self._noise = Noise()
        self._traits = self._choice.after(np.empty(0), np.empty(0, np.int8))
        none = Measured.of(Detections.empty(0.0), np.zeros(2), self._traits)
        self._targets = Targets.opened(
            np.empty(0, np.int64), none, Gaussians.empty(2), self._traits
        )

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks, tentative ones included."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        seen = tick.targets
        self._traits = self._choice.after(log_odds(seen.scores), seen.categories)
        eye = np.zeros(2) if ego_pose is None else ego_pose.translation[:2]
        measured = Measured.of(tick.targets, eye, self._traits, self._noise.factor)
        before = self._targets
        targets = before.carried(tick.period_s, self._traits)
        rows, columns = self._pairs(targets, measured, tick.period_s)
        missed = np.ones(len(targets), bool)
        missed[rows] = False
        believed = targets.told(self._traits) > self._shown
        visible = 1 - hidden_shares(targets.boxes, missed, believed, eye)
        unseen_s = tick.period_s * np.where(missed, visible, 0.0)
        targets = replace(targets, away_s=targets.away_s + unseen_s)
        targets = targets.replaced(
            rows, self._confirmed(targets.select(rows), measured.select(columns), tick.period_s)
        )
        targets = self._doubted(targets, eye)
        kept = self._kept(targets)
        self._returns.count(before, targets, ~kept)
        targets = targets if kept.all() else targets.select(kept)
        new = measured.select(left_over(len(measured), columns))
        known = Neighbours.of(targets, eye, tick.ego_velocity)
        self._targets = targets.joined(self._opened(new, known))
        return self._report(tick)

    def _pairs(
        self, targets: Targets, measured: Measured, dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pair boxes that overlap most, in sum, and that motion can have brought together."""
        kinds = targets.categories
        reach = (dt * self._traits.top_speed_m_s + 0.5)[kinds]
        places = targets.beliefs.means[:, :2]
        near = candidates_by_distance(places, measured.boxes[:, :2], reach)
        near = overlapping(
            near.within_families(kinds, measured.categories), targets.boxes, measured.boxes,
            overlap="giou", least=self._least_overlap,
        )  # fmt: skip
        return assign_optimally(near, 1 - self._least_overlap)

    def _confirmed(self, targets: Targets, found: Measured, dt: float) -> Targets:
        """Let existence lean towards what a detection says of it."""
        after, distances = targets.seen(found, self._traits)
        self._noise.count(targets, distances)
        t, kinds = self._traits, found.categories
        misfit = t.misfit[kinds] * np.minimum(distances, FURTHEST)
        told = t.score_gain[kinds] * found.evidence + t.seen_gain[kinds] - misfit
        kept = np.exp(-dt / t.memory_s[kinds])
        existence = np.clip(kept * targets.existence + (1 - kept) * told, -SURE, SURE)
        return replace(after, existence=existence, assured=existence)

    def _doubted(self, targets: Targets, eye: np.ndarray) -> Targets:
        """Ask of those missed whether they were there at all and still are."""
        rows = np.flatnonzero(targets.misses)
        t, kinds = self._traits, targets.categories[rows]
        apart = targets.beliefs.means[rows, :2] - eye
        ranges = np.hypot(apart[:, 0], apart[:, 1])
        away_s = targets.away_s[rows]
        back = t.back[kinds] + t.back_per_m[kinds] * ranges - t.away_per_s[kinds] * away_s
        back += self._returns.missed.lead(t.returned)[kinds]
        existence = targets.existence.copy()
        existence[rows] = np.clip(both(targets.assured[rows], back), -SURE, SURE)
        return replace(targets, existence=existence)

    def _kept(self, targets: Targets) -> np.ndarray:
        """Return (N,) bool, not those unseen for too long, nor who hardly ever was there."""
        few = targets.votes.sum(axis=1) < FEW
        weak = (targets.misses > 0) & few & (targets.assured < GIVEN_UP)
        kept: np.ndarray = ~weak & (targets.idle_s <= self._coast_s)
        return kept

    def _opened(self, new: Measured, known: Neighbours) -> Targets:
        ids = self._next_id + np.arange(len(new))
        self._next_id += len(new)
        lead = self._returns.born.lead(self._traits.born)[new.categories]
        velocities = expected_velocities(new, known, self._traits)
        opened = Targets.opened(ids, new, velocities, self._traits)
        return replace(opened, existence=new.evidence + lead, assured=new.evidence + lead)

    def _report(self, tick: Tick) -> Tracks:
        targets = self._targets
        told, missed = targets.told(self._traits), np.flatnonzero(targets.misses)
        odds = told.copy()
        odds[missed] = both(odds[missed], _certainty(targets, missed))
        believed = odds >= self._shown
        states = np.full(len(targets), TrackState.TENTATIVE, np.int8)
        states[believed] = np.where(
            targets.misses[believed] > 0, TrackState.COASTING, TrackState.CONFIRMED
        )
        beliefs: Gaussians = targets.beliefs
        covariances = beliefs.covariances.copy()
        surplus = self._traits.surplus[targets.categories, None, None]
        covariances[:, :2, :2] = surplus * (covariances[:, :2, :2] + targets.offsets)
        return Tracks(
            targets.ids, np.column_stack([beliefs.means[:, :2], targets.heights[:, 0]]),
            targets.sizes, targets.yaws[:, 0], beliefs.means[:, 2:], covariances,
            targets.categories, 1 / (1 + np.exp(-told)), states,
            tick.frame, tick.stamp_s,
        )  # fmt: skip


def _certainty(targets: Targets, rows: np.ndarray) -> np.ndarray:
    """Return (K,) log odds that those of some rows are no further off than their width."""
    spread = targets.beliefs.covariances[rows][:, [0, 1], [0, 1]].sum(axis=1)
    found: np.ndarray = np.log(np.expm1(np.minimum(targets.sizes[rows, 1] ** 2 / spread, SURE)))
    return found
