"""What Lu 2018's experiments measure: errors, events and identities of targets, and clutter.

Frames and targets are numbered from 1, as in the paper. An event that never came counts as the
frame after the last one, so that a failure shows in the mean instead of vanishing from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.papers.lu2018_scene import KINDS, SensedExperiment
from roadscope.core import Detections, Tracks, TrackState, Truth
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering import CLUSTERINGS
from roadscope.envs.traffic.lu2018 import Event, Script
from roadscope.trackers import TRACKERS, associate_nearest

# --------------------------------------------------------------------------------------------------
# Detections and tracks of every target.

GATE_M = 2.0
"""A detection farther than this from a target's centre is not the target's; chosen by hand."""
NO_TRACK = -1


@dataclass(frozen=True, slots=True)
class TargetHistories:
    """G targets in K frames; row 0 is target 1. Ego frame, x ahead and y left, metres.

    truth: (G, K, 2) true centres.
    measured: (G, K, 2) detections, NaN where the target was not detected.
    estimated: (G, K, 2) posterior positions of the tracks, NaN where there was no track.
    ids: (G, K) int64, the track that took the target's detection. Where there was no detection,
        the track that took the last one, as long as it lives. `NO_TRACK` where there was none.
    clutter_tracks: per frame the ids of the tracks that took a detection of no target.
    """

    truth: np.ndarray
    measured: np.ndarray
    estimated: np.ndarray
    ids: np.ndarray
    clutter_tracks: tuple[frozenset[int], ...]

    @property
    def detected(self) -> np.ndarray:
        """(G, K) bool."""
        return np.asarray(np.isfinite(self.measured[..., 0]))


def track_targets(
    sensed: SensedExperiment, detections: Sequence[Detections], tracker: str
) -> TargetHistories:
    """Run a tracker, named by its spec, over detections and assign its tracks to the targets."""
    truth = target_positions(sensed)
    measured, estimated = np.full_like(truth, np.nan), np.full_like(truth, np.nan)
    ids = np.full(truth.shape[:2], NO_TRACK)
    running = TRACKERS.make(tracker)
    clutter_tracks = []
    for k, (boxes, frame_truth) in enumerate(zip(detections, sensed.truths, strict=True)):
        tracks = running.update(boxes, frame_truth.world_from_ego)
        if tracks.frame == "world":
            tracks = tracks.moved(frame_truth.world_from_ego.inverse(), "ego")
        positions = tracks.centres[:, :2]
        track_of = _tracks_of_detections(boxes, tracks)
        visible = returns_of_targets(sensed, k) > 0
        target_of = {
            row: target
            for row, target in nearest_pairs(boxes.centres[:, :2], truth[:, k])
            # Clutter that happens to stand where an unseen target is does not detect it.
            if visible[target]
        }
        for row, target in target_of.items():
            measured[target, k] = boxes.centres[row, :2]
            estimated[target, k] = positions[track_of[row]]
            ids[target, k] = tracks.ids[track_of[row]]
        for target in np.setdiff1d(np.arange(len(truth)), list(target_of.values())):
            (alive,) = np.nonzero(tracks.ids == (ids[target, k - 1] if k else NO_TRACK))
            if len(alive):
                estimated[target, k], ids[target, k] = positions[alive[0]], tracks.ids[alive[0]]
        clutter_tracks.append(
            frozenset(int(tracks.ids[t]) for row, t in track_of.items() if row not in target_of)
        )
    return TargetHistories(truth, measured, estimated, ids, tuple(clutter_tracks))


def _tracks_of_detections(boxes: Detections, tracks: Tracks) -> dict[int, int]:
    """Return the row of the track that took each detection.

    Every detection updates or opens exactly one track, and only those do not coast.
    """
    (updated,) = np.nonzero(tracks.states != TrackState.COASTING)
    pairs = associate_nearest(boxes.centres[:, :2], tracks.centres[updated, :2], np.inf)
    return {row: int(updated[column]) for row, column in pairs}


def target_positions(sensed: SensedExperiment) -> np.ndarray:
    """Return the true centres of all targets, (G, K, 2) metres, ego frame."""
    return np.stack([_positions_in_ego(truth) for truth in sensed.truths], axis=1)


def _positions_in_ego(truth: Truth) -> np.ndarray:
    order = np.argsort(truth.ids)
    positions: np.ndarray = truth.world_from_ego.inverse().apply(truth.centres[order])[:, :2]
    return positions


def returns_of_targets(sensed: SensedExperiment, k: int) -> np.ndarray:
    """Return how many returns each target gives in frame k + 1, (G,) int64."""
    truth = sensed.truths[k]
    return np.asarray(truth.lidar_returns[np.argsort(truth.ids)])


def nearest_pairs(positions: np.ndarray, targets: np.ndarray) -> list[tuple[int, int]]:
    """Pair (N, 2) positions with (G, 2) targets one to one; nearest pairs are taken first."""
    return associate_nearest(positions, targets, GATE_M)


# --------------------------------------------------------------------------------------------------
# Errors.

AHEAD, LEFT = "ahead (paper's y)", "left (paper's x)"
AXES = (AHEAD, LEFT)


def axis_errors(histories: TargetHistories, target: int) -> dict[str, float]:
    """Return root mean squares over the frames with a detection, metres, by axis."""
    row = target - 1
    used = histories.detected[row] & (histories.ids[row] != NO_TRACK)
    differences = {
        "estimate minus measurement": histories.estimated[row] - histories.measured[row],
        "estimate minus truth": histories.estimated[row] - histories.truth[row],
        "measurement minus truth": histories.measured[row] - histories.truth[row],
    }
    return {
        f"RMS of {name}, object {target}, {axis}": _rms(values[used, column])
        for name, values in differences.items()
        for column, axis in enumerate(AXES)
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


# --------------------------------------------------------------------------------------------------
# Events.


def first_tracked(histories: TargetHistories, target: int) -> float:
    """Return the first frame in which a target was detected and had a track."""
    row = target - 1
    return _first_frame(histories.detected[row] & (histories.ids[row] != NO_TRACK))


def first_missing(histories: TargetHistories, target: int, last: int | None = None) -> float:
    """Return the frame after the last one (up to frame `last`) in which a target was detected."""
    rows = np.flatnonzero(histories.detected[target - 1, :last])
    return float(rows[-1] + 2) if len(rows) else 1.0


def reassociated_in(histories: TargetHistories, target: int, first_missing_frame: int) -> float:
    """Return the first frame, from `gone` on, whose detection of the target went to its old track.

    first_missing_frame: the first frame in which the target was not detected.
    """
    row = target - 1
    old_track = _last_track(histories, target, first_missing_frame)
    again = histories.detected[row] & (histories.ids[row] == old_track) & (old_track != NO_TRACK)
    again[: first_missing_frame - 1] = False
    return _first_frame(again)


def reassociated_at_once(histories: TargetHistories, target: int, event: Event) -> float:
    """Return 1 if a detection in the frame after an event goes to the old track, otherwise 0."""
    return float(reassociated_in(histories, target, event.first) == event.last + 1)


def identity_kept(histories: TargetHistories, target: int, event: Event) -> float:
    """Return 1 if the first detection after an event goes to the old track, otherwise 0."""
    row = target - 1
    old_track = _last_track(histories, target, event.first)
    after = np.flatnonzero(histories.detected[row, event.last :])
    if old_track == NO_TRACK or not len(after):
        return 0.0
    return float(histories.ids[row, event.last + after[0]] == old_track)


def natural_misses(histories: TargetHistories, target: int, script: Script) -> float:
    """Count frames without a detection between the first and the last detection.

    Frames in which the script hides the target are not counted.
    """
    row = target - 1
    expected = histories.detected[row].copy()
    for kind in ("missed", "hidden"):
        for event in script.of(kind, target):
            expected[event.first - 1 : event.last] = True
    span = np.flatnonzero(histories.detected[row])
    return float((~expected[span[0] : span[-1] + 1]).sum()) if len(span) else 0.0


def _last_track(histories: TargetHistories, target: int, frame: int) -> int:
    """Return the target's last track before a frame."""
    ids = histories.ids[target - 1, : frame - 1]
    tracks = ids[ids != NO_TRACK]
    return int(tracks[-1]) if len(tracks) else NO_TRACK


