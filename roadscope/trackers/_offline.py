"""The offline pass over the tracks of a finished episode.

It joins fragments, fills gaps, smooths tracks and drops weak ones. Its tracks are not online: those
of a frame depend on later frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from roadscope.core import Detections, Pose, Tracks, TrackState
from roadscope.core.pose import wrap_angle
from roadscope.trackers._assignment import assign_greedily
from roadscope.trackers._existence import ExistenceTracker
from roadscope.trackers._existence_targets import predicted_states
from roadscope.trackers._gating import chi_square_gate
from roadscope.trackers._headings import facing_ahead
from roadscope.trackers._motion import ConstantVelocity

# Which fragments are joined; chosen by hand.
GATE_SHARE = 0.99
"""Share of pairs of fragments of one target that lie within the gate."""
SIZE_RATIO = 1.5
"""Fragments are not joined if their lengths, widths or heights differ by more than this factor."""
MOST_DEVIATION_M = 2.0
"""Standard deviation of an expected position above which fragments are not joined."""
LEAST_DETECTIONS = 3
"""Fragments with fewer detections are not joined: their velocity is too uncertain."""


class ExistenceOfflineTracker(ExistenceTracker):
    """`ExistenceTracker` that also goes through a finished episode again.

    `update` returns the same as `ExistenceTracker`, to the last bit; `rescored` is not online.
    """

    offline = True
    weighed = False
    """`rescored` drops weak tracks and leaves none tentative."""

    def reset(self) -> None:
        """Forget all tracks."""
        super().reset()
        self._noises: dict[float, TrackNoise] = {}

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return what the online tracker returns, and store the noise that it assumes."""
        tracks = super().update(detections, ego_pose)
        walks, drifts = self._targets.motion_noise(self._traits)
        offsets = tracks.covariances[:, :2, :2] - self._targets.beliefs.covariances[:, :2, :2]
        self._noises[tracks.stamp_s] = TrackNoise(walks, drifts, offsets)
        return tracks

    def rescored(self, history: Sequence[Tracks]) -> list[Tracks]:
        """Return all tracks again, see `offline_tracks`.

        history: what `update` returned since the last reset.
        """
        none = TrackNoise.uniform(0, 0.0)
        noises = [self._noises.get(tracks.stamp_s, none) for tracks in history]
        known = all(len(n) == len(t) for n, t in zip(noises, history, strict=True))
        return offline_tracks(history, noises=noises if known else None)


@dataclass(frozen=True, slots=True)
class OfflineRules:
    """Rules of the offline pass; round figures chosen by hand, for tracks of any tracker.

    velocity_walk: m/s per root second, of tracks whose noise is unknown. It lies between what was
        learned of cars (0.85) and of cyclists (0.67); pedestrians (0.28) are smoothed too little.
    fade_s: time constant of the average of heights and headings, to either side.
    size_fade_s: the same for sizes, and for the vote between front and rear.
    longest_gap_s: longest time between two fragments that are joined.
    least_score: tracks with a lower mean score are dropped.
    least_detections: tracks with fewer detections are dropped.
    """

    velocity_walk: float = 0.8
    fade_s: float = 0.3
    size_fade_s: float = 2.0
    longest_gap_s: float = 2.5
    least_score: float = 0.6
    least_detections: int = 3


@dataclass(frozen=True, slots=True, eq=False)
class TrackNoise:
    """The noise of N tracks at one tick, (N, 2, 2) covariances each.

    walks, drifts: until the next tick, see `MotionNoise`.
    offsets: m2, of the part of position errors that is correlated over time, so that smoothing
        does not reduce it.
    """

    walks: np.ndarray
    drifts: np.ndarray
    offsets: np.ndarray

    def __len__(self) -> int:
        return len(self.walks)

    @staticmethod
    def uniform(count: int, velocity_walk: float) -> TrackNoise:
        """Return the same noise for all tracks; velocity_walk: m/s per root second."""
        zeros = np.zeros((count, 2, 2))
        return TrackNoise(zeros + velocity_walk**2 * np.eye(2), zeros, zeros)


