"""How fast images are drawn and objects detected in them.

All of it in processor time, summed over threads: what one core needs for it, whatever else runs.
Everything that is compared takes turns in one run, since shared machines change from run to run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import process_time
from typing import Any

from roadscope.benchmarks.episode import Episode, timeline_of
from roadscope.benchmarks.images import camera_of
from roadscope.benchmarks.speed.rows import SpeedRow, interleaved
from roadscope.core import Frame
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.detectors.camera.detector import CameraDetector
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.rigs import rig as rig_of
from roadscope.envs.sensors.sensing import Sensing

RIGS = ("wide", "li2021")
SEED = 17
"""Of the training seeds."""
SCENARIO, DURATION_S, AT_S = "street", 3.0, 1.5
"""Traffic, how long it is recorded, and when the image is taken; chosen by hand."""
IMAGE_OPTIONS: dict[str, dict[str, Any]] = {
    "with everything": {},
    "by night in rain": {"light": "night", "weather": "rain-3"},
}
"""Kinds of images -> arguments of `Sensing`."""
PLAIN, BLURRED = "plain colours", "with everything and motion blur"
PRECISIONS = {"float32": "float32", "bf16": "bfloat16"}


def measure_camera(rig: str, repeats: int) -> list[SpeedRow]:
    """Measure one rig: images a second of each kind, detectors' ms an image, and ratios."""
    mounted = rig_of(rig)
    pinhole = camera_of(mounted).spec.pinhole
    size = f"{pinhole.width} x {pinhole.height}"
    drawing = interleaved(_drawing(rig, mounted), repeats, process_time)
    rows = [
        SpeedRow(f"images {kind}, {size}", 1 / seconds, "images/s")
        for kind, seconds in drawing.items()
    ]
    everything = drawing["with everything"] / drawing[PLAIN]
    rows.append(SpeedRow(f"everything over plain colours, {size}", everything, "times"))
    detecting = interleaved(_detecting(rig, mounted), repeats, process_time)
    rows += [
        SpeedRow(f"{name}, {size}", seconds * 1e3, "ms an image")
        for name, seconds in detecting.items()
    ]
    half = detecting["network float32"] / detecting["network bf16"]
    rows.append(SpeedRow(f"network float32 over bf16, {size}", half, "times"))
    share = detecting["network float32"] / drawing["with everything"]
    rows.append(SpeedRow(f"network float32 over drawing, {size}", share, "times"))
    return rows


def _drawing(rig: str, mounted: Rig) -> dict[str, Callable[[], object]]:
    timeline = timeline_of(Episode(SCENARIO, SEED, rig, DURATION_S))
    camera = camera_of(mounted)
    plain = replace(mounted, camera=replace(camera, spec=replace(camera.spec, plain=True)))
    blurred = replace(mounted, camera=replace(camera, spec=replace(camera.spec, motion_blur=True)))
    kinds = {PLAIN: Sensing(plain, SEED), BLURRED: Sensing(blurred, SEED)}
    kinds |= {name: Sensing(mounted, SEED, **options) for name, options in IMAGE_OPTIONS.items()}
    return {
        name: partial(sensing.sense_image_at, timeline, AT_S) for name, sensing in kinds.items()
    }


def _detecting(rig: str, mounted: Rig) -> dict[str, Callable[[], object]]:
    timeline = timeline_of(Episode(SCENARIO, SEED, rig, DURATION_S))
    frame: Frame = Sensing(mounted, SEED).sense_image_at(timeline, AT_S)[0]
    calls: dict[str, Callable[[], object]] = {
        f"network {name}": partial(CameraDetector(precision=precision).detect, frame)
        for name, precision in PRECISIONS.items()
    }
    others = [name for name in CAMERA_DETECTORS.installed() if name != "network"]
    return calls | {n: partial(CAMERA_DETECTORS.make(n).detect, frame) for n in others}