def _first_frame(flags: np.ndarray) -> float:
    return float(flags.argmax() + 1) if flags.any() else float(len(flags) + 1)


# --------------------------------------------------------------------------------------------------
# Identities.


def wrong_associations(histories: TargetHistories) -> float:
    """Count how often a track of one target took the detection of another."""
    track_ids = np.where(histories.detected, histories.ids, NO_TRACK)
    target_of: dict[int, int] = {}
    wrong = 0
    for frame in track_ids.T:
        for target, track in enumerate(frame.tolist()):
            if track != NO_TRACK:
                wrong += target_of.get(track, target) != target
                target_of[track] = target
    return float(wrong)


def clutter_associations(histories: TargetHistories) -> float:
    """Count how often a track of a target took a detection of no target."""
    of_targets: set[int] = set()
    wrong = 0
    for k, on_clutter in enumerate(histories.clutter_tracks):
        wrong += len(of_targets & on_clutter)
        detected = histories.ids[histories.detected[:, k], k]
        of_targets = (of_targets - on_clutter) | set(detected.tolist())
    return float(wrong)


def identity_changes(histories: TargetHistories) -> float:
    """Count how often a target gets a track with another id than its last one."""
    tracks = (ids[ids != NO_TRACK] for ids in histories.ids)
    return float(sum(int((np.diff(ids) != 0).sum()) for ids in tracks))


