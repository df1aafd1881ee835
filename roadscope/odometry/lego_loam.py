"""Lightweight and ground-optimised LiDAR odometry and mapping (Shan and Englot 2018).

T. Shan and B. Englot, "LeGO-LOAM: lightweight and ground-optimized lidar odometry and mapping on
variable terrain", IROS 2018. Written from the paper. If there is an IMU, each motion is predicted
from its samples as in `zhang2022`, so that both differ only in their use of scans.
"""

from __future__ import annotations

import numpy as np

from roadscope.core import ImuSamples, LidarScan, Pose
from roadscope.core.arguments import check_counts, check_positive_or_infinite
from roadscope.odometry.clock import Clock
from roadscope.odometry.lego.mapping import (
    REACH_M,
    LegoMapping,
    MappedOdometry,
    ScanToScan,
    match_two_steps,
)
from roadscope.odometry.lego.segments import LEAST, features_of, ground_and_objects
from roadscope.odometry.loam.features import Features
from roadscope.odometry.loam.progress import ImuPrediction, Progress, ScanReturns, lack_of_features
from roadscope.odometry.scatter import excessive_noise


class LegoLoamOdometry(MappedOdometry):
    """Matches ground planes for height, roll and pitch, edges for the rest, then scans with a map.

    min_points: objects with fewer returns are dropped. map_every: scans between two matches with
        the map; five is the paper's 2 Hz. reach_m: radius of the map, metres. loop: whether loops
        are closed, which corrects all earlier keyframes; the estimated pose then jumps.
    """

    def __init__(
        self,
        *,
        min_points: int = LEAST,
        map_every: int = 5,
        reach_m: float = REACH_M,
        loop: bool = False,
    ) -> None:
        check_counts(1, min_points=min_points, map_every=map_every)
        check_positive_or_infinite(reach_m=reach_m)
        self.min_points, self.map_every = min_points, map_every
        self.reach_m, self.loop = reach_m, loop
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Clear pose, speed, the last scan and the map."""
        self._clock, self._imu = Clock(), ImuPrediction(lidar_from_imu)
        self._progress = Progress(self._imu)
        self._mapping = LegoMapping(every=self.map_every, reach_m=self.reach_m, loop=self.loop)
        self._before: tuple[ScanReturns, Features] | None = None

    @property
    def matching(self) -> int:
        """The least number of returns of an object, the one setting that acts on the match."""
        return self.min_points

    def match(self, scan: LidarScan, imu: ImuSamples | None = None) -> ScanToScan:
        """Match the scan with the previous one, in two steps."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return self._matched_scan(tick.reason)
        sensor_problem = self._imu.samples.missing_samples(
            scan.stamp_s, tick.elapsed_s
        ) or excessive_noise(scan)
        returns = ground_and_objects(scan, least=self.min_points)
        since_s = self._progress.since(scan.stamp_s)
        predicted = self._progress.predicted(scan.stamp_s)
        if self._before is not None and not self._progress.begun:
            predicted = self._begin(returns, since_s, predicted)
        features = features_of(returns, returns.at_stamp(predicted, since_s))
        problem = lack_of_features(returns, features)
        if problem or self._before is None:
            self._progress.carry_on(predicted, scan.stamp_s, counts=not problem)
            self._before = self._before if problem else (returns, features)
            return self._matched_scan(tick.reason or problem or sensor_problem)
        feature_match = match_two_steps(features, self._before[1], predicted)
        motion, reason = self._progress.step(predicted, feature_match, scan.stamp_s)
        self._before = returns, features.at(returns.at_stamp(motion, since_s))
        # The features of a rejected scan must not enter the map.
        return self._matched_scan(
            tick.reason or reason or sensor_problem, None if reason else self._before[1]
        )

    def _begin(self, returns: ScanReturns, since_s: float, predicted: np.ndarray) -> np.ndarray:
        """Return the first motion, (4, 4), and deskew the first scan by it."""
        assert self._before is not None
        first, before = self._before
        now = features_of(returns, returns.at_stamp(predicted, since_s))
        motion = match_two_steps(now, before, predicted).before_from_now
        self._before = first, features_of(first, first.at_stamp(motion, since_s))
        return motion
