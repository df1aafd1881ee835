"""A Kalman filter of boxes in space and their overlap: AB3DMOT (Weng 2020)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.pose import wrap_angle
from roadscope.trackers.assignment import assign_optimally, left_over
from roadscope.trackers.gating import candidates_by_overlap, check_overlap
from roadscope.trackers.kalman import Gaussians, corrected, predicted
from roadscope.trackers.life_cycle import LifeCycle
from roadscope.trackers.settings import check_counts, check_not_negative
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets, boxes_of

FRAME_S = 0.1
"""The authors' noise is per frame of KITTI; velocities here are per second."""
FIRST = np.array([10.0] * 7 + [1e4 / FRAME_S**2] * 3)
"""Variances of a new state: of velocities a thousand times that of the box, per frame."""
WALK = np.array([1.0] * 7 + [0.01 / FRAME_S**2] * 3)
"""Variances that one frame adds (section 3.2, Q)."""
H = np.eye(7, 10)
R = np.eye(7)
YAW = 3
PLANE = np.array([0, 1, 7, 8])
"""Of the state: x, y, vx, vy."""
MEASURED = np.array([0, 1, 2, 6, 3, 4, 5])
"""From centre, length width height, yaw to the order of the state."""


class Ab3dmotTracker:
    """State x, y, z, yaw, l, w, h, vx, vy, vz; every detection measures the first seven.

    The authors' constants, in a frame that stands still where the ego's pose is known; they
    follow targets in the sensor's. Their R is 1 m and 1 rad, so covariances say little.
    """

    def __init__(
        self,
        *,
        overlap: str = "iou",
        least: float = 0.01,
        min_hits: int = 3,
        max_age: int = 2,
        shown_misses: int = 1,
        least_score: float = 0.0,
    ) -> None:
        """Set the tracker up.

        overlap: `iou` as in the paper or `giou` as in the authors' later code, both in space.
        least: what the overlap of a pair must exceed; the authors' are 0.01 and -0.2.
        min_hits: detections after which a track is confirmed (section 3.5).
        max_age: ticks without a detection after which it is dropped.
        shown_misses: see `LifeCycle`.
        least_score: detections below are not looked at.
        """
        check_overlap(overlap, least)
        check_counts(1, max_age=max_age)
        check_not_negative(least_score=least_score)
        self._overlap, self._least, self._least_score = overlap, least, least_score
        self._life = LifeCycle(min_hits, max_age - 1, max_age - 1, shown_misses)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: Tick | None = None
        self._tracks = Tracklets.empty(10)
        self._next_id = 0

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Take the detections of one tick and return all tracks."""
        tick = self._tick = Tick.after(self._tick, detections, ego_pose)
        targets = tick.targets.select(tick.targets.scores >= self._least_score)
        tracks = self._predicted(tick.period_s)
        near = candidates_by_overlap(
            tracks.boxes, boxes_of(targets), overlap=self._overlap, least=self._least
        ).within_families(tracks.categories, targets.categories)
        rows, columns = assign_optimally(near, 1 - self._least)
        found = targets.select(columns)
        beliefs = self._corrected(tracks.beliefs.select(rows), boxes_of(found)[:, MEASURED])
        tracks = self._life.survivors(_shaped(tracks.seen(rows, found, beliefs)))
        new = targets.select(left_over(len(targets), columns))
        self._tracks = tracks = tracks.joined(
            Tracklets.opened(self._next_id, new, self._started(new))
        )
        self._next_id += len(new)
        planar = Gaussians(
            tracks.beliefs.means[:, PLANE], tracks.beliefs.covariances[:, PLANE[:, None], PLANE]
        )
        return tracks.report(planar, self._life.states(tracks), tick.frame, tick.stamp_s)

    def _predicted(self, dt: float) -> Tracklets:
        """Move x, y, z on by their velocities (section 3.2)."""
        A = np.eye(10)
        A[[0, 1, 2], [7, 8, 9]] = dt
        Q = np.diag(WALK) * dt / FRAME_S
        return _shaped(self._tracks.moved_on(predicted(self._tracks.beliefs, A, Q)))

    def _corrected(self, beliefs: Gaussians, measured: np.ndarray) -> Gaussians:
        """Take the boxes in, (N, 7) as in the state, headings corrected first (section 3.4).

        A box says little about front and rear: where track and detection differ by more than a
        right angle, the track is turned by half.
        """
        means, measured = beliefs.means.copy(), measured.copy()
        opposed = np.abs(wrap_angle(measured[:, YAW] - means[:, YAW])) > np.pi / 2
        means[opposed, YAW] += np.pi
        measured[:, YAW] = means[:, YAW] + wrap_angle(measured[:, YAW] - means[:, YAW])
        return corrected(Gaussians(means, beliefs.covariances), measured, H, R)

    def _started(self, targets: Detections) -> Gaussians:
        n = len(targets)
        means = np.column_stack([boxes_of(targets)[:, MEASURED], np.zeros((n, 3))])
        return Gaussians(means, np.tile(np.diag(FIRST), (n, 1, 1)))


def _shaped(tracks: Tracklets) -> Tracklets:
    """Let the state say where boxes are and how large."""
    means = tracks.beliefs.means
    return replace(tracks, heights=means[:, 2], yaws=wrap_angle(means[:, YAW]), sizes=means[:, 4:7])