# --------------------------------------------------------------------------------------------------
# Clutter: what clustering keeps of the roadside, and what detectors report for it.

LEAST_RETURNS = 10
"""Targets with fewer returns are not expected to be detected; chosen by hand."""
MARGIN_M = 0.3
"""Returns this near to a detected box are counted as the returns it was made from."""


def clutter_of_clustering(sensed: SensedExperiment, clustering: str) -> dict[str, float]:
    """Return what one clustering keeps: clusters of foliage a scan, shares of returns kept."""
    foliage, target = KINDS.index("foliage"), KINDS.index("target")
    clusters, in_clusters, in_all = 0, np.zeros(len(KINDS)), np.zeros(len(KINDS))
    for cloud, kinds in zip(sensed.clouds, sensed.kinds, strict=True):
        labels = CLUSTERINGS[clustering](cloud)
        clusters += int((majority(labels, kinds) == foliage).sum())
        in_clusters += np.bincount(kinds[labels >= 0], minlength=len(KINDS))
        in_all += np.bincount(kinds, minlength=len(KINDS))
    shares = in_clusters / np.maximum(in_all, 1)
    return {
        "clusters of foliage": clusters / len(sensed.frames),
        "returns of foliage kept": float(shares[foliage]),
        "returns of vehicles kept": float(shares[target]),
    }


def clutter_of_detector(
    sensed: SensedExperiment, detections: Sequence[Detections]
) -> dict[str, float]:
    """Return the detection rate of targets and the false detections a scan."""
    positions, false = target_positions(sensed), np.zeros(len(KINDS))
    detected, expected = 0, 0
    for k, boxes in enumerate(detections):
        pairs = nearest_pairs(boxes.centres[:, :2], positions[:, k])
        eligible = returns_of_targets(sensed, k) >= LEAST_RETURNS
        expected += int(eligible.sum())
        detected += sum(bool(eligible[target]) for _, target in pairs)
        for row in np.setdiff1d(np.arange(len(boxes)), [row for row, _ in pairs]):
            returns = near_box(boxes.select(np.array([row])), sensed.clouds[k])
            kind = np.bincount(sensed.kinds[k][returns], minlength=len(KINDS)).argmax()
            false[kind] += 1
    rates = dict(zip(KINDS, false / len(detections), strict=True))
    return {
        "detection rate of vehicles in view": detected / max(expected, 1),
        "false detections": sum(rates.values()),
        "false detections on foliage": rates["foliage"],
    }


def majority(labels: np.ndarray, kinds: np.ndarray) -> np.ndarray:
    """Return the commonest kind of each cluster, outliers left out, (C,) int64."""
    inside = labels >= 0
    if not inside.any():
        return np.empty(0, np.int64)
    flat = labels[inside] * len(KINDS) + kinds[inside]
    votes = np.bincount(flat, minlength=len(KINDS) * (labels.max() + 1)).reshape(-1, len(KINDS))
    return np.asarray(votes.argmax(axis=1))


def near_box(box: Detections, cloud: Cloud) -> np.ndarray:
    """Return the (N,) bool mask of returns in or close to one box."""
    offsets = cloud.points[:, :2] - box.centres[0, :2]
    c, s = np.cos(box.yaws[0]), np.sin(box.yaws[0])
    local = np.abs(offsets @ np.array([[c, -s], [s, c]]))
    return np.asarray((local <= box.sizes[0, :2] / 2 + MARGIN_M).all(axis=1))
