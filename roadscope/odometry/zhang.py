"""LiDAR and IMU odometry in dynamic surroundings (Zhang 2022).

T. Zhang, C. Zhang and H. Wei, "Design of lidar odometer integrating lidar and IMU in dynamic
environment", Navigation Positioning and Timing 9(3), 2022. The paper's frame is x right, y down,
z ahead; ours is ISO 8855 throughout.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose
from roadscope.odometry.clock import Clock
from roadscope.odometry.clusters.features import (
    NO_PARTNER,
    ClusterMatch,
    Reading,
    cluster_features,
    match_clusters,
    of_partners,
    relabelled,
)
from roadscope.odometry.clusters.segments import Clustering, Segments, parts, segments_of
from roadscope.odometry.estimates import estimate
from roadscope.odometry.lego.mapping import REACH_M, LegoMapping
from roadscope.odometry.loam.feature_match import FeatureMatch, match_features
from roadscope.odometry.loam.features import Features
from roadscope.odometry.loam.progress import ImuPrediction, Progress, poverty
from roadscope.odometry.scatter import scattered

MANY_MOVE = 0.33
"""Where a greater share of what is in clusters would move, it is the prediction that is wrong.

On validation drives in streets and on the loop, the true motion leaves .3 (95 % of scans), and to
believe in rest .3 to .4 (5 %). Where all that is near goes along it is the other way about: the
true motion of a platoon leaves .7, rest .04. No share tells it there, and the method is lost."""


@dataclass(frozen=True, slots=True, eq=False)
class PreviousScan:
    """What the next scan is matched with.

    segments: clusters, as measured. features: of all clusters, as seen at the stamp.
    """

    segments: Segments
    features: Features


class ZhangOdometry:
    """Matches edges and planes from scan to scan, cluster by cluster, without what moves.

    eps_m, angle_deg, min_points: of the clustering (table 1). windows: whether the angle bounds
        clusters, see `parts`, or links alone. A wall that is one cluster wherever it goes has
        another centre as soon as something hides a part of it, and moves as a whole; the paper
        drops the parts of walls that only one of the scans shows. With columns as wide as a
        degree such clusters give too few features, and the way is lost.
    still_m, still_m_s, view, sampled: a cluster is dynamic whose centre moved farther than the
        first, plus the second times the time between the scans, plus the third times the own way,
        and farther than the fourth times its range: beams spread, so that far away the same thing
        is told by other returns in every scan. The paper prints no threshold. view: None: 0, or 1
        where links alone are bounded: what is seen of a whole wall goes along with the sensor;
        then nobody is dynamic who is slower.
    roughness: eq. 6 among neighbours on the ring or, as printed, in the whole cluster.
    drop_dynamic, same_cluster: the paper's two additions to LOAM, which can be left out.
    map_every, loop: so many scans to a look at LeGO-LOAM's map, 0 for none, and whether its loops
        are closed. Section 2 goes from scan to scan; section 3 speaks of SLAM, and of the loops
        that LeGO-LOAM closes as a reason why both systems end near the truth: the chain may have
        stood before LeGO-LOAM's map.
    """

    def __init__(
        self,
        *,
        eps_m: float = 0.02,
        angle_deg: float = 5.0,
        min_points: int = 30,
        windows: bool = True,
        still_m: float = 0.05,
        still_m_s: float = 0.5,
        view: float | None = None,
        sampled: float = 0.01,
        roughness: Reading = "ring",
        drop_dynamic: bool = True,
        same_cluster: bool = True,
        map_every: int = 0,
        loop: bool = False,
    ) -> None:
        if roughness not in get_args(Reading):
            raise ValueError(f"roughness is 'ring' or 'cluster', got {roughness!r}")
        if map_every < 0:
            raise ValueError(f"map_every must be 0 or more, got {map_every!r}")
        if loop and not map_every:
            raise ValueError("loops are closed in a map: loop asks for map_every of 1 or more")
        self.clustering, self.windows = Clustering(eps_m, angle_deg, min_points), windows
        self.still_m, self.still_m_s, self.sampled = still_m, still_m_s, sampled
        self.view = float(not windows) if view is None else view
        self.roughness = roughness
        self.drop_dynamic, self.same_cluster = drop_dynamic, same_cluster
        self.map_every, self.loop = map_every, loop
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Forget pose, speed, the last scan and the map."""
        self._clock, self._imu = Clock(), ImuPrediction(lidar_from_imu)
        self._progress = Progress(self._imu)
        self._mapping = LegoMapping(every=self.map_every, reach_m=REACH_M, loop=self.loop)
        self._before: PreviousScan | None = None

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Match the scan with the one before and say where that puts the sensor."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return self._told(scan, tick.reason)
        lack = self._imu.samples.lack(scan.stamp_s, tick.elapsed_s) or scattered(scan)
        whole = segments_of(scan, self.clustering)  # section 2.1
        since_s = self._progress.since(scan.stamp_s)
        predicted = self._progress.predicted(scan.stamp_s)  # eq. 3
        if self._before is not None and not self._progress.begun:
            predicted = self._begin(whole, since_s, predicted)
        segments = self.cut(whole, predicted)
        features = self._features(segments, predicted, since_s)  # eq. 5 and 6
        poor = poverty(segments, features)
        if poor or self._before is None:
            self._progress.carry_on(predicted, scan.stamp_s, counts=not poor)
            self._before = self._before if poor else self._moment(whole, features)
            return self._told(scan, tick.reason or poor or lack)
        clusters = self.compared(segments, self._before.segments, predicted, since_s)  # eq. 4
        found, dropped = self._matched(features, clusters, segments.sizes, predicted)  # eq. 7-10
        motion, reason = self._progress.step(predicted, found, scan.stamp_s)
        # As LOAM does: the next scan meets these features where their own sweep's motion, now
        # known, puts them.
        placed = features.at(segments.at_stamp(motion, since_s))
        self._before = self._moment(whole, placed)
        if not reason:
            stays = np.where(dropped, NO_PARTNER, np.arange(len(dropped)))
            self._mapping.take(relabelled(placed, stays), self._progress.pose)
        return self._told(scan, tick.reason or reason or lack, returns_of(scan, segments, dropped))

    def cut(self, whole: Segments, before_from_now: np.ndarray) -> Segments:
        """Return clusters cut by the angle as seen from the scan before, if it bounds them."""
        angle_deg = self.clustering.angle_deg
        return parts(whole, angle_deg, before_from_now) if self.windows else whole

    def _moment(self, whole: Segments, features: Features) -> PreviousScan:
        """Return what the next scan is matched with: features are of clusters seen from here."""
        own = self.cut(whole, np.eye(4))
        edges, planes = own.labels[features.edge_rows], own.labels[features.plane_rows]
        return PreviousScan(own, replace(features, edge_labels=edges, plane_labels=planes))

    def _features(self, segments: Segments, motion: np.ndarray, since_s: float) -> Features:
        """Undo the sweep's own motion and take the roughest and smoothest of each cluster."""
        points = segments.at_stamp(motion, since_s)
        return cluster_features(points, segments, self.roughness, sectors=not self.windows)

    def compared(
        self, now: Segments, before: Segments, predicted: np.ndarray, since_s: float
    ) -> ClusterMatch:
        """Match the clusters of two scans and say which are dynamic.

        predicted: (4, 4) `before_from_now`. since_s: time between the scans, seconds.
        """
        way_m = float(np.linalg.norm(predicted[:3, 3]))
        least_m = self.still_m + self.still_m_s * since_s + self.view * way_m
        thresholds_m = np.maximum(least_m, self.sampled * np.linalg.norm(now.centres, axis=1))
        return match_clusters(now.centres, before.centres, predicted, thresholds_m)

    def _matched(
        self, features: Features, clusters: ClusterMatch, sizes: np.ndarray, start: np.ndarray
    ) -> tuple[FeatureMatch, np.ndarray]:
        """Match without dynamic clusters and say which, (K,) bool, those are.

        sizes: (K,) returns in each. Where too much of what is seen would move, an error of the
        prediction is taken for motion of everything, and would be for ever: then all features are
        matched, of whatever cluster.
        """
        assert self._before is not None
        none = np.zeros_like(clusters.dynamic)
        if not _believed(clusters, sizes) or not (self.drop_dynamic or self.same_cluster):
            return match_features(features, self._before.features, start, same_label=False), none
        now, before = of_partners(
            features, self._before.features, clusters, still_only=self.drop_dynamic
        )
        found = match_features(now, before, start, same_label=self.same_cluster)
        return found, clusters.dynamic if self.drop_dynamic else none

    def _begin(self, whole: Segments, since_s: float, predicted: np.ndarray) -> np.ndarray:
        """Return the first motion, (4, 4): as predicted from rest, or from all features.

        Before a step has told the speed, an IMU does not: a start at speed would be taken for
        clusters that all move. Features of the first scan are then taken anew.
        """
        assert self._before is not None
        now = self.cut(whole, predicted)
        clusters = self.compared(now, self._before.segments, predicted, since_s)
        if _believed(clusters, now.sizes):
            return predicted
        seen = self._features(now, predicted, since_s)
        found = match_features(seen, self._before.features, predicted, same_label=False)
        motion, first = found.before_from_now, self._before.segments
        self._before = PreviousScan(first, self._features(first, motion, since_s))
        return motion

    def _told(
        self, scan: LidarScan, reason: str, moving: np.ndarray | None = None
    ) -> OdometryEstimate:
        pose = self._mapping.map_from_start @ self._progress.pose
        covariance = self._progress.covariance
        return estimate(pose, covariance, scan.stamp_s, len(scan), reason, dynamic=moving)


def _believed(clusters: ClusterMatch, sizes: np.ndarray) -> bool:
    """Return whether a prediction has most returns, (K,) to a cluster, stand still."""
    return bool(sizes[clusters.dynamic].sum() <= MANY_MOVE * sizes.sum())


def dynamic_returns(
    rule: ZhangOdometry, before: LidarScan, now: LidarScan, predicted: np.ndarray
) -> np.ndarray:
    """Return which returns of a scan, (N,) bool, are dynamic beside another (section 2.1 alone).

    predicted: (4, 4) `before_from_now`.
    """
    earlier = rule.cut(segments_of(before, rule.clustering), np.eye(4))
    later = rule.cut(segments_of(now, rule.clustering), predicted)
    clusters = rule.compared(later, earlier, predicted, now.stamp_s - before.stamp_s)
    return returns_of(now, later, clusters.dynamic)


def returns_of(scan: LidarScan, segments: Segments, dropped: np.ndarray) -> np.ndarray:
    """Return which returns of the scan, (N,) bool, are of clusters, (K,) bool, that are dropped."""
    moving, inside = np.zeros(len(scan), bool), segments.labels >= 0
    moving[segments.rows[inside]] = dropped[segments.labels[inside]]
    return moving
