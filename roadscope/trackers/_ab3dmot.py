"""AB3DMOT: a Kalman filter of boxes in space, associated by their overlap (Weng 2020)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Detections, Pose, Tracks
from roadscope.core.arguments import check_counts, check_not_negative
from roadscope.core.pose import wrap_angle
from roadscope.trackers import _kalman as kalman
from roadscope.trackers._assignment import assign_optimally, unassigned
from roadscope.trackers._gating import boxes_of, check_overlap, pairs_by_overlap
from roadscope.trackers._kalman import Gaussians
from roadscope.trackers._ticks import TrackerTick
from roadscope.trackers._tracklets import LifeCycle, Tracklets


class Ab3dmotTracker:
    """Tracks boxes at constant velocity and assigns detections by overlap in space.

    Constants are the authors'. They track in the sensor's frame; here it is the world frame if the
    ego pose is known. Their measurement noise is 1 m and 1 rad, so covariances are no measure of
    the errors.
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
        least: a pair must overlap by more; the authors use 0.01 for `iou` and -0.2 for `giou`.
        min_hits: detections after which a track is confirmed (section 3.5).
        max_age: ticks without a detection after which a track is dropped.
        shown_misses: see `LifeCycle`.
        least_score: detections with a lower score are ignored.
        """
        check_overlap(overlap, least)
        check_counts(1, max_age=max_age)
        check_not_negative(least_score=least_score)
        self._overlap, self._least, self._least_score = overlap, least, least_score
        self._life_cycle = LifeCycle(min_hits, max_age - 1, max_age - 1, shown_misses)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tick: TrackerTick | None = None
        self._tracks = Tracklets.empty(DIMENSIONS)
        self._next_id = 0

    def update(self, detections: Detections, ego_pose: Pose | None = None) -> Tracks:
        """Return the tracks after the detections of one tick."""
        tick = self._tick = TrackerTick.after(self._tick, detections, ego_pose)
        detections = tick.detections.select(tick.detections.scores >= self._least_score)
        tracks = boxes_predicted(self._tracks, tick.period_s)
        near = pairs_by_overlap(
            tracks.boxes, boxes_of(detections), overlap=self._overlap, least=self._least
        ).within_families(tracks.categories, detections.categories)
        rows, columns = assign_optimally(near, 1 - self._least)
        tracks = boxes_updated(tracks, rows, detections.select(columns))
        new = detections.select(unassigned(len(detections), columns))
        started = boxes_started(self._next_id, new)
        self._tracks = self._life_cycle.survivors(tracks).joined(started)
        self._next_id += len(new)
        return boxes_reported(self._tracks, self._life_cycle, tick)


# The filter (section 3.2). SimpleTrack uses it, too.
DIMENSIONS = 10
"""State x, y, z, yaw, length, width, height, vx, vy, vz; detections measure the first seven."""
FRAME_S = 0.1
"""Period of KITTI: the authors' velocities and noise are per frame, here they are per second."""
FIRST_VARIANCES = np.array([10.0] * 7 + [1e4 / FRAME_S**2] * 3)
"""Variances of a new state: those of velocities per frame are a thousand times those of the box."""
VARIANCES_PER_FRAME = np.array([1.0] * 7 + [0.01 / FRAME_S**2] * 3)
"""Diagonal of Q for one frame."""
H = np.eye(7, DIMENSIONS)
R = np.eye(7)
YAW = 3
"""Column of the yaw in a state."""
PLANAR_COLUMNS = np.array([0, 1, 7, 8])
"""Columns of x, y, vx, vy in a state."""
MEASURED_COLUMNS = np.array([0, 1, 2, 6, 3, 4, 5])
"""Columns of a box (centre, length width height, yaw) in the order of a state."""


def boxes_started(first_id: int, detections: Detections) -> Tracklets:
    """Return new tracks of N detections, at rest with a wide spread."""
    n = len(detections)
    means = np.column_stack([boxes_of(detections)[:, MEASURED_COLUMNS], np.zeros((n, 3))])
    beliefs = Gaussians(means, np.tile(np.diag(FIRST_VARIANCES), (n, 1, 1)))
    return Tracklets.started(first_id, detections, beliefs)


def boxes_predicted(tracks: Tracklets, dt: float) -> Tracklets:
    """Return tracks after dt seconds at constant velocity."""
    A = np.eye(DIMENSIONS)
    A[[0, 1, 2], [7, 8, 9]] = dt
    Q = np.diag(VARIANCES_PER_FRAME) * dt / FRAME_S
    return _with_boxes_of_state(tracks.predicted(kalman.predicted(tracks.beliefs, A, Q)))


def boxes_updated(tracks: Tracklets, rows: np.ndarray, detections: Detections) -> Tracklets:
    """Return tracks of which the rows of an index array got a detection each.

    Detectors confuse front and rear: if track and detection differ by more than a right angle, the
    track is turned by half a turn (section 3.4).
    """
    beliefs = tracks.beliefs.select(rows)
    means, measured = beliefs.means.copy(), boxes_of(detections)[:, MEASURED_COLUMNS]
    opposed = np.abs(wrap_angle(measured[:, YAW] - means[:, YAW])) > np.pi / 2
    means[opposed, YAW] += np.pi
    measured[:, YAW] = means[:, YAW] + wrap_angle(measured[:, YAW] - means[:, YAW])
    after = kalman.corrected(Gaussians(means, beliefs.covariances), measured, H, R)
    return _with_boxes_of_state(tracks.updated(rows, detections, after))


def boxes_reported(tracks: Tracklets, life_cycle: LifeCycle, tick: TrackerTick) -> Tracks:
    """Return the record that a tracker of boxes reports."""
    beliefs = tracks.beliefs
    planar = Gaussians(
        beliefs.means[:, PLANAR_COLUMNS],
        beliefs.covariances[:, PLANAR_COLUMNS[:, None], PLANAR_COLUMNS],
    )
    return replace(tracks, beliefs=planar).as_tracks(life_cycle.states(tracks), tick)


def _with_boxes_of_state(tracks: Tracklets) -> Tracklets:
    """Return tracks whose height, heading and size are those of the state."""
    means = tracks.beliefs.means
    return replace(tracks, heights=means[:, 2], yaws=wrap_angle(means[:, YAW]), sizes=means[:, 4:7])
