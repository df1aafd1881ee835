"""How long the stages of our methods take, and which methods are slower than they should be.

    python -m research.speed_stages [detectors] [odometry] [goals]

`detectors`: each stage of the detectors that cluster, on three LiDARs. `odometry`: each stage of
Zhang 2022's odometry, on three LiDARs and in the corridor of the paper. `goals`: runs `roadscope
speed` and shows what misses its goal.

All of it in processor time, summed over threads: what one core needs for it, whatever else runs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import process_time
from typing import Any, NamedTuple, Protocol

import numpy as np

from research.studies import run_speed_study
from roadscope import Episode, Frame, ImuSamples, LidarScan, Pose
from roadscope.benchmarks.drive_steps import drive, imu_mounting
from roadscope.benchmarks.papers.zhang2022_scene import LIDAR_FROM_IMU, STANDING, sense_corridor
from roadscope.benchmarks.speed.detectors import RUNS, DrivenScene, driven_frames
from roadscope.benchmarks.speed.measure import measure_speed
from roadscope.benchmarks.speed.odometry import DURATION_S, LARGER, RIG, SCENARIO, SEED
from roadscope.benchmarks.speed.rows import SpeedRow, SpeedStep, interleaved
from roadscope.core import Bounds
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering import CLUSTERINGS
from roadscope.detectors.ground import GROUNDS
from roadscope.detectors.ground.polar import polar_above_ground
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape import SHAPES
from roadscope.detectors.shape.cluster import Cluster, clusters
from roadscope.odometry.above_ground import sensor_height, standing
from roadscope.odometry.clusters.features import cluster_features, of_partners
from roadscope.odometry.clusters.segments import Clustering, segments_of
from roadscope.odometry.loam.feature_match import match_features
from roadscope.odometry.loam.progress import ImuPrediction
from roadscope.odometry.zhang import ZhangOdometry

STAGE_SCENE, STAGE_FRAMES = DrivenScene("intersection"), 4
"""Stages run on the last of these frames: traffic, buildings and parked cars on all sides."""
GROUND, CLUSTERING = "grid", "distance"
"""The stages before the one that is measured; `distance` makes most clusters."""
HALF_VIEW_RAD = np.radians(55.0)
CLUSTERED, CUT = "clustering by range and angle", "clusters cut by the angle"
LABELLED = "clusters matched, dynamic or not"
PREDICTED = "prediction by the IMU"
MATCHED = "Levenberg-Marquardt on edges and planes"
ZHANG_2022 = SpeedRow("Zhang 2022 as printed, VLP-16", 17.9, "ms")
"""A frame of a VLP-16, on the paper's own computer."""


class Goal(NamedTuple):
    """Rows whose name matches a pattern, and the most milliseconds that they should have."""

    pattern: str
    most_ms: float


GOALS = (
    Goal(r"detector .*, (hdl64e|hdl32e), slowest frame", 100.0),
    Goal(r"detector .*, lux, slowest frame", 5.0),
    Goal(r"tracker [^,]*, 200 targets(, p90)?", 1.0),
    Goal(r"tracker jpda, 50 targets(, p90)?", 2.0),
    Goal(r"tracker jpda, 12 crowded targets(, p90)?", 10.0),
    Goal(rf"odometry (?!kiss-icp|small-gicp|genz-icp|rko-lio)[^,]*, {RIG}", 8.0),
    Goal(rf"clustering and labelling, ({RIG}|corridor)", 2.0),
    Goal(r"network bf16, 640 x 480", 33.3),
)
"""Chosen by hand."""
LEAST_RATES = {"images plain colours, 1280 x 960": 60.0, "images with everything, 1280 x 960": 25.0}
"""Images a second that should be drawn, with depth and instances. Chosen by hand."""


def detector_steps(repeats: int = 3) -> list[SpeedStep]:
    """Return a step for each rig."""
    return [
        SpeedStep(f"stages, {rig}", partial(measure_detector_stages, rig, repeats)) for rig in RUNS
    ]


