"""How long detectors take for a frame, on three LiDARs.

All of it in processor time, summed over threads: what one core needs for it, whatever else runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import islice
from time import process_time
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.speed.rows import SpeedRow, SpeedStep
from roadscope.core import Frame
from roadscope.detectors import DETECTORS, Detector

RUNS = {"hdl64e": 1, "hdl32e": 1, "lux": 3}
"""Rigs, and how often every detector runs over its scenes."""
SEED = 17
"""Of the training seeds."""


class DrivenScene(NamedTuple):
    """Scenario and weather."""

    scenario: str
    weather: str = "clear"


SCENES = (
    DrivenScene("motorway"),
    DrivenScene("dense-motorway"),
    DrivenScene("intersection"),
    DrivenScene("parking-lot"),
    DrivenScene("motorway", "fog"),
)
"""Much that moves or stands, and drops of fog."""
FRAMES, LEAD = 12, 4
"""Frames of a drive, and how many of them are not timed: a detector that looks for motion
answers nothing before it has had a few."""


def detector_steps(
    names: Sequence[str] | None = None, scenes: Sequence[DrivenScene] = SCENES
) -> list[SpeedStep]:
    """Return a step for each rig; arguments as of `measure_detectors`."""
    return [
        SpeedStep(f"detectors, {rig}", partial(measure_detectors, rig, runs, names, scenes))
        for rig, runs in RUNS.items()
    ]


def driven_frames(rig: str, count: int = FRAMES, scene: DrivenScene = SCENES[0]) -> list[Frame]:
    """Return consecutive frames of a scene."""
    from roadscope.envs.sensors.rigs import rig as rig_of

    mount = rig_of(rig).lidar
    duration_s = mount.stamp_s(count) + mount.spec.sweep_s
    episode = Episode(scene.scenario, SEED, rig, duration_s, scene.weather)
    return [frame for frame, _ in islice(sensed(episode), count)]


def measure_detectors(
    rig: str,
    repeats: int,
    names: Sequence[str] | None = None,
    scenes: Sequence[DrivenScene] = SCENES,
) -> list[SpeedRow]:
    """Measure whole detectors: median of the slowest scene, and the slowest frame.

    names: specs of detectors; None: all that are registered.
    """
    drives = [driven_frames(rig, FRAMES, scene) for scene in scenes]
    rows: list[SpeedRow] = []
    for name in DETECTORS.names() if names is None else names:
        times_ms = timed_frames(name, drives, repeats)
        median_ms = float(np.median(times_ms, axis=1).max())
        row = SpeedRow(f"detector {name}, {rig}", median_ms, "ms")
        slowest = SpeedRow(f"{row.name}, slowest frame", float(times_ms.max()), "ms")
        rows += [row, slowest]
    return rows


def timed_frames(name: str, drives: Sequence[Sequence[Frame]], repeats: int) -> np.ndarray:
    """Return the milliseconds of (drives, frames from `LEAD` on), each the median of its repeats.

    Before that the first drive runs once untimed.
    """
    detector = DETECTORS.make(name)
    times_ms = np.empty((len(drives), repeats, len(drives[0]) - LEAD))
    _drive(detector, drives[0])
    for row, column in np.ndindex(len(drives), repeats):
        times_ms[row, column] = _drive(detector, drives[row])
    median: np.ndarray = np.median(times_ms, axis=1)
    return median


def _drive(detector: Detector, frames: Sequence[Frame]) -> list[float]:
    """Return the milliseconds of each frame from `LEAD` on."""
    detector.reset()
    times_ms = []
    for frame in frames:
        start = process_time()
        detector.detect(frame)
        times_ms.append((process_time() - start) * 1e3)
    return times_ms[LEAD:]