def offline_tracks(
    history: Sequence[Tracks],
    rules: OfflineRules | None = None,
    noises: Sequence[TrackNoise] | None = None,
) -> list[Tracks]:
    """Return tracks that are smoothed, filled, joined and scored as a whole, without weak ones.

    history: what a tracker reported, tick by tick, tentative tracks included, in one frame that
        stands still. Missed tracks must move at constant velocity.
    noises: for each record the noise that the tracker assumed; None for that of
        `OfflineRules.velocity_walk` without correlated errors.

    Returns as many records as in the history. Tracks are confirmed at ticks with a detection and
    coasting between them. They begin with their first detection, also if they were tentative then,
    and end with their last one.
    """
    rules = rules or OfflineRules()
    if noises is None:
        noises = [TrackNoise.uniform(len(tracks), rules.velocity_walk) for tracks in history]
    strong = [t for t in trajectories(history, noises) if _is_strong(t, rules)]
    joined = _joined_fragments(strong, rules.longest_gap_s)
    return _by_tick([smoothed(trajectory, rules) for trajectory in joined], history)


@dataclass(frozen=True, slots=True, eq=False)
class TargetTrajectory:
    """One target from its first to its last detection, K consecutive ticks.

    ticks: (K,) int64. stamps_s: (K,).
    means, covariances: (K, 4) and (K, 4, 4) of x, y, vx, vy, without the correlated errors.
    walks, drifts, offsets: (K, 2, 2), see `TrackNoise`.
    heights, sizes, yaws, scores: (K,), (K, 3), (K,), (K,).
    detected: (K,) bool, whether there was a detection.
    """

    id: int
    category: int
    ticks: np.ndarray
    stamps_s: np.ndarray
    means: np.ndarray
    covariances: np.ndarray
    walks: np.ndarray
    drifts: np.ndarray
    offsets: np.ndarray
    heights: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    scores: np.ndarray
    detected: np.ndarray

    def __len__(self) -> int:
        return len(self.ticks)

    @property
    def score(self) -> float:
        """Mean score of the ticks with a detection."""
        return float(self.scores[self.detected].mean())

    def until(self, count: int) -> TargetTrajectory:
        """Return the trajectory of the first `count` ticks."""
        columns: dict[str, Any] = {name: getattr(self, name)[:count] for name in COLUMNS}
        return replace(self, **columns)


NOISES = tuple(field.name for field in fields(TrackNoise))
COLUMNS = tuple(f.name for f in fields(TargetTrajectory) if f.name not in ("id", "category"))


def _is_strong(trajectory: TargetTrajectory, rules: OfflineRules) -> bool:
    enough = trajectory.detected.sum() >= rules.least_detections
    return bool(enough and trajectory.score >= rules.least_score)


def trajectories(history: Sequence[Tracks], noises: Sequence[TrackNoise]) -> list[TargetTrajectory]:
    """Return one trajectory for each id, up to its last detection.

    noises: of the tracks of each record, in their order.
    """
    frames = {tracks.frame for tracks in history}
    if len(frames) > 1:
        raise ValueError(f"tracks must stay in one frame, got {', '.join(sorted(frames))}")
    if not any(len(tracks) for tracks in history):
        return []

    def column(name: str) -> np.ndarray:
        return np.concatenate([getattr(tracks, name) for tracks in history])

    ticks = np.repeat(np.arange(len(history)), [len(tracks) for tracks in history])
    stamps_s = np.array([tracks.stamp_s for tracks in history])
    centres, ids, categories = column("centres"), column("ids"), column("categories")
    columns = {
        "ticks": ticks,
        "stamps_s": stamps_s[ticks],
        "means": np.column_stack([centres[:, :2], column("velocities")]),
        "covariances": column("covariances"),
        "heights": centres[:, 2],
        "sizes": column("sizes"),
        "yaws": column("yaws"),
        "scores": column("scores"),
    }
    for name in NOISES:
        columns[name] = np.concatenate([getattr(noise, name) for noise in noises])
    columns["covariances"][:, :2, :2] -= columns["offsets"]
    order = np.lexsort((ticks, ids))
    cuts = np.flatnonzero(np.diff(ids[order])) + 1
    until_last_detection = []
    for rows in np.split(order, cuts):
        own = {name: values[rows] for name, values in columns.items()}
        detected = _was_detected(own["means"], own["covariances"])
        last = rows[-1]
        whole = TargetTrajectory(int(ids[last]), int(categories[last]), **own, detected=detected)
        until_last_detection.append(whole.until(int(np.flatnonzero(detected)[-1]) + 1))
    return until_last_detection


