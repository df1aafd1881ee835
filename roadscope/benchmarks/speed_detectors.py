"""How fast detectors are, stage by stage and whole, and DBSCAN beside scikit-learn's.

All of it in processor time, summed over threads: what one core needs for it, whatever else runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.speed_rows import SpeedRow, interleaved
from roadscope.core import Frame
from roadscope.detectors import DETECTORS
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering import CLUSTERINGS
from roadscope.detectors.clustering.density import density_labels
from roadscope.detectors.ground import GROUNDS
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape import SHAPES
from roadscope.detectors.shape.cluster import Cluster, clusters

RIGS = ("hdl64e", "hdl32e", "lux")
SCENARIO, SEED = "intersection", 17
"""Of the training seeds: traffic, buildings and parked cars on all sides."""
FRAMES = 4
GROUND, CLUSTERING = "grid", "distance"
"""What a stage is fed by when the ones before it can be chosen; `distance` makes most clusters."""
HALF_VIEW_RAD = np.radians(55.0)
COMPARED_POINTS = 20_000
EPS_M, MIN_POINTS = 0.5, 10


def driven_frames(rig: str, count: int = FRAMES) -> tuple[list[Frame], float]:
    """Return consecutive frames of the scene, and milliseconds from one to the next."""
    from roadscope.envs.sensors.rigs import rig as rig_of

    mount = rig_of(rig).lidar
    duration_s = mount.stamp_s(count - 1) + mount.spec.sweep_s / 2 + 1e-6
    frames = [frame for frame, _ in sensed(Episode(SCENARIO, SEED, rig, duration_s))]
    return frames, mount.spec.period_s * 1e3


def measure_stages(rig: str, repeats: int) -> list[SpeedRow]:
    """Measure each stage of the detectors that cluster, alone, on one frame."""
    frames, period_ms = driven_frames(rig)
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
    horizon, found = Horizon.of(cloud, above, view), clusters(standing, labels)
    calls: dict[str, Callable[[], Any]] = {"cloud": partial(Cloud.of, scan, pose)}
    for name, ground in GROUNDS.items():
        calls[f"ground {name}"] = partial(ground, cloud)
    calls["horizon"] = partial(Horizon.of, cloud, above, view)
    for name, clustering in CLUSTERINGS.items():
        calls[f"clustering {name}"] = partial(clustering, standing)
    calls["clusters and outlines"] = partial(clusters, standing, labels)
    for name, shape in SHAPES.items():
        calls[f"shape {name}"] = partial(_fit_all, shape, found, horizon)
    return calls


def _fit_all(shape: Callable[..., Any], found: list[Cluster], horizon: Horizon) -> None:
    for cluster in found:
        shape(cluster, horizon)


def measure_detectors(rig: str, repeats: int, names: Sequence[str] | None = None) -> list[SpeedRow]:
    """Measure whole detectors, median over consecutive frames.

    names: specs of detectors; None: all that are registered.
    """
    frames, period_ms = driven_frames(rig)
    rows = []
    for name in DETECTORS.names() if names is None else names:
        ms = _median_ms(name, frames, repeats)
        rows.append(SpeedRow(f"detector {name}, {rig}", ms, f"ms of {period_ms:.0f}"))
    share = 100 * max(row.value for row in rows) / period_ms
    return [*rows, SpeedRow(f"slowest detector, {rig}", share, f"% of {period_ms:.0f} ms")]


def _median_ms(name: str, frames: Sequence[Frame], repeats: int) -> float:
    """Run a detector over the frames once untimed, then `repeats` times."""
    detector, times = DETECTORS.make(name), []
    for number in range(repeats + 1):
        detector.reset()
        for frame in frames:
            start = process_time()
            detector.detect(frame)
            if number > 0:
                times.append(process_time() - start)
    return float(np.median(times)) * 1e3


def measure_dbscan(
    repeats: int, points: int = COMPARED_POINTS, rig: str = RIGS[0]
) -> list[SpeedRow]:
    """Run our DBSCAN and scikit-learn's in turns on the same returns above the ground.

    Where scikit-learn is missing so are its rows.
    """
    frames, _ = driven_frames(rig)
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
