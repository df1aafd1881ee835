"""A Kalman filter of boxes in space, as AB3DMOT has it (Weng 2020, section 3.2)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Detections
from roadscope.core.pose import wrap_angle
from roadscope.trackers.kalman import Gaussians, corrected, predicted
from roadscope.trackers.tracklets import Tracklets, boxes_of

FRAME_S = 0.1
"""The authors' noise is per frame of KITTI; velocities here are per second."""
FIRST = np.array([10.0] * 7 + [1e4 / FRAME_S**2] * 3)
"""Variances of a new state: of velocities a thousand times that of the box, per frame."""
WALK = np.array([1.0] * 7 + [0.01 / FRAME_S**2] * 3)
"""Variances that one frame adds (section 3.2, Q)."""
DIMENSIONS = 10
"""State x, y, z, yaw, l, w, h, vx, vy, vz; every detection measures the first seven."""
H = np.eye(7, DIMENSIONS)
R = np.eye(7)
YAW = 3
PLANE = np.array([0, 1, 7, 8])
"""Of the state: x, y, vx, vy."""
MEASURED = np.array([0, 1, 2, 6, 3, 4, 5])
"""From centre, length width height, yaw to the order of the state."""


def boxes_started(targets: Detections) -> Gaussians:
    """Begin with N detections, standing still more or less."""
    n = len(targets)
    means = np.column_stack([boxes_of(targets)[:, MEASURED], np.zeros((n, 3))])
    return Gaussians(means, np.tile(np.diag(FIRST), (n, 1, 1)))


def boxes_moved(tracks: Tracklets, dt: float) -> Tracklets:
    """Come to the next tick: move x, y, z on by their velocities."""
    A = np.eye(DIMENSIONS)
    A[[0, 1, 2], [7, 8, 9]] = dt
    Q = np.diag(WALK) * dt / FRAME_S
    return shaped(tracks.moved_on(predicted(tracks.beliefs, A, Q)))


def boxes_corrected(beliefs: Gaussians, found: Detections) -> Gaussians:
    """Take a detection in for each, headings corrected first (section 3.4).

    A box says little about front and rear: where track and detection differ by more than a
    right angle, the track is turned by half.
    """
    means, measured = beliefs.means.copy(), boxes_of(found)[:, MEASURED]
    opposed = np.abs(wrap_angle(measured[:, YAW] - means[:, YAW])) > np.pi / 2
    means[opposed, YAW] += np.pi
    measured[:, YAW] = means[:, YAW] + wrap_angle(measured[:, YAW] - means[:, YAW])
    return corrected(Gaussians(means, beliefs.covariances), measured, H, R)


def planar(beliefs: Gaussians) -> Gaussians:
    """Return beliefs of x, y, vx, vy."""
    return Gaussians(beliefs.means[:, PLANE], beliefs.covariances[:, PLANE[:, None], PLANE])


def shaped(tracks: Tracklets) -> Tracklets:
    """Let the state say where boxes are and how large."""
    means = tracks.beliefs.means
    return replace(tracks, heights=means[:, 2], yaws=wrap_angle(means[:, YAW]), sizes=means[:, 4:7])
