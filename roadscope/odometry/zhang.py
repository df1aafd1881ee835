"""LiDAR and IMU odometry in dynamic surroundings (Zhang 2022).

T. Zhang, C. Zhang and H. Wei, "Design of lidar odometer integrating lidar and IMU in dynamic
environment", Navigation Positioning and Timing 9(3), 2022. The paper's frame is x right, y down,
z ahead; ours is ISO 8855 throughout.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose
from roadscope.odometry.clock import Clock
from roadscope.odometry.clusters.cluster_features import of_partners
from roadscope.odometry.clusters.cluster_match import ClusterMatch, match_clusters
from roadscope.odometry.clusters.roughness import Reading, cluster_features
from roadscope.odometry.clusters.segments import Clustering, Segments, segments_of
from roadscope.odometry.estimates import estimate
from roadscope.odometry.loam.feature_match import FeatureMatch, match_features
from roadscope.odometry.loam.features import Features
from roadscope.odometry.loam.imu_prediction import ImuPrediction
from roadscope.odometry.loam.progress import Progress, misfit_of
from roadscope.odometry.loam.returns import poverty


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What the next scan is matched with.

    segments: clusters, as measured. features: of all clusters, as seen at the stamp.
    """

    segments: Segments
    features: Features


class ZhangOdometry:
    """Matches edges and planes from scan to scan, cluster by cluster, without what moves.

    eps_m, angle_deg, min_points: of the clustering (table 1). windows: whether the angle bounds
        clusters or links alone. A wall that is one cluster wherever it goes has another centre
        as soon as something hides a part of it, and moves as a whole; the paper drops the parts
        of walls that only one of the scans shows. On roads and with wide columns windows leave too
        few features, and the way is lost; so links alone are bounded unless told otherwise.
    still_m, still_m_s, view: a cluster is dynamic whose centre moved farther than the first, plus
        the second times the time between the scans, plus the third times the own way: what is
        seen of a wall goes along with the sensor. The paper prints no threshold. With a view of 1
        nobody who is slower than the sensor is dynamic; with 0 walls are, as one drives.
    roughness: eq. 6 among neighbours on the ring or, as printed, in the whole cluster.
    drop_dynamic, same_cluster: the paper's two additions to LOAM, which can be left out.
    """

    def __init__(
        self, *, eps_m: float = 0.02, angle_deg: float = 5.0, min_points: int = 30,
        windows: bool = False, still_m: float = 0.05, still_m_s: float = 0.5,
        view: float = 1.0, roughness: Reading = "ring",
        drop_dynamic: bool = True, same_cluster: bool = True,
    ) -> None:  # fmt: skip
        if roughness not in get_args(Reading):
            raise ValueError(f"roughness is 'ring' or 'cluster', got {roughness!r}")
        self.clustering = Clustering(eps_m, angle_deg, min_points, windows)
        self.still_m, self.still_m_s, self.view = still_m, still_m_s, view
        self.roughness = roughness
        self.drop_dynamic, self.same_cluster = drop_dynamic, same_cluster
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Forget pose, speed and the last scan."""
        self._clock, self._imu = Clock(), ImuPrediction(lidar_from_imu)
        self._progress = Progress(self._imu)
        self._before: Moment | None = None

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Match the scan with the one before and say where that puts the sensor."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return self._told(scan, tick.reason)
        lack = self._imu.samples.lack(scan.stamp_s, tick.elapsed_s)
        segments = segments_of(scan, self.clustering)  # section 2.1
        since_s = self._progress.since(scan.stamp_s)
        predicted = self._progress.predicted(scan.stamp_s)  # eq. 3
        if self._before is not None and not self._progress.begun:
            predicted = self._begin(segments, since_s, predicted)
        features = self._features(segments, predicted, since_s)  # eq. 5 and 6
        poor = poverty(segments, features)
        if poor or self._before is None:
            self._progress.carry_on(predicted, scan.stamp_s, counts=not poor)
            self._before = self._before if poor else Moment(segments, features)
            return self._told(scan, tick.reason or poor or lack)
        clusters = self._same_clusters(segments, predicted, since_s)  # eq. 4
        found, dropped = self._matched(features, clusters, predicted)  # eq. 7 to 10
        motion, reason = self._progress.step(predicted, found, scan.stamp_s)
        # As LOAM does: the next scan meets these features where their own sweep's motion, now
        # known, puts them.
        self._before = Moment(segments, features.at(segments.at_stamp(motion, since_s)))
        return self._told(scan, tick.reason or reason or lack, returns_of(scan, segments, dropped))

    def _features(self, segments: Segments, motion: np.ndarray, since_s: float) -> Features:
        """Undo the sweep's own motion and take the roughest and smoothest of each cluster."""
        points, sectors = segments.at_stamp(motion, since_s), not self.clustering.windows
        return cluster_features(points, segments, self.roughness, sectors=sectors)

    def _same_clusters(
        self, segments: Segments, predicted: np.ndarray, since_s: float
    ) -> ClusterMatch:
        assert self._before is not None
        return self.compared(segments, self._before.segments, predicted, since_s)

    def compared(
        self, now: Segments, before: Segments, predicted: np.ndarray, since_s: float
    ) -> ClusterMatch:
        """Match the clusters of two scans and say which are dynamic.

        predicted: (4, 4) `before_from_now`. since_s: time between the scans, seconds.
        """
        way_m = float(np.linalg.norm(predicted[:3, 3]))
        threshold_m = self.still_m + self.still_m_s * since_s + self.view * way_m
        return match_clusters(now.centres, before.centres, predicted, threshold_m)

    def _matched(
        self, features: Features, clusters: ClusterMatch, start: np.ndarray
    ) -> tuple[FeatureMatch, np.ndarray]:
        """Match without dynamic clusters and say which, (K,) bool, those are.

        Where they leave too little, an error of the prediction is taken for motion of everything,
        and would be for ever: then all clusters that have a partner are matched.
        """
        if self.drop_dynamic:
            found = self._match(features, clusters, start, still_only=True)
            if not misfit_of(found):
                return found, clusters.dynamic
        found = self._match(features, clusters, start, still_only=False)
        return found, np.zeros_like(clusters.dynamic)

    def _match(
        self, features: Features, clusters: ClusterMatch, start: np.ndarray, *, still_only: bool
    ) -> FeatureMatch:
        """Move features onto those before, from the prediction on."""
        assert self._before is not None
        now, before = features, self._before.features
        if still_only or self.same_cluster:
            now, before = of_partners(now, before, clusters, still_only=still_only)
        return match_features(now, before, start, same_label=self.same_cluster)

    def _begin(self, segments: Segments, since_s: float, predicted: np.ndarray) -> np.ndarray:
        """Return the first motion, (4, 4), from features of all clusters that have a partner.

        Before a step has told the speed, an IMU does not: a start at speed would be taken for
        clusters that all move. Features of the first scan are then taken anew.
        """
        assert self._before is not None
        features = self._features(segments, predicted, since_s)
        clusters = self._same_clusters(segments, predicted, since_s)
        motion = self._match(features, clusters, predicted, still_only=False).before_from_now
        before = self._before.segments
        self._before = Moment(before, self._features(before, motion, since_s))
        return motion

    def _told(
        self, scan: LidarScan, reason: str, moving: np.ndarray | None = None
    ) -> OdometryEstimate:
        at = self._progress
        return estimate(at.pose, at.covariance, scan.stamp_s, len(scan), reason, dynamic=moving)


def dynamic_returns(
    rule: ZhangOdometry, before: LidarScan, now: LidarScan, predicted: np.ndarray
) -> np.ndarray:
    """Return which returns of a scan, (N,) bool, are dynamic beside another (section 2.1 alone).

    predicted: (4, 4) `before_from_now`.
    """
    earlier, later = segments_of(before, rule.clustering), segments_of(now, rule.clustering)
    clusters = rule.compared(later, earlier, predicted, now.stamp_s - before.stamp_s)
    return returns_of(now, later, clusters.dynamic)


def returns_of(scan: LidarScan, segments: Segments, dropped: np.ndarray) -> np.ndarray:
    """Return which returns of the scan, (N,) bool, are of clusters, (K,) bool, that are dropped."""
    moving, inside = np.zeros(len(scan), bool), segments.labels >= 0
    moving[segments.rows[inside]] = dropped[segments.labels[inside]]
    return moving
