"""The scripted experiments of Lu 2018 as sensed frames, with the misses that the scripts force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import GROUND, Frame, Truth
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.ground import grid_above_ground
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.rigs import rig
from roadscope.envs.sensors.sensing import Sensing
from roadscope.envs.traffic.lu2018 import FRAME_S, SCRIPTS, Script
from roadscope.envs.traffic.scenarios import record
from roadscope.envs.world import roadside
from roadscope.envs.world.roadside import kinds_of

KINDS = ("target", "ground", "foliage", "structure")
"""What a return can come from."""
_KIND_OF_SCENERY = {"trees": "foliage", "bushes": "foliage", "hedge": "foliage"}
"""All other scenery is structure."""
_SCENERY_KINDS = np.array(
    [KINDS.index(_KIND_OF_SCENERY.get(name, "structure")) for name in roadside.KINDS]
)


@dataclass(frozen=True, slots=True)
class SensedExperiment:
    """One experiment with one seed.

    frames, truths: one for each of the script's frames, the first is frame 1.
    clouds: for each frame, the returns above the ground.
    kinds: for each frame, (N,) int64, what each return of the cloud is, an index into `KINDS`.
    """

    script: Script
    frames: tuple[Frame, ...]
    truths: tuple[Truth, ...]
    clouds: tuple[Cloud, ...]
    kinds: tuple[np.ndarray, ...]


def sense_experiment(name: str, seed: int, noise: float = 1.0) -> SensedExperiment:
    """Sense a scripted experiment with the paper's LiDAR; frame k has the stamp k x 0.08 s.

    noise: factor on the range noise of the data sheet.
    """
    script = SCRIPTS[name]
    timeline = record(name, seed)
    sensing = Sensing(lux(noise), seed)
    until_s = (script.frames + 0.5) * FRAME_S
    sensed = [
        without_returns(frame, truth, forced_misses(script, number))
        for number, (frame, truth) in enumerate(sensing.advance(timeline, until_s), start=1)
    ]
    frames, truths = zip(*sensed, strict=True)
    clouds = tuple(above_ground(frame) for frame in frames)
    kinds = tuple(
        kinds_of_sources(truth.sources[cloud.rows])
        for truth, cloud in zip(truths, clouds, strict=True)
    )
    return SensedExperiment(script, frames, truths, clouds, kinds)


def lux(noise: float = 1.0) -> Rig:
    """Return the paper's rig with the stamp of the first scan at frame 1."""
    preset = rig("lux")
    spec = replace(preset.lidar.spec, range_noise_m=noise * preset.lidar.spec.range_noise_m)
    return replace(preset, lidar=replace(preset.lidar, spec=spec, first_stamp_s=FRAME_S))


def forced_misses(script: Script, number: int) -> list[int]:
    """Return the targets whose returns the script suppresses in a frame."""
    return [e.target for e in script.events if e.kind == "missed" and e.first <= number <= e.last]


def without_returns(frame: Frame, truth: Truth, targets: Sequence[int]) -> tuple[Frame, Truth]:
    """Return a frame and its truth without the returns of some targets."""
    scan = frame.lidar
    if not targets or scan is None:
        return frame, truth
    others = ~np.isin(truth.sources, targets)
    lidar_returns = np.where(np.isin(truth.ids, targets), 0, truth.lidar_returns)
    return (
        replace(frame, lidar=scan.select(others)),
        replace(truth, sources=truth.sources[others], lidar_returns=lidar_returns),
    )


def above_ground(frame: Frame) -> Cloud:
    """Return the part of a scan that detectors cluster."""
    assert frame.lidar is not None
    cloud = Cloud.of(frame.lidar, frame.calibration.pose(frame.lidar.sensor))
    return cloud.select(grid_above_ground(cloud))


def kinds_of_sources(sources: np.ndarray) -> np.ndarray:
    """Return what each of (P,) sources is, (P,) int64 indices into `KINDS`."""
    scenery = kinds_of(sources)
    others = np.where(sources == GROUND, KINDS.index("ground"), KINDS.index("target"))
    return np.where(scenery >= 0, _SCENERY_KINDS[scenery], others)
