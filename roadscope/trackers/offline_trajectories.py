"""Tracks of all ticks as one trajectory for each target, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from roadscope.core import Tracks, TrackState
from roadscope.trackers.offline_noise import MotionNoise


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """One target from its first to its last detection, K ticks without a hole.

    ticks: (K,) int64. stamps_s: (K,).
    means, covariances: (K, 4) and (K, 4, 4) of x, y, vx, vy, of what does not last of errors.
    walks, drifts, offsets: (K, 2, 2), as in `MotionNoise`; walks and drifts until the next tick.
    heights, sizes, yaws, scores: (K,), (K, 3), (K,), (K,).
    seen: (K,) bool, whether there was a detection.
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
    seen: np.ndarray

    def __len__(self) -> int:
        return len(self.ticks)

    @property
    def score(self) -> float:
        """Mean score of the ticks in which it was seen."""
        return float(self.scores[self.seen].mean())

    def until(self, count: int) -> Trajectory:
        """Keep the first ticks."""
        columns = {name: getattr(self, name)[:count] for name in COLUMNS}
        return replace(self, **columns)


NOISES = tuple(field.name for field in fields(MotionNoise))
COLUMNS = (
    "ticks", "stamps_s", "means", "covariances", *NOISES, "heights", "sizes", "yaws", "scores",
    "seen",
)  # fmt: skip


def trajectories(history: Sequence[Tracks], noises: Sequence[MotionNoise]) -> list[Trajectory]:
    """Sort tracks of T ticks by target; what comes after the last detection is left out.

    noises: of each record, what its tracks wander by.
    """
    frames = {tracks.frame for tracks in history}
    if len(frames) > 1:
        raise ValueError(f"tracks must stay in one frame, got {', '.join(sorted(frames))}")
    ticks = np.repeat(np.arange(len(history)), [len(tracks) for tracks in history])
    ids = np.concatenate([t.ids for t in history]) if history else np.empty(0, np.int64)
    if not len(ids):
        return []
    stamps = np.array([tracks.stamp_s for tracks in history])
    columns = _columns(history, ticks, stamps)
    for name in NOISES:
        columns[name] = np.concatenate([getattr(noise, name) for noise in noises])
    columns["covariances"][:, :2, :2] -= columns["offsets"]
    categories = np.concatenate([t.categories for t in history])
    order = np.lexsort((ticks, ids))
    cuts = np.flatnonzero(np.diff(ids[order])) + 1
    found = []
    for rows in np.split(order, cuts):
        last = rows[-1]
        whole = Trajectory(
            int(ids[last]), int(categories[last]), **{n: c[rows] for n, c in columns.items()},
            seen=_seen(columns["means"][rows], columns["covariances"][rows]),
        )  # fmt: skip
        found.append(whole.until(int(np.flatnonzero(whole.seen)[-1]) + 1))
    return found


def _columns(
    history: Sequence[Tracks], ticks: np.ndarray, stamps: np.ndarray
) -> dict[str, np.ndarray]:
    def all_of(name: str) -> np.ndarray:
        return np.concatenate([getattr(tracks, name) for tracks in history])

    centres = all_of("centres")
    return {
        "ticks": ticks, "stamps_s": stamps[ticks],
        "means": np.column_stack([centres[:, :2], all_of("velocities")]),
        "covariances": all_of("covariances"), "heights": centres[:, 2],
        "sizes": all_of("sizes"), "yaws": all_of("yaws"), "scores": all_of("scores"),
    }  # fmt: skip


def _seen(means: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Return (K,) bool, False where a state was only carried on.

    Then the velocity is what it was, to the last bit, and the place less certain.
    """
    seen = np.ones(len(means), bool)
    spread = covariances[:, 0, 0] + covariances[:, 1, 1]
    same = (means[1:, 2:] == means[:-1, 2:]).all(axis=1)
    seen[1:] = ~(same & (spread[1:] > spread[:-1]))
    return seen


def told(whole: Sequence[Trajectory], history: Sequence[Tracks]) -> list[Tracks]:
    """Sort trajectories by tick again; each keeps one score, and its id."""
    rows: list[list[tuple[Trajectory, int]]] = [[] for _ in history]
    for trajectory in whole:
        for k, tick in enumerate(trajectory.ticks.tolist()):
            rows[tick].append((trajectory, k))
    return [_record(given, tracks) for given, tracks in zip(rows, history, strict=True)]


def _record(rows: Sequence[tuple[Trajectory, int]], like: Tracks) -> Tracks:
    if not rows:
        return Tracks.empty(like.stamp_s, like.frame)
    means = np.array([t.means[k] for t, k in rows])
    states = [TrackState.CONFIRMED if t.seen[k] else TrackState.COASTING for t, k in rows]
    return Tracks(
        np.array([t.id for t, _ in rows]),
        np.column_stack([means[:, :2], [t.heights[k] for t, k in rows]]),
        np.array([t.sizes[k] for t, k in rows]), np.array([t.yaws[k] for t, k in rows]),
        means[:, 2:], np.array([_whole(t, k) for t, k in rows]),
        np.array([t.category for t, _ in rows], np.int8),
        np.clip([t.score for t, _ in rows], 0.0, 1.0), np.array(states, np.int8),
        like.frame, like.stamp_s,
    )  # fmt: skip


def _whole(trajectory: Trajectory, k: int) -> np.ndarray:
    covariance: np.ndarray = trajectory.covariances[k].copy()
    covariance[:2, :2] += trajectory.offsets[k]
    return covariance
