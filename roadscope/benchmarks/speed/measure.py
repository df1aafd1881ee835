"""Measures casting, detectors, metrics, trackers, odometries and cameras."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from roadscope.benchmarks.speed.casting import COMPARED, COUNTS, casting_steps, import_open3d
from roadscope.benchmarks.speed.detectors import (
    RIGS,
    measure_dbscan,
    measure_detectors,
    measure_stages,
)
from roadscope.benchmarks.speed.metrics import measure_metrics
from roadscope.benchmarks.speed.odometry import LARGER, RIG, measure_odometries
from roadscope.benchmarks.speed.odometry import measure_stages as odometry_stages
from roadscope.benchmarks.speed.rows import SpeedRow, Step
from roadscope.benchmarks.speed.tracker_peers import measure_peers
from roadscope.benchmarks.speed.trackers import measure_trackers
from roadscope.core.names import unknown

PARTS = ("casting", "detectors", "metrics", "trackers", "odometry", "camera")

RUNS: Mapping[str, int] = {"lux": 3}
"""How often a whole detector runs over its scenes, by rig; once over others."""

Progress = Callable[[str, int, int], None]
"""Told the name of the step that begins, its number from 0 and the number of steps."""


def measure_speed(
    counts: Sequence[int] = COUNTS,
    *,
    compared: int = COMPARED,
    repeats: int = 21,
    progress: Progress | None = None,
    parts: Sequence[str] = PARTS,
) -> list[SpeedRow]:
    """Measure the parts named; one thread, medians after a warm-up.

    parts: `casting`: bare casts of an HDL-32E over numbers of bodies, whole sweeps, and Open3D
    on the same rays in turns; where Open3D is missing its rows are missing too, and `open3d
    installed` is 0. `detectors`: every stage and every registered detector on three LiDARs, over
    fewer runs: detectors three times on an ibeo LUX, where the goal is tight, once on the larger
    ones, where it takes longer; which detectors are too slow, and DBSCAN beside scikit-learn's.
    `metrics`: tracking metrics beside TrackEval's and Stone Soup's. `trackers`: every registered
    one that needs no other package, with 10, 50, 200 and 500 targets, and with 12 crowded ones,
    all within one another's gates, which JPDA has to weigh together; then those of others, each
    beside the one of ours that does the same. `odometry`: every installed one on the same scans of
    a VLP-16, ours also on larger LiDARs, and the stages of Zhang 2022's. `camera`: drawing images
    and looking at them.
    """
    for part in parts:
        if part not in PARTS:
            raise ValueError(unknown("part", part, PARTS))
    rows: list[SpeedRow] = []
    steps: list[Step] = []
    if "casting" in parts:
        open3d = import_open3d()
        rows.append(SpeedRow("open3d installed", float(open3d is not None), "1 yes, 0 no"))
        steps += casting_steps(open3d, counts, compared, repeats)
    if "detectors" in parts:
        steps += _detector_steps(-(-repeats // 7))
    if "metrics" in parts:
        steps.append(("tracking metrics", partial(measure_metrics, -(-repeats // 3))))
    if "trackers" in parts:
        steps += [("trackers", measure_trackers), ("trackers of others", measure_peers)]
    if "odometry" in parts:
        steps += _odometry_steps(-(-repeats // 3))
    if "camera" in parts:
        steps += _camera_steps(-(-repeats // 3))
    for number, (name, step) in enumerate(steps):
        if progress is not None:
            progress(name, number, len(steps))
        rows.extend(step())
    return rows


def _camera_steps(repeats: int) -> list[Step]:
    # torch takes a second to load: only who measures cameras waits for it.
    from roadscope.benchmarks.speed import camera

    return [(f"camera, {r}", partial(camera.measure_camera, r, repeats)) for r in camera.RIGS]


def _odometry_steps(repeats: int) -> list[Step]:
    steps: list[Step] = []
    for rig in (RIG, *LARGER):
        steps.append((f"odometries, {rig}", partial(measure_odometries, rig)))
        steps.append((f"stages, {rig}", partial(odometry_stages, rig, repeats)))
    return steps


def _detector_steps(repeats: int) -> list[Step]:
    steps: list[Step] = []
    for rig in RIGS:
        steps.append((f"stages, {rig}", partial(measure_stages, rig, repeats)))
        runs = min(repeats, RUNS.get(rig, 1))
        steps.append((f"detectors, {rig}", partial(measure_detectors, rig, runs)))
    return [*steps, ("DBSCAN", partial(measure_dbscan, repeats))]


def write_speed(rows: Sequence[SpeedRow], path: Path | str) -> None:
    """Write the rows to a JSON file: a list of objects with name, value and unit.

    What stands beside another has a ratio, too, and the other's name as `beside`.
    """
    named = [asdict(row) for row in rows]
    for row in named:
        if row["ratio"] is None:
            del row["ratio"], row["beside"]
    Path(path).write_text(json.dumps(named, indent=2) + "\n")
