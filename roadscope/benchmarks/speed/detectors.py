"""How fast detectors are, stage by stage and whole, and DBSCAN beside scikit-learn's.

All of it in processor time, summed over threads: what one core needs for it, whatever else runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import islice
from time import process_time
from typing import Any

import numpy as np

from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.speed.rows import SpeedRow, interleaved
from roadscope.core import Frame
from roadscope.detectors import DETECTORS, Detector
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering import CLUSTERINGS, density_labels
from roadscope.detectors.ground import GROUNDS
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape import SHAPES
from roadscope.detectors.shape.cluster import Cluster, clusters

RIGS = ("hdl64e", "hdl32e", "lux")
GOALS_MS = {"hdl64e": 100.0, "hdl32e": 100.0, "lux": 5.0}
"""What a detector may take for a frame."""
SEED = 17
"""Of the training seeds."""
SCENES = (
    ("motorway", "clear"),
    ("dense-motorway", "clear"),
    ("intersection", "clear"),
    ("parking-lot", "clear"),
    ("motorway", "fog"),
)
"""Scenarios and weathers on which whole detectors run: much that moves or stands, and drops."""
FRAMES, LEAD = 12, 4
"""Frames of a drive, and how many of them are not timed: a detector that looks for motion
answers nothing before it has seen a few."""
STAGE_SCENE, STAGE_FRAMES = ("intersection", "clear"), 4
"""Stages run on the last of these: traffic, buildings and parked cars on all sides."""
GROUND, CLUSTERING = "grid", "distance"
"""What a stage is fed by when the ones before it can be chosen; `distance` makes most clusters."""
HALF_VIEW_RAD = np.radians(55.0)
COMPARED_POINTS = 20_000
EPS_M, MIN_POINTS = 0.5, 10


def driven_frames(
    rig: str, count: int = FRAMES, scene: tuple[str, str] = SCENES[0]
) -> tuple[list[Frame], float]:
    """Return consecutive frames of a scene, and milliseconds from one to the next."""
    from roadscope.envs.sensors.rigs import rig as rig_of

    mount, (scenario, weather) = rig_of(rig).lidar, scene
    duration_s = mount.stamp_s(count) + mount.spec.sweep_s
    episode = Episode(scenario, SEED, rig, duration_s, weather)
    frames = [frame for frame, _ in islice(sensed(episode), count)]
    return frames, mount.spec.period_s * 1e3


def measure_stages(rig: str, repeats: int) -> list[SpeedRow]:
    """Measure each stage of the detectors that cluster, alone, on one frame."""
    frames, period_ms = driven_frames(rig, STAGE_FRAMES, STAGE_SCENE)
    frame = frames[-1]
    if frame.lidar is None:
        raise ValueError(f"the rig '{rig}' has no LiDAR")
    rows = [SpeedRow(f"returns, {rig}", float(len(frame.lidar)), "points")]
    times = interleaved(_stages(frame), repeats, process_time)
    return rows + [
        SpeedRow(f"{name}, {rig}", seconds * 1e3, f"ms of {period_ms:.0f}")
        for name, seconds in times.items()
    ]


def _stages(frame: Frame) -> dict[str, Callable[[], Any]]:
    """Return every stage as a call, fed with what the stages before it return."""
    scan = frame.lidar
    assert scan is not None
    pose = frame.calibration.pose(scan.sensor)
    view = (pose.yaw - HALF_VIEW_RAD, pose.yaw + HALF_VIEW_RAD)
    cloud = Cloud.of(scan, pose)
    above = GROUNDS[GROUND](cloud)
    standing = cloud.select(above)
    labels = CLUSTERINGS[CLUSTERING](standing)
    horizon, found = Horizon.of(cloud, above, view), list(clusters(standing, labels))
    calls: dict[str, Callable[[], Any]] = {"cloud": partial(Cloud.of, scan, pose)}
    for name, ground in GROUNDS.items():
        calls[f"ground {name}"] = partial(ground, cloud)
    calls["horizon"] = partial(Horizon.of, cloud, above, view)
    for name, clustering in CLUSTERINGS.items():
        calls[f"clustering {name}"] = partial(clustering, standing)
    calls["clusters and outlines"] = lambda: list(clusters(standing, labels))
    for name, shape in SHAPES.items():
        calls[f"shape {name}"] = partial(_fit_all, shape, found, horizon)
    return calls


def _fit_all(shape: Callable[..., Any], found: list[Cluster], horizon: Horizon) -> None:
    for cluster in found:
        shape(cluster, horizon)


def measure_detectors(
    rig: str,
    repeats: int,
    names: Sequence[str] | None = None,
    scenes: Sequence[tuple[str, str]] = SCENES,
) -> list[SpeedRow]:
    """Measure whole detectors: median of the slowest scene, slowest frame, and who is too slow.

    names: specs of detectors; None: all that are registered. scenes: scenarios with weathers.
    Too slow is one that takes longer than `GOALS_MS` for any frame, by the median of its repeats.
    """
    drives = [driven_frames(rig, FRAMES, scene)[0] for scene in scenes]
    goal_ms = GOALS_MS[rig]
    rows, late, fewest = [], [], np.inf
    for name in DETECTORS.names() if names is None else names:
        times_ms, found = timed_frames(name, drives, repeats)
        median_ms = float(np.median(times_ms, axis=1).max())
        slowest_ms = float(times_ms.max())
        row = SpeedRow(f"detector {name}, {rig}", median_ms, f"ms of {goal_ms:g}")
        rows += [row, SpeedRow(f"{row.name}, slowest frame", slowest_ms, row.unit)]
        if slowest_ms > goal_ms:
            late.append(SpeedRow(f"too slow, {rig}: {name}", slowest_ms, row.unit))
        fewest = min(fewest, found)
    count = len(rows) // 2
    return [
        *rows,
        SpeedRow(f"fewest detections a frame, {rig}", fewest, "of all detectors"),
        SpeedRow(
            f"detectors within {goal_ms:g} ms, {rig}", float(count - len(late)), f"of {count}"
        ),
        *late,
    ]


def timed_frames(
    name: str, drives: Sequence[Sequence[Frame]], repeats: int
) -> tuple[np.ndarray, float]:
    """Run a detector over drives, the first once untimed before.

    Returns (drives, frames) ms of the frames from `LEAD` on, each the median of its repeats, and
    detections a frame.
    """
    detector, found = DETECTORS.make(name), 0
    times_ms = np.empty((len(drives), repeats, len(drives[0]) - LEAD))
    _drive(detector, drives[0])
    for row, column in np.ndindex(len(drives), repeats):
        times_ms[row, column], count = _drive(detector, drives[row])
        found += count
    return np.median(times_ms, axis=1), found / times_ms.size


def _drive(detector: Detector, frames: Sequence[Frame]) -> tuple[list[float], int]:
    """Return the milliseconds of each frame from `LEAD` on, and how much was found in these."""
    detector.reset()
    times_ms, found = [], 0
    for number, frame in enumerate(frames):
        start = process_time()
        detections = detector.detect(frame)
        if number >= LEAD:
            times_ms.append((process_time() - start) * 1e3)
            found += len(detections)
    return times_ms, found


def measure_dbscan(
    repeats: int, points: int = COMPARED_POINTS, rig: str = RIGS[0]
) -> list[SpeedRow]:
    """Run our DBSCAN and scikit-learn's in turns on the same returns above the ground.

    Where scikit-learn is missing so are its rows.
    """
    frames, _ = driven_frames(rig, STAGE_FRAMES, STAGE_SCENE)
    cloud = _standing(frames[-1])
    places = cloud.points[:points, :2].copy()
    name = f"{len(places)} points"
    ours = partial(density_labels, places, EPS_M, MIN_POINTS)
    DBSCAN = import_scikit_learn()
    if DBSCAN is None:
        seconds = interleaved({"ours": ours}, repeats, process_time)["ours"]
        return [SpeedRow(f"DBSCAN, {name}", seconds * 1e3, "ms")]
    theirs = partial(DBSCAN(eps=EPS_M, min_samples=MIN_POINTS).fit_predict, places)
    times = interleaved({"ours": ours, "theirs": theirs}, repeats, process_time)
    mismatched = float((ours() != theirs()).sum())
    return [
        SpeedRow(f"DBSCAN, {name}", times["ours"] * 1e3, "ms"),
        SpeedRow(f"scikit-learn's DBSCAN, {name}", times["theirs"] * 1e3, "ms"),
        SpeedRow(f"DBSCAN over scikit-learn's, {name}", times["theirs"] / times["ours"], "times"),
        SpeedRow(f"labels other than scikit-learn's, {name}", mismatched, f"of {len(places)}"),
    ]


def _standing(frame: Frame) -> Cloud:
    scan = frame.lidar
    assert scan is not None
    cloud = Cloud.of(scan, frame.calibration.pose(scan.sensor))
    return cloud.select(GROUNDS[GROUND](cloud))


def import_scikit_learn() -> Any:
    """Return the class DBSCAN, or None where scikit-learn cannot be imported."""
    try:
        from sklearn.cluster import DBSCAN
    except ImportError:
        return None
    return DBSCAN
