"""What a detector and a tracker made of every target of a scripted experiment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.papers.lu2018_scene import Take
from roadscope.core import Detections, Tracks, TrackState, Truth
from roadscope.trackers import TRACKERS, associate_nearest

GATE_M = 2.0
"""A detection or track farther from a target's centre is not the target's."""
NOBODY = -1


@dataclass(frozen=True, slots=True)
class Following:
    """Places in the ego frame, x ahead and y left, of G targets in K frames; row 0 is target 1.

    truth: (G, K, 2) metres.
    measured: (G, K, 2) detections, NaN where the target was not detected.
    estimated: (G, K, 2) posterior places of the tracks, NaN where there was none.
    ids: (G, K) int64 of the tracks that took the target's detection or, where there was none, of
        the track that took the last one, as long as it lives; `NOBODY` where there was none.
    strays: per frame the ids of the tracks that took a detection of no target.
    """

    truth: np.ndarray
    measured: np.ndarray
    estimated: np.ndarray
    ids: np.ndarray
    strays: tuple[frozenset[int], ...]

    @property
    def detected(self) -> np.ndarray:
        """(G, K) bool."""
        return np.asarray(np.isfinite(self.measured[..., 0]))


def follow(take: Take, detections: Sequence[Detections], tracker: str) -> Following:
    """Run a tracker, named by its spec, over detections and set its tracks against the targets."""
    truth = target_places(take)
    measured, estimated = np.full_like(truth, np.nan), np.full_like(truth, np.nan)
    ids = np.full(truth.shape[:2], NOBODY)
    running = TRACKERS.make(tracker)
    strays = []
    for k, (found, seen) in enumerate(zip(detections, take.truths, strict=True)):
        tracks = running.update(found, seen.world_from_ego)
        if tracks.frame == "world":
            tracks = tracks.moved(seen.world_from_ego.inverse(), "ego")
        places = tracks.centres[:, :2]
        takers = _takers(found, tracks)
        visible = returns_of_targets(take, k) > 0
        mine = {
            row: target
            for row, target in assigned(found.centres[:, :2], truth[:, k])
            # Clutter that happens to stand where an unseen target is does not detect it.
            if visible[target]
        }
        for row, target in mine.items():
            measured[target, k] = found.centres[row, :2]
            estimated[target, k], ids[target, k] = places[takers[row]], tracks.ids[takers[row]]
        for target in np.setdiff1d(np.arange(len(truth)), list(mine.values())):
            (alive,) = np.nonzero(tracks.ids == (ids[target, k - 1] if k else NOBODY))
            if len(alive):
                estimated[target, k], ids[target, k] = places[alive[0]], tracks.ids[alive[0]]
        strays.append(frozenset(int(tracks.ids[t]) for row, t in takers.items() if row not in mine))
    return Following(truth, measured, estimated, ids, tuple(strays))


def _takers(found: Detections, tracks: Tracks) -> dict[int, int]:
    """Return the row of the track that took each detection.

    Every detection updates or opens exactly one track, and only those do not coast.
    """
    (awake,) = np.nonzero(tracks.states != TrackState.COASTING)
    pairs = associate_nearest(found.centres[:, :2], tracks.centres[awake, :2], np.inf)
    return {row: int(awake[column]) for row, column in pairs}


def target_places(take: Take) -> np.ndarray:
    """Return the true centres of all targets, (G, K, 2) metres, ego frame."""
    return np.stack([_in_ego(truth) for truth in take.truths], axis=1)


def returns_of_targets(take: Take, k: int) -> np.ndarray:
    """Return how many returns each target gives in frame k + 1, (G,) int64."""
    truth = take.truths[k]
    return np.asarray(truth.lidar_returns[np.argsort(truth.ids)])


def assigned(places: np.ndarray, targets: np.ndarray) -> list[tuple[int, int]]:
    """Pair (N, 2) places with (G, 2) targets one to one, the nearest pair first."""
    return associate_nearest(places, targets, GATE_M)


def _in_ego(truth: Truth) -> np.ndarray:
    order = np.argsort(truth.ids)
    places: np.ndarray = truth.world_from_ego.inverse().apply(truth.centres[order])[:, :2]
    return places
