"""The motion between two scans, and the correction of poses by a map."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate
from roadscope.odometry.estimates import estimate
from roadscope.odometry.lego.loop_closing import LoopClosing
from roadscope.odometry.lego.point_map import Keyframe, KeyframeMap, keyframe
from roadscope.odometry.loam.feature_match import FeatureMatch, match_features
from roadscope.odometry.loam.features import Features
from roadscope.odometry.loam.progress import Progress, misfit_of, with_prediction
from roadscope.odometry.rigid import inverse, log_se3

# --------------------------------------------------------------------------------------------------
# The motion between two scans in two steps (Shan and Englot 2018, section III-D).

LEVEL = (False, False, True, True, True, False)
"""z, roll and pitch, which the ground determines."""
ALONG = (True, True, False, False, False, True)
"""x, y and yaw, which edges determine, with the others fixed."""


def match_two_steps(now: Features, before: Features, start: np.ndarray) -> FeatureMatch:
    """Return the motion by planes for height, roll and pitch, then by edges for the rest.

    start: (4, 4) `before_from_now`. The information of each step covers its own unknowns.
    """
    first = match_features(now, before, start, edges=False, free=LEVEL)
    second = match_features(now, before, first.before_from_now, planes=False, free=ALONG)
    level, along = np.diag(np.array(LEVEL, float)), np.diag(np.array(ALONG, float))
    information = level @ first.information @ level + along @ second.information @ along
    pair_count = min(first.pair_count, second.pair_count)
    return FeatureMatch(second.before_from_now, information, second.residual_m, pair_count)


# --------------------------------------------------------------------------------------------------
# Mapping (Shan and Englot 2018, section III-E).

REACH_M = 100.0
"""Radius of the map, as published."""
APART_M, APART_RAD = 0.3, 0.2
"""A scan becomes a keyframe if the LiDAR has moved or turned by more since the last one."""


class LegoMapping:
    """Corrects the odometry by a map of its keyframes, and by loops.

    every: number of scans between two matches with the map; 0: never. reach_m: keyframes nearer
    than this form the map. map_from_start: (4, 4), correction of the odometry's poses.
    """

    def __init__(self, *, every: int, reach_m: float, loop: bool) -> None:
        self.every, self.reach_m, self._offered = every, reach_m, 0
        self.loops = LoopClosing() if loop else None
        self.map_from_start = np.eye(4)
        self.keyframes: list[Keyframe] = []
        self._map, self._centre, self._driven_m = KeyframeMap(), np.zeros(3), 0.0
        self._last = np.eye(4)

    def take(self, features: Features, start_from_lidar: np.ndarray) -> None:
        """Match the features of every `every`-th scan with the map, and add those of keyframes.

        start_from_lidar: (4, 4), the odometry's pose.
        """
        is_due = self.every > 0 and self._offered % self.every == 0
        self._offered += 1
        if not is_due:
            return
        pose = self.map_from_start @ start_from_lidar
        new = keyframe(features, pose, 0.0)
        if self.keyframes:
            feature_match = self._map.match(new, pose)
            if not misfit_of(feature_match):
                pose = with_prediction(pose, feature_match)
        step = log_se3(inverse(self._last) @ pose)
        far = np.linalg.norm(step[:3]) > APART_M or np.linalg.norm(step[3:]) > APART_RAD
        if far or not self.keyframes:
            self._driven_m += float(np.linalg.norm(step[:3]))
            self._add(Keyframe(new.edges, new.planes, new.few, pose, self._driven_m))
            pose = self.keyframes[-1].map_from_lidar
        self.map_from_start = pose @ inverse(start_from_lidar)

    def _add(self, new: Keyframe) -> None:
        self.keyframes.append(new)
        self._map.add(new)
        corrected = None
        if self.loops is not None:
            self.loops.add(self.keyframes)
            corrected = self.loops.closed_by(self.keyframes)
        if corrected is not None:
            self.keyframes = corrected
        self._last = self.keyframes[-1].map_from_lidar
        position = self.keyframes[-1].place
        if corrected is not None or np.linalg.norm(position - self._centre) > self.reach_m:
            self._centre = position
            self._map = KeyframeMap(
                k for k in self.keyframes if np.linalg.norm(k.place - position) <= self.reach_m
            )


# --------------------------------------------------------------------------------------------------
# An odometry from scan to scan with a map behind it.


@dataclass(frozen=True, slots=True, eq=False)
class ScanToScan:
    """What the match of a scan with the previous one gave.

    start_from_lidar: (4, 4). covariance: (6, 6), as in `OdometryEstimate`. reason: why the pose is
        degraded, or empty. features: those that the map takes, at the stamp; None: none.
    dynamic: (N,) bool, returns of moving objects; None: none.
    """

    start_from_lidar: np.ndarray
    covariance: np.ndarray
    reason: str
    features: Features | None = None
    dynamic: np.ndarray | None = None


class MappedOdometry(ABC):
    """Matches each scan with the previous one, then the matched features with a map.

    The map corrects poses and does not act on the match. Methods whose `matching` is equal make
    the same matches, and differ in their maps alone.
    """

    _progress: Progress
    _mapping: LegoMapping

    @property
    @abstractmethod
    def matching(self) -> Hashable:
        """All settings that act on the match."""

    @abstractmethod
    def match(self, scan: LidarScan, imu: ImuSamples | None = None) -> ScanToScan:
        """Match the scan with the previous one."""

    def _matched_scan(
        self, reason: str, features: Features | None = None, dynamic: np.ndarray | None = None
    ) -> ScanToScan:
        """Return the pose after all steps so far; arguments as of `ScanToScan`."""
        progress = self._progress
        return ScanToScan(progress.pose, progress.covariance, reason, features, dynamic)

    def take(self, scan: LidarScan, matched: ScanToScan) -> OdometryEstimate:
        """Match the features of a matched scan with the map; return the corrected pose."""
        if matched.features is not None:
            self._mapping.take(matched.features, matched.start_from_lidar)
        pose = self._mapping.map_from_start @ matched.start_from_lidar
        return estimate(
            pose,
            matched.covariance,
            scan.stamp_s,
            len(scan),
            matched.reason,
            dynamic=matched.dynamic,
        )

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Match the scan with the previous one, then with the map if its turn has come."""
        return self.take(scan, self.match(scan, imu))