def _was_detected(means: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Return (K,) bool, False where a state was only predicted.

    Then the velocity is the same to the last bit, and the position less certain.
    """
    detected = np.ones(len(means), bool)
    variance = covariances[:, 0, 0] + covariances[:, 1, 1]
    same = (means[1:, 2:] == means[:-1, 2:]).all(axis=1)
    detected[1:] = ~(same & (variance[1:] > variance[:-1]))
    return detected


def _joined_fragments(
    fragments: Sequence[TargetTrajectory], longest_gap_s: float
) -> list[TargetTrajectory]:
    """Return trajectories in which fragments are joined where motion allows, the likeliest first.

    Gaps are filled with predictions; the id is that of the earliest fragment.
    """
    gate = chi_square_gate(GATE_SHARE, 2)
    costs = np.full((len(fragments), len(fragments)), np.inf)
    for i, early in enumerate(fragments):
        for j, late in enumerate(fragments):
            gap_s = late.stamps_s[0] - early.stamps_s[-1]
            if 0 < gap_s <= longest_gap_s and _may_be_one(early, late):
                costs[i, j] = _join_distance(early, late, gap_s)
    next_of = dict(zip(*(k.tolist() for k in assign_greedily(costs, gate)), strict=True))
    joined = []
    for first in sorted(set(range(len(fragments))) - set(next_of.values())):
        trajectory, at = fragments[first], first
        while at in next_of:
            at = next_of[at]
            trajectory = _joined(trajectory, fragments[at])
        joined.append(trajectory)
    return joined


def _may_be_one(early: TargetTrajectory, late: TargetTrajectory) -> bool:
    """Return whether two fragments have one category, similar sizes and enough detections."""
    if early.category != late.category:
        return False
    if min(early.detected.sum(), late.detected.sum()) < LEAST_DETECTIONS:
        return False
    ratio = np.abs(np.log(early.sizes[-1] / late.sizes[0]))
    return bool((ratio < np.log(SIZE_RATIO)).all())


def _join_distance(early: TargetTrajectory, late: TargetTrajectory, gap_s: float) -> float:
    """Return the squared Mahalanobis distance of the late fragment's start from its prediction.

    It is inf if the prediction is too uncertain.
    """
    mean, covariance = _predicted_after(early, -1, gap_s)
    offset = late.means[0, :2] - mean[:2]
    spread = covariance[:2, :2] + late.covariances[0, :2, :2] + late.offsets[0]
    if np.trace(spread) > MOST_DEVIATION_M**2:
        return np.inf
    return float(offset @ np.linalg.solve(spread, offset))


def _predicted_after(
    trajectory: TargetTrajectory, k: int, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return (4,) state and (4, 4) covariance dt seconds after tick k."""
    at = slice(k, k + 1 or None)
    means, covariances = predicted_states(
        trajectory.means[at],
        trajectory.covariances[at],
        trajectory.walks[at],
        trajectory.drifts[at],
        float(dt),
    )
    return means[0], covariances[0]


def _joined(early: TargetTrajectory, late: TargetTrajectory) -> TargetTrajectory:
    """Return one trajectory of two; the ticks between are predicted from the earlier one."""
    ticks = np.arange(early.ticks[-1] + 1, late.ticks[0])
    share = (ticks - early.ticks[-1]) / (late.ticks[0] - early.ticks[-1])
    stamps_s = early.stamps_s[-1] + share * (late.stamps_s[0] - early.stamps_s[-1])
    states = [_predicted_after(early, -1, stamp - early.stamps_s[-1]) for stamp in stamps_s]
    n = len(ticks)
    between = {
        "ticks": ticks,
        "stamps_s": stamps_s,
        "means": np.array([mean for mean, _ in states]).reshape(n, 4),
        "covariances": np.array([covariance for _, covariance in states]).reshape(n, 4, 4),
        **{name: np.tile(getattr(early, name)[-1], (n, 1, 1)) for name in NOISES},
        "heights": early.heights[-1] + share * (late.heights[0] - early.heights[-1]),
        "sizes": np.tile(early.sizes[-1], (n, 1)),
        "yaws": np.full(n, early.yaws[-1]),
        "scores": np.full(n, early.scores[-1]),
        "detected": np.zeros(n, bool),
    }
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(early, name), between[name], getattr(late, name)])
        for name in COLUMNS
    }
    return replace(early, **columns)


