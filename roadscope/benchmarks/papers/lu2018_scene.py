"""The scripted experiments of Lu 2018 as frames, with the misses that they force."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import GROUND, Frame, LidarScan, Truth
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


@dataclass(frozen=True, slots=True)
class Take:
    """One experiment with one seed.

    frames, truths: one for each of the script's frames, the first is frame 1.
    clouds: for each frame, what stands above the ground.
    kinds: for each frame, (N,) int64, what each return of the cloud is, an index into `KINDS`.
    """

    script: Script
    frames: tuple[Frame, ...]
    truths: tuple[Truth, ...]
    clouds: tuple[Cloud, ...]
    kinds: tuple[np.ndarray, ...]


def film(name: str, seed: int, noise: float = 1.0) -> Take:
    """Sense a scripted experiment with the paper's LiDAR; frame k has the stamp k x 0.08 s.

    noise: factor on the range noise of the data sheet.
    """
    script = SCRIPTS[name]
    timeline = record(name, seed)
    sensing = Sensing(lux(noise), seed)
    until_s = (script.frames + 0.5) * FRAME_S
    seen = [
        suppressed(frame, truth, missed(script, number))
        for number, (frame, truth) in enumerate(sensing.advance(timeline, until_s), start=1)
    ]
    frames, truths = zip(*seen, strict=True)
    clouds = tuple(above_ground(frame) for frame in frames)
    sources = (truth.sources[cloud.rows] for truth, cloud in zip(truths, clouds, strict=True))
    return Take(script, frames, truths, clouds, tuple(map(kinds, sources)))


def lux(noise: float = 1.0) -> Rig:
    """Return the paper's rig with the stamp of the first scan at frame 1."""
    preset = rig("lux")
    spec = replace(preset.lidar.spec, range_noise_m=noise * preset.lidar.spec.range_noise_m)
    return replace(preset, lidar=replace(preset.lidar, spec=spec, first_stamp_s=FRAME_S))


def missed(script: Script, number: int) -> list[int]:
    """Return the targets whose returns the script suppresses in a frame."""
    return [e.target for e in script.events if e.kind == "missed" and e.first <= number <= e.last]


def suppressed(frame: Frame, truth: Truth, targets: list[int]) -> tuple[Frame, Truth]:
    """Take the returns of targets out of a scan."""
    scan = frame.lidar
    if not targets or scan is None:
        return frame, truth
    kept = ~np.isin(truth.sources, targets)
    names = ("points", "intensity", "ring", "column", "time_offset_s")
    arrays = {name: getattr(scan, name)[kept] for name in names}
    gone = np.isin(truth.ids, targets)
    return (
        replace(frame, lidar=LidarScan(**arrays, stamp_s=scan.stamp_s, sensor=scan.sensor)),
        replace(
            truth,
            sources=truth.sources[kept],
            lidar_returns=np.where(gone, 0, truth.lidar_returns),
        ),
    )


def above_ground(frame: Frame) -> Cloud:
    """Return a scan as detectors cluster it."""
    assert frame.lidar is not None
    cloud = Cloud.of(frame.lidar, frame.calibration.pose(frame.lidar.sensor))
    return cloud.select(grid_above_ground(cloud))


def kinds(sources: np.ndarray) -> np.ndarray:
    """Return what each of (P,) sources is, (P,) int64 indices into `KINDS`."""
    of_scenery = kinds_of(sources)
    otherwise = np.where(sources == GROUND, KINDS.index("ground"), KINDS.index("target"))
    return np.where(of_scenery >= 0, _GROUP[of_scenery], otherwise)


_NAMES = {"trees": "foliage", "bushes": "foliage", "hedge": "foliage"}
_GROUP = np.array([KINDS.index(_NAMES.get(name, "structure")) for name in roadside.KINDS])
