"""How fast images are drawn and looked at.

All of it in processor time, summed over threads: what one core needs for it, whatever else runs.
Everything that is compared takes turns in one run, since shared machines change from run to run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
LOOKS: dict[str, dict[str, Any]] = {
    "with everything": {},
    "by night in rain": {"light": "night", "weather": "rain-3"},
}
PLAIN, BLURRED = "plain colours", "with everything and motion blur"
PRECISIONS = {"float32": "float32", "bf16": "bfloat16"}
ASKED = {"images plain colours, 1280 x 960": 60, "images with everything, 1280 x 960": 25}
"""Images a second, depth and instances with them."""
ASKED_MS = {"network bf16, 640 x 480": 33.3}
"""Of the network where the processor has bfloat16."""


def measure_camera(rig: str, repeats: int) -> list[SpeedRow]:
    """Measure one rig: images a second of each look, detectors' ms an image, and ratios."""
    carrier = rig_of(rig)
    pinhole = camera_of(carrier).spec.pinhole
    size = f"{pinhole.width} x {pinhole.height}"
    drawing = interleaved(_drawing(rig, carrier), repeats, process_time)
    rows = [
        _asked(f"images {look}, {size}", 1 / seconds, "images/s", ASKED)
        for look, seconds in drawing.items()
    ]
    everything = drawing["with everything"] / drawing[PLAIN]
    rows.append(SpeedRow(f"everything over plain colours, {size}", everything, "times"))
    looking = interleaved(_looking(rig, carrier), repeats, process_time)
    rows += [
        _asked(f"{name}, {size}", t * 1e3, "ms an image", ASKED_MS) for name, t in looking.items()
    ]
    half = looking["network float32"] / looking["network bf16"]
    rows.append(SpeedRow(f"network float32 over bf16, {size}", half, "times"))
    share = looking["network float32"] / drawing["with everything"]
    rows.append(SpeedRow(f"network float32 over drawing, {size}", share, "times"))
    return rows


def _asked(name: str, value: float, unit: str, asked: Mapping[str, float]) -> SpeedRow:
    return SpeedRow(name, value, f"{unit}, asked {asked[name]}" if name in asked else unit)


def _drawing(rig: str, carrier: Rig) -> dict[str, Callable[[], object]]:
    timeline = timeline_of(Episode(SCENARIO, SEED, rig, DURATION_S))
    camera = camera_of(carrier)
    plain = replace(carrier, camera=replace(camera, spec=replace(camera.spec, plain=True)))
    blurred = replace(carrier, camera=replace(camera, spec=replace(camera.spec, motion_blur=True)))
    looks = {PLAIN: Sensing(plain, SEED), BLURRED: Sensing(blurred, SEED)}
    looks |= {name: Sensing(carrier, SEED, **look) for name, look in LOOKS.items()}
    return {
        name: partial(sensing.sense_image_at, timeline, AT_S) for name, sensing in looks.items()
    }


def _looking(rig: str, carrier: Rig) -> dict[str, Callable[[], object]]:
    timeline = timeline_of(Episode(SCENARIO, SEED, rig, DURATION_S))
    frame: Frame = Sensing(carrier, SEED).sense_image_at(timeline, AT_S)[0]
    calls: dict[str, Callable[[], object]] = {
        f"network {name}": partial(CameraDetector(precision=precision).detect, frame)
        for name, precision in PRECISIONS.items()
    }
    others = [name for name in CAMERA_DETECTORS.installed() if name != "network"]
    return calls | {n: partial(CAMERA_DETECTORS.make(n).detect, frame) for n in others}
