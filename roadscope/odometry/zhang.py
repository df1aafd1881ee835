"""LiDAR and IMU odometry in dynamic surroundings (Zhang 2022).

T. Zhang, C. Zhang and H. Wei, "Design of lidar odometer integrating lidar and IMU in dynamic
environment", Navigation Positioning and Timing 9(3), 2022. The paper's frame is x right, y down,
z ahead; ours is ISO 8855 throughout.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np

from roadscope.core import ImuSamples, LidarScan, Pose
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
from roadscope.odometry.lego.mapping import REACH_M, LegoMapping, MappedOdometry, ScanToScan
from roadscope.odometry.loam.feature_match import FeatureMatch, match_features
from roadscope.odometry.loam.features import Features
from roadscope.odometry.loam.progress import ImuPrediction, Progress, lack_of_features
from roadscope.odometry.scatter import excessive_noise

LARGEST_DYNAMIC_SHARE = 0.33
"""Largest share of clustered returns that a guarded odometry lets be dynamic; with more, the
prediction is wrong.

On validation drives in streets and on the loop, the share is at most 0.3 with the true motion (95 %
of scans), and at least 0.3 to 0.4 if rest is assumed (95 %). In a platoon, where everything near
moves along, it is the opposite: 0.7 with the true motion, 0.04 with rest. No threshold works there,
and the method fails."""


@dataclass(frozen=True, slots=True, eq=False)
class PreviousScan:
    """The previous scan, which the next one is matched with.

    segments: clusters, as measured. features: of all clusters, at the stamp.
    """

    segments: Segments
    features: Features


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicThreshold:
    """How far the centre of a cluster must have moved for the cluster to be dynamic (eq. 4).

    The paper states no threshold. It is `still_m`, plus `still_m_s` times the time between the
    scans, plus `view` times the ego motion, and at least `sampled` times the range.

    still_m, still_m_s: metres, and metres per second.
    view: share of the ego motion that is added. The visible part of a wall moves with the sensor,
        and so does its centre if the wall is one cluster. None: 1 if the angle bounds only links,
        so that walls are whole, otherwise 0. With 1, objects slower than the sensor are not
        dynamic.
    sampled: share of the range. Beams diverge, so a far object has other returns in every scan. If
        one beam misses it, its centre rises or falls by half the distance between two beams: for a
        VLP-16 that is 1.7 % of the range.
    dimensions: those in which the motion is measured: 3 as in eq. 4, or 2, x and y.
    """

    still_m: float = 0.05
    still_m_s: float = 0.5
    view: float | None = None
    sampled: float = 0.02
    dimensions: int = 3

    def __post_init__(self) -> None:
        if self.dimensions not in (2, 3):
            raise ValueError(f"dimensions is 2 or 3, got {self.dimensions!r}")

    def distances_m(self, ranges_m: np.ndarray, since_s: float, own_motion_m: float) -> np.ndarray:
        """Return the least distance of each cluster, (K,) m, by the range of its centre."""
        assert self.view is not None
        least_m = self.still_m + self.still_m_s * since_s + self.view * own_motion_m
        return np.maximum(least_m, self.sampled * ranges_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class ZhangSettings:
    """Settings of the odometry.

    clustering: eps_m, angle_deg, min_points and spacings, see `Clustering`.
    windows: whether the angle bounds clusters, see `parts`, or only links. A whole wall as one
        cluster has another centre as soon as something hides a part of it, and then seems to move;
        the paper drops the parts of walls that are visible in only one of the scans. With columns
        of a degree such clusters have too few features, and the method fails.
    threshold: of the motion of dynamic clusters, see `DynamicThreshold`.
    guarded: whether the prediction is rejected if it makes more than `LARGEST_DYNAMIC_SHARE` of all
        returns dynamic. Then all features are matched, regardless of clusters. The same is done for
        the first motion, before which the speed is unknown. Neither is in the paper.
    roughness: eq. 6 among neighbours on the ring or, as printed, in the whole cluster.
    drop_dynamic, same_cluster: the paper's two additions to LOAM, which can be switched off.
    map_every, loop: scans between two matches with LeGO-LOAM's map, 0 for none, and whether loops
        are closed. Section 2 describes scan-to-scan matching. Section 3 speaks of SLAM, and says
        that both systems end near the truth because LeGO-LOAM closes loops: the authors may have
        combined their method with LeGO-LOAM's map.
    """

    clustering: Clustering = field(default_factory=Clustering)
    windows: bool = True
    threshold: DynamicThreshold = field(default_factory=DynamicThreshold)
    guarded: bool = False
    roughness: Reading = "ring"
    drop_dynamic: bool = True
    same_cluster: bool = True
    map_every: int = 0
    loop: bool = False

    def __post_init__(self) -> None:
        if self.roughness not in get_args(Reading):
            raise ValueError(f"roughness is 'ring' or 'cluster', got {self.roughness!r}")
        if self.map_every < 0:
            raise ValueError(f"map_every must be 0 or more, got {self.map_every!r}")
        if self.loop and not self.map_every:
            raise ValueError("loops are closed in a map: loop asks for map_every of 1 or more")


class ZhangOdometry(MappedOdometry):
    """Matches edges and planes from scan to scan, cluster by cluster, without dynamic clusters."""

    def __init__(self, settings: ZhangSettings = ZhangSettings()) -> None:
        view = settings.threshold.view
        view = float(not settings.windows) if view is None else view
        self.clustering, self.settings = settings.clustering, settings
        self.threshold = replace(settings.threshold, view=view)
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Clear pose, speed, the last scan and the map."""
        self._clock, self._imu = Clock(), ImuPrediction(lidar_from_imu)
        self._progress = Progress(self._imu)
        self._mapping = LegoMapping(
            every=self.settings.map_every, reach_m=REACH_M, loop=self.settings.loop
        )
        self._before: PreviousScan | None = None

    @property
    def matching(self) -> ZhangSettings:
        """All settings but those of the map."""
        return replace(self.settings, map_every=0, loop=False)

    def match(self, scan: LidarScan, imu: ImuSamples | None = None) -> ScanToScan:
        """Match the static clusters of the scan with those of the previous one."""
        self._imu.add(imu)
        tick = self._clock.tick(scan.stamp_s)
        if not tick.in_order:
            return self._matched_scan(tick.reason)
        sensor_problem = self._imu.samples.missing_samples(
            scan.stamp_s, tick.elapsed_s
        ) or excessive_noise(scan)
        whole = segments_of(scan, self.clustering)  # section 2.1
        since_s = self._progress.since(scan.stamp_s)
        predicted = self._progress.predicted(scan.stamp_s)  # eq. 3
        if self.settings.guarded and self._before is not None and not self._progress.begun:
            predicted = self._begin(whole, since_s, predicted)
        segments = self.cut(whole, predicted)
        features = self._features(segments, predicted, since_s)  # eq. 5 and 6
        problem = lack_of_features(segments, features)
        if problem or self._before is None:
            self._progress.carry_on(predicted, scan.stamp_s, counts=not problem)
            self._before = self._before if problem else self._previous_scan(whole, features)
            return self._matched_scan(tick.reason or problem or sensor_problem)
        clusters = self.compared(segments, self._before.segments, predicted, since_s)  # eq. 4
        feature_match, dropped = self._matched(
            features, clusters, segments.sizes, predicted
        )  # eq. 7-10
        motion, reason = self._progress.step(predicted, feature_match, scan.stamp_s)
        # As in LOAM, the features are deskewed again with the motion that is now known.
        placed = features.at(segments.at_stamp(motion, since_s))
        self._before = self._previous_scan(whole, placed)
        stays = np.where(dropped, NO_PARTNER, np.arange(len(dropped)))
        return self._matched_scan(
            tick.reason or reason or sensor_problem,
            None if reason else relabelled(placed, stays),
            returns_of(scan, segments, dropped),
        )

    def cut(self, whole: Segments, before_from_now: np.ndarray) -> Segments:
        """Return the clusters cut from the previous scan's position, if the angle bounds them."""
        angle_deg = self.clustering.angle_deg
        return parts(whole, angle_deg, before_from_now) if self.settings.windows else whole

    def _previous_scan(self, whole: Segments, features: Features) -> PreviousScan:
        """Return a scan to match the next one with; its clusters are cut from its own position."""
        own = self.cut(whole, np.eye(4))
        edges, planes = own.labels[features.edge_rows], own.labels[features.plane_rows]
        return PreviousScan(own, replace(features, edge_labels=edges, plane_labels=planes))

    def _features(self, segments: Segments, motion: np.ndarray, since_s: float) -> Features:
        """Return the roughest and smoothest returns of each cluster, deskewed."""
        points = segments.at_stamp(motion, since_s)
        return cluster_features(
            points, segments, self.settings.roughness, sectors=not self.settings.windows
        )

    def compared(
        self, now: Segments, before: Segments, predicted: np.ndarray, since_s: float
    ) -> ClusterMatch:
        """Match the clusters of two scans and find the dynamic ones.

        predicted: (4, 4) `before_from_now`. since_s: time between the scans, seconds.
        """
        own_motion_m = float(np.linalg.norm(predicted[:3, 3]))
        ranges_m = np.linalg.norm(now.centres, axis=1)
        return match_clusters(
            now.centres,
            before.centres,
            predicted,
            self.threshold.distances_m(ranges_m, since_s, own_motion_m),
            dimensions=self.threshold.dimensions,
        )

    def _matched(
        self, features: Features, clusters: ClusterMatch, sizes: np.ndarray, start: np.ndarray
    ) -> tuple[FeatureMatch, np.ndarray]:
        """Return the match without dynamic clusters, and (K,) whether a cluster is dropped.

        sizes: (K,) returns in each.
        """
        assert self._before is not None
        none = np.zeros_like(clusters.dynamic)
        is_doubted = self.settings.guarded and not _is_plausible(clusters, sizes)
        if is_doubted or not (self.settings.drop_dynamic or self.settings.same_cluster):
            return match_features(features, self._before.features, start, same_label=False), none
        now, before = of_partners(
            features, self._before.features, clusters, still_only=self.settings.drop_dynamic
        )
        feature_match = match_features(now, before, start, same_label=self.settings.same_cluster)
        return feature_match, clusters.dynamic if self.settings.drop_dynamic else none

    def _begin(self, whole: Segments, since_s: float, predicted: np.ndarray) -> np.ndarray:
        """Return the first motion, (4, 4): as predicted from rest, or from all features.

        Before the first step the speed is unknown, also with an IMU: at a start at speed, all
        clusters would seem to move. The features of the first scan are then computed again.
        """
        assert self._before is not None
        now = self.cut(whole, predicted)
        clusters = self.compared(now, self._before.segments, predicted, since_s)
        if _is_plausible(clusters, now.sizes):
            return predicted
        features = self._features(now, predicted, since_s)
        feature_match = match_features(features, self._before.features, predicted, same_label=False)
        motion, first = feature_match.before_from_now, self._before.segments
        self._before = PreviousScan(first, self._features(first, motion, since_s))
        return motion


def _is_plausible(clusters: ClusterMatch, sizes: np.ndarray) -> bool:
    """Return whether a prediction leaves most returns static; sizes: (K,) of clusters."""
    return bool(sizes[clusters.dynamic].sum() <= LARGEST_DYNAMIC_SHARE * sizes.sum())


def dynamic_returns(
    rule: ZhangOdometry, before: LidarScan, now: LidarScan, predicted: np.ndarray
) -> np.ndarray:
    """Return (N,) whether returns of a scan are dynamic, from another scan (section 2.1 alone).

    predicted: (4, 4) `before_from_now`.
    """
    earlier = rule.cut(segments_of(before, rule.clustering), np.eye(4))
    later = rule.cut(segments_of(now, rule.clustering), predicted)
    clusters = rule.compared(later, earlier, predicted, now.stamp_s - before.stamp_s)
    return returns_of(now, later, clusters.dynamic)


def returns_of(scan: LidarScan, segments: Segments, dropped: np.ndarray) -> np.ndarray:
    """Return (N,) whether returns of the scan belong to dropped clusters, (K,) bool."""
    moving, inside = np.zeros(len(scan), bool), segments.labels >= 0
    moving[segments.rows[inside]] = dropped[segments.labels[inside]]
    return moving