def smoothed(trajectory: TargetTrajectory, rules: OfflineRules) -> TargetTrajectory:
    """Return a trajectory in which every tick uses those after it, too; scores do not change."""
    means, covariances = smoothed_states(trajectory)
    weights = trajectory.detected.astype(float)
    short = _averaging(trajectory.stamps_s, weights, rules.fade_s)
    long = _averaging(trajectory.stamps_s, weights, rules.size_fade_s)
    return replace(
        trajectory,
        means=means,
        covariances=covariances,
        heights=short @ trajectory.heights,
        sizes=long @ trajectory.sizes,
        yaws=_smoothed_headings(trajectory.yaws, short, long),
    )


def smoothed_states(trajectory: TargetTrajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return (K, 4) states and (K, 4, 4) covariances (Rauch, Tung and Striebel 1965)."""
    filtered, stamps_s = trajectory.covariances, trajectory.stamps_s
    x, P = trajectory.means.copy(), filtered.copy()
    for k in range(len(x) - 2, -1, -1):
        dt = stamps_s[k + 1] - stamps_s[k]
        mean, covariance = _predicted_after(trajectory, k, dt)
        F = ConstantVelocity().jacobian(x[:1], dt)
        gain = np.linalg.solve(covariance, F @ filtered[k]).T
        x[k] += gain @ (x[k + 1] - mean)
        spread = P[k] + gain @ (P[k + 1] - covariance) @ gain.T
        spread = 0.5 * (spread + spread.T)
        # If the filter had other noise than the smoother, this may not be positive definite.
        P[k] = spread if np.linalg.eigvalsh(spread)[0] > 0 else filtered[k]
    return x, P


def _averaging(stamps_s: np.ndarray, weights: np.ndarray, fade_s: float) -> np.ndarray:
    """Return the (K, K) matrix of a moving average, whose weights fall by a factor e in `fade_s`.

    weights: (K,) of the ticks.
    """
    shares = np.exp(-np.abs(stamps_s[:, None] - stamps_s) / fade_s) * weights
    averaging: np.ndarray = shares / shares.sum(axis=1, keepdims=True)
    return averaging


def _smoothed_headings(yaws: np.ndarray, short: np.ndarray, long: np.ndarray) -> np.ndarray:
    """Return (K,) headings: axes by a short average, the end that is the front by a long one.

    yaws: (K,). short, long: (K, K) as from `_averaging`.
    """
    double = short @ np.column_stack([np.cos(2 * yaws), np.sin(2 * yaws)])
    axes = 0.5 * np.arctan2(double[:, 1], double[:, 0])
    agreement = (long * np.cos(yaws[None] - axes[:, None])).sum(axis=1)
    return wrap_angle(np.where(agreement < 0, axes + np.pi, axes))


def _by_tick(trajectories: Sequence[TargetTrajectory], history: Sequence[Tracks]) -> list[Tracks]:
    """Return trajectories as one record for each tick, with one score for each trajectory."""
    rows: list[list[tuple[TargetTrajectory, int]]] = [[] for _ in history]
    for trajectory in trajectories:
        for k, tick in enumerate(trajectory.ticks.tolist()):
            rows[tick].append((trajectory, k))
    return [_record(own, tracks) for own, tracks in zip(rows, history, strict=True)]


def _record(rows: Sequence[tuple[TargetTrajectory, int]], like: Tracks) -> Tracks:
    """Return the record of one tick, with frame and stamp of another; rows: trajectory and tick."""
    if not rows:
        return Tracks.empty(like.stamp_s, like.frame)
    means = np.array([t.means[k] for t, k in rows])
    covariances = np.array([t.covariances[k] for t, k in rows])
    covariances[:, :2, :2] += np.array([t.offsets[k] for t, k in rows])
    states = [TrackState.CONFIRMED if t.detected[k] else TrackState.COASTING for t, k in rows]
    tracks = Tracks(
        ids=np.array([t.id for t, _ in rows]),
        centres=np.column_stack([means[:, :2], [t.heights[k] for t, k in rows]]),
        sizes=np.array([t.sizes[k] for t, k in rows]),
        yaws=np.array([t.yaws[k] for t, k in rows]),
        velocities=means[:, 2:],
        covariances=covariances,
        categories=np.array([t.category for t, _ in rows], np.int8),
        scores=np.clip([t.score for t, _ in rows], 0.0, 1.0),
        states=np.array(states, np.int8),
        frame=like.frame,
        stamp_s=like.stamp_s,
    )
    return facing_ahead(tracks)