def measure_detector_stages(rig: str, repeats: int) -> list[SpeedRow]:
    """Measure each stage of the detectors that cluster, alone, on one frame."""
    frame = driven_frames(rig, STAGE_FRAMES, STAGE_SCENE)[-1]
    if frame.lidar is None:
        raise ValueError(f"the rig '{rig}' has no LiDAR")
    rows = [SpeedRow(f"returns, {rig}", float(len(frame.lidar)), "points")]
    times = interleaved(_detector_stages(frame), repeats, process_time)
    return rows + [
        SpeedRow(f"{name}, {rig}", seconds * 1e3, "ms") for name, seconds in times.items()
    ]


def _detector_stages(frame: Frame) -> dict[str, Callable[[], Any]]:
    """Return every stage as a call, with what the stages before it return."""
    scan = frame.lidar
    assert scan is not None
    pose = frame.calibration.pose(scan.sensor)
    view = Bounds(pose.yaw - HALF_VIEW_RAD, pose.yaw + HALF_VIEW_RAD)
    cloud = Cloud.of(scan, pose)
    above = GROUNDS[GROUND](cloud)
    remaining = cloud.select(above)
    labels = CLUSTERINGS[CLUSTERING](remaining)
    horizon, all_clusters = Horizon.of(cloud, above, view), list(clusters(remaining, labels))
    calls: dict[str, Callable[[], Any]] = {"cloud": partial(Cloud.of, scan, pose)}
    for name, ground in GROUNDS.items():
        calls[f"ground {name}"] = partial(ground, cloud)
    calls["horizon"] = partial(Horizon.of, cloud, above, view)
    for name, clustering in CLUSTERINGS.items():
        calls[f"clustering {name}"] = partial(clustering, remaining)
    calls["clusters and outlines"] = lambda: list(clusters(remaining, labels))
    for name, shape in SHAPES.items():
        calls[f"shape {name}"] = partial(_fit_all, shape, all_clusters, horizon)
    return calls


def _fit_all(shape: Callable[..., Any], all_clusters: Sequence[Cluster], horizon: Horizon) -> None:
    for cluster in all_clusters:
        shape(cluster, horizon)


def points_above_ground(frame: Frame) -> Cloud:
    """Return the returns of a frame without those of the ground."""
    scan = frame.lidar
    assert scan is not None
    cloud = Cloud.of(scan, frame.calibration.pose(scan.sensor))
    return cloud.select(GROUNDS[GROUND](cloud))


class SensedScan(Protocol):
    """A scan and the IMU samples up to it."""

    @property
    def scan(self) -> LidarScan:
        """The scan."""

    @property
    def imu(self) -> ImuSamples | None:
        """Samples since the scan before."""


class ScanPair(NamedTuple):
    """Two successive scans of one place.

    before_from_now: (4, 4), the motion as a good prediction has it.
    lidar_from_imu: how the IMU is mounted, None without one.
    """

    place: str
    before: SensedScan
    now: SensedScan
    before_from_now: np.ndarray
    lidar_from_imu: Pose | None


def odometry_steps(repeats: int = 7) -> list[SpeedStep]:
    """Return a step for each rig, and one for the corridor of the paper."""
    steps = [
        SpeedStep(f"stages, {rig}", partial(measure_odometry_stages, rig, repeats))
        for rig in (RIG, *LARGER)
    ]
    return [*steps, SpeedStep("stages, corridor", partial(measure_corridor_stages, repeats))]


def measure_odometry_stages(rig: str, repeats: int) -> list[SpeedRow]:
    """Measure each stage of Zhang 2022's chain alone on one scan of a street."""
    episode = Episode(SCENARIO, SEED, rig, DURATION_S)
    *_, before, now = drive(episode)
    motion = (before.world_from_lidar.inverse() @ now.world_from_lidar).matrix
    return _stage_rows(ScanPair(rig, before, now, motion, imu_mounting(episode)), repeats)


def measure_corridor_stages(repeats: int) -> list[SpeedRow]:
    """Measure the same on a scan of the paper's corridor, where more returns are of walls."""
    *_, before, now = sense_corridor(replace(STANDING, scans=2), SEED)
    pair = ScanPair("corridor", before, now, np.eye(4), LIDAR_FROM_IMU)
    return [*_stage_rows(pair, repeats), ZHANG_2022]


