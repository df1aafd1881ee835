"""How long odometries take for a scan, and how long the stages of Zhang 2022's take.

All of it in processor time, summed over threads: what one core needs for it, whatever else runs.
All odometries take turns on every scan of one drive, since shared machines change meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from roadscope.benchmarks.drive import Step, drive, imu_mounting
from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.papers.zhang2022_plays import STANDING
from roadscope.benchmarks.papers.zhang2022_removal import LIDAR_FROM_IMU
from roadscope.benchmarks.papers.zhang2022_scene import Shot, film
from roadscope.benchmarks.speed.rows import SpeedRow, interleaved
from roadscope.core import LidarScan, Pose
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.ground import polar_above_ground
from roadscope.odometry import ODOMETRIES
from roadscope.odometry.above_ground import sensor_height, standing
from roadscope.odometry.clusters.features import cluster_features, of_partners
from roadscope.odometry.clusters.segments import Clustering, segments_of
from roadscope.odometry.loam.feature_match import match_features
from roadscope.odometry.loam.progress import ImuPrediction
from roadscope.odometry.zhang import ZhangOdometry

RIG = "vlp16-imu"
LARGER = ("hdl32e-imu", "hdl64e-imu")
"""More beams, for odometries that need no other package."""
SCENARIO, SEED, DURATION_S = "two-way", 17, 4.0
"""A street with traffic, one of the training seeds."""
LEAD = 10
"""Scans that are not timed: maps and speeds are found, and code is compiled."""
GOAL_MS: Mapping[str, float] = {RIG: 8.0}
"""What a scan may take those that need no other package."""
PAPER_MS = 17.9
"""A frame of a VLP-16 in Zhang 2022, on a computer of its own."""
CLUSTERED, CUT = "clustering by range and angle", "clusters cut by the angle"
LABELLED = "clusters matched, dynamic or not"
PREDICTED = "prediction by the IMU"
MATCHED = "Levenberg-Marquardt on edges and planes"
STAGES_GOAL_MS = 2.0
"""For clustering, cutting twice, as seen from either scan, and labelling."""


def measure_odometries(rig: str = RIG, names: Sequence[str] | None = None) -> list[SpeedRow]:
    """Measure whole updates: median, 90th percentile and slowest scan, and who misses a goal.

    names: specs of odometries; None: all that are registered and installed, of a larger LiDAR
        those that need no other package.
    """
    episode = Episode(SCENARIO, SEED, rig, DURATION_S)
    known = (ODOMETRIES.installed() if rig == RIG else own_odometries()) if names is None else names
    steps = list(drive(episode))
    returns = float(np.median([len(step.scan) for step in steps]))
    rows, late = [SpeedRow(f"returns, {rig}", returns, "points")], []
    ours = own_odometries()
    for name, times_ms in timed_updates(known, steps, imu_mounting(episode)).items():
        goal_ms = GOAL_MS.get(rig) if name in ours else None
        unit = "ms" if goal_ms is None else f"ms of {goal_ms:g}"
        middle, most = np.percentile(times_ms, [50, 90]).tolist()
        what = f"odometry {name}, {rig}"
        rows += [SpeedRow(what, middle, unit), SpeedRow(f"{what}, p90", most, unit)]
        rows.append(SpeedRow(f"{what}, slowest scan", float(times_ms.max()), "ms"))
        if goal_ms is not None and middle > goal_ms:
            late.append(SpeedRow(f"too slow, {rig}: {name}", middle, unit))
    printed = [SpeedRow("Zhang 2022 as printed, VLP-16", PAPER_MS, "ms")] if rig == RIG else []
    return [*rows, *late, *printed]


def own_odometries() -> list[str]:
    """Return the registered odometries that need no other package."""
    return [name for name in ODOMETRIES if ODOMETRIES.resolve(name).requirement is None]


def timed_updates(
    names: Sequence[str], steps: Sequence[Step], mounting: Pose | None
) -> dict[str, np.ndarray]:
    """Run odometries over a drive side by side; return the ms of each scan from `LEAD` on."""
    if len(steps) <= LEAD:
        raise ValueError(f"a drive of more than {LEAD} scans is needed, got {len(steps)}")
    odometries = {name: ODOMETRIES.make(name) for name in names}
    times_ms: dict[str, list[float]] = {name: [] for name in names}
    for odometry in odometries.values():
        odometry.reset(mounting)
    for number, step in enumerate(steps):
        for name, odometry in odometries.items():
            given = deepcopy(step)
            start = process_time()
            odometry.update(given.scan, given.imu)
            if number >= LEAD:
                times_ms[name].append((process_time() - start) * 1e3)
    return {name: np.array(values) for name, values in times_ms.items()}


def measure_stages(rig: str, repeats: int) -> list[SpeedRow]:
    """Measure each stage of Zhang 2022's chain alone on one scan, and clustering with labelling.

    With the usual rig also on a scan of the paper's corridor, of which more is walls.
    """
    episode = Episode(SCENARIO, SEED, rig, DURATION_S)
    *_, before, now = drive(episode)
    motion = (before.world_from_lidar.inverse() @ now.world_from_lidar).matrix
    told = f"ms of {STAGES_GOAL_MS:g}" if rig == RIG else "ms"
    rows = _stage_rows(rig, (before, now), motion, imu_mounting(episode), repeats, told)
    if rig != RIG:
        return rows
    *_, earlier, later = film(replace(STANDING, scans=2), SEED)
    pair = earlier, later
    return rows + _stage_rows("corridor", pair, np.eye(4), LIDAR_FROM_IMU, repeats, told)


def _stage_rows(
    place: str, pair: tuple[Step, Step] | tuple[Shot, Shot], motion: np.ndarray,
    mounting: Pose | None, repeats: int, unit: str,
) -> list[SpeedRow]:  # fmt: skip
    before, now = pair
    imu = ImuPrediction(mounting)
    for each in pair:
        imu.add(each.imu)
    calls = stages(before.scan, now.scan, motion) | {
        PREDICTED: partial(imu.motion, before.scan.stamp_s, now.scan.stamp_s)
    }
    times = interleaved(calls, repeats, process_time)
    rows = [SpeedRow(f"{name}, {place}", seconds * 1e3, "ms") for name, seconds in times.items()]
    whole = 1e3 * (times[CLUSTERED] + 2 * times[CUT] + times[LABELLED])
    return [*rows, SpeedRow(f"clustering and labelling, {place}", whole, unit)]


def stages(before: LidarScan, now: LidarScan, motion: np.ndarray) -> dict[str, partial[Any]]:
    """Return every stage as a call, fed with what the stages before it return.

    motion: (4, 4) `before_from_now`, as a good prediction would have it.
    """
    method, rule = ZhangOdometry(), Clustering()
    pose = Pose.planar(0.0, 0.0, 0.0, sensor_height(now.points))
    cloud = Cloud.of(now, pose)
    above = standing(now)
    whole = segments_of(now, rule)
    found, earlier = method.cut(whole, motion), method.cut(segments_of(before, rule), np.eye(4))
    since_s = now.stamp_s - before.stamp_s
    features, known = (
        cluster_features(each.at_stamp(motion, since_s), each, "ring", sectors=False)
        for each in (found, earlier)
    )
    clusters = method.compared(found, earlier, motion, since_s)
    ours, theirs = of_partners(features, known, clusters, still_only=True)
    return {
        "height of the sensor": partial(sensor_height, now.points),
        "cloud": partial(Cloud.of, now, pose),
        "ground removal": partial(polar_above_ground, cloud, ceiling_m=np.inf),
        CLUSTERED: partial(rule.labels, above),
        CUT: partial(method.cut, whole, motion),
        LABELLED: partial(method.compared, found, earlier, motion, since_s),
        "deskew": partial(found.at_stamp, motion, since_s),
        "edges and planes": partial(cluster_features, found.points, found, "ring", sectors=False),
        MATCHED: partial(match_features, ours, theirs, motion),
    }
