"""Measures casting, detectors, trackers, odometries, cameras and environments."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from roadscope.benchmarks.progress import Progress, silent
from roadscope.benchmarks.speed.casting import casting_steps
from roadscope.benchmarks.speed.detectors import detector_steps
from roadscope.benchmarks.speed.environments import environment_steps
from roadscope.benchmarks.speed.odometry import odometry_steps
from roadscope.benchmarks.speed.rows import SpeedRow, SpeedStep
from roadscope.benchmarks.speed.trackers import measure_trackers
from roadscope.core.names import unknown

CASTS, IMAGES = 21, 7
"""How often a cast, a sweep, an image and a detection in an image are repeated."""


def _camera_steps() -> list[SpeedStep]:
    # torch takes a second to load: only who measures cameras waits for it.
    from roadscope.benchmarks.speed.camera import RIGS, measure_camera

    return [SpeedStep(f"camera, {rig}", partial(measure_camera, rig, IMAGES)) for rig in RIGS]


PARTS: dict[str, Callable[[], list[SpeedStep]]] = {
    "casting": lambda: casting_steps(CASTS),
    "detectors": detector_steps,
    "trackers": lambda: [SpeedStep("trackers", measure_trackers)],
    "odometry": odometry_steps,
    "camera": _camera_steps,
    "environments": environment_steps,
}
"""What can be measured, and its steps."""


def measure_speed(
    parts: Sequence[str] = tuple(PARTS), *, progress: Progress = silent
) -> list[SpeedRow]:
    """Measure the parts named; one thread, medians after a warm-up.

    parts: `casting`: bare casts of an HDL-32E over numbers of bodies, and whole sweeps.
    `detectors`: every registered one on three LiDARs; on an ibeo LUX each runs three times.
    `trackers`: every registered one that needs no other package, with 10, 50, 200 and 500 targets,
    and with 12 crowded ones, all within one another's gates, which JPDA has to weigh together.
    `odometry`: every installed one on the same scans of a VLP-16, those that need no other package
    also on larger LiDARs. `camera`: drawing of images, and detection in them. `environments`:
    resets and steps of an agent's motorway.
    """
    for part in parts:
        if part not in PARTS:
            raise ValueError(unknown("part", part, PARTS))
    steps = [step for part in parts for step in PARTS[part]()]
    return run_steps(steps, progress)


def run_steps(steps: Sequence[SpeedStep], progress: Progress = silent) -> list[SpeedRow]:
    """Measure one step after the other; progress gets the name of each when it begins."""
    rows: list[SpeedRow] = []
    for number, step in enumerate(steps):
        progress(step.name, number, len(steps))
        rows.extend(step.measure())
    return rows


def write_speed(rows: Sequence[SpeedRow], path: Path | str) -> None:
    """Write the rows to a JSON file: a list of objects with name, value and unit."""
    text = json.dumps([asdict(row) for row in rows], indent=2)
    Path(path).write_text(text + "\n", encoding="utf-8")