def _stage_rows(pair: ScanPair, repeats: int) -> list[SpeedRow]:
    imu = ImuPrediction(pair.lidar_from_imu)
    for each in (pair.before, pair.now):
        imu.add(each.imu)
    before, now = pair.before.scan, pair.now.scan
    calls = odometry_stages(before, now, pair.before_from_now) | {
        PREDICTED: partial(imu.motion, before.stamp_s, now.stamp_s)
    }
    times = interleaved(calls, repeats, process_time)
    rows = [
        SpeedRow(f"{name}, {pair.place}", seconds * 1e3, "ms") for name, seconds in times.items()
    ]
    # Cut twice: as seen from either scan.
    whole_ms = 1e3 * (times[CLUSTERED] + 2 * times[CUT] + times[LABELLED])
    return [*rows, SpeedRow(f"clustering and labelling, {pair.place}", whole_ms, "ms")]


def odometry_stages(
    before: LidarScan, now: LidarScan, before_from_now: np.ndarray
) -> dict[str, partial[Any]]:
    """Return every stage as a call, with what the stages before it return."""
    method, rule = ZhangOdometry(), Clustering()
    pose = Pose.planar(0.0, 0.0, 0.0, sensor_height(now.points))
    cloud = Cloud.of(now, pose)
    above = standing(now)
    whole = segments_of(now, rule)
    own = method.cut(whole, before_from_now)
    earlier = method.cut(segments_of(before, rule), np.eye(4))
    since_s = now.stamp_s - before.stamp_s
    features, known = (
        cluster_features(each.at_stamp(before_from_now, since_s), each, "ring", sectors=False)
        for each in (own, earlier)
    )
    matched = method.compared(own, earlier, before_from_now, since_s)
    ours, theirs = of_partners(features, known, matched, still_only=True)
    return {
        "height of the sensor": partial(sensor_height, now.points),
        "cloud": partial(Cloud.of, now, pose),
        "ground removal": partial(polar_above_ground, cloud, ceiling_m=np.inf),
        CLUSTERED: partial(rule.labels, above),
        CUT: partial(method.cut, whole, before_from_now),
        LABELLED: partial(method.compared, own, earlier, before_from_now, since_s),
        "deskew": partial(own.at_stamp, before_from_now, since_s),
        "edges and planes": partial(cluster_features, own.points, own, "ring", sectors=False),
        MATCHED: partial(match_features, ours, theirs, before_from_now),
    }


def goal_steps() -> list[SpeedStep]:
    """Return a step for each part of `roadscope speed` that has goals."""
    parts = ("detectors", "trackers", "odometry", "camera")
    steps = [SpeedStep(f"goals, {part}", partial(_missed_in, part)) for part in parts]
    return [*steps, SpeedStep("goals, stages", _missed_in_stages)]


def _missed_in(part: str) -> list[SpeedRow]:
    return missed_goals(measure_speed([part]))


def _missed_in_stages() -> list[SpeedRow]:
    return missed_goals([*measure_odometry_stages(RIG, 7), *measure_corridor_stages(7)])


def missed_goals(rows: Sequence[SpeedRow]) -> list[SpeedRow]:
    """Return a row for each figure that misses its goal, the goal in its unit."""
    missed = []
    for row in rows:
        if row.value is None:
            continue
        goals = [goal.most_ms for goal in GOALS if re.fullmatch(goal.pattern, row.name)]
        least = LEAST_RATES.get(row.name, 0.0)
        if goals and row.value > min(goals):
            missed.append(SpeedRow(f"too slow: {row.name}", row.value, f"ms of {min(goals):g}"))
        if row.value < least:
            missed.append(SpeedRow(f"too slow: {row.name}", row.value, f"{row.unit} of {least:g}"))
    return missed


PARTS: Mapping[str, Callable[[], list[SpeedStep]]] = {
    "detectors": detector_steps,
    "odometry": odometry_steps,
    "goals": goal_steps,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    run_speed_study("speed_stages", __doc__, PARTS, arguments)


if __name__ == "__main__":
    main()
