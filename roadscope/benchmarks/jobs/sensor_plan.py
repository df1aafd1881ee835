"""The jobs of the boards that need a camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from roadscope.benchmarks.episode import Episode
from roadscope.benchmarks.jobs.camera_job import CameraJob
from roadscope.benchmarks.jobs.fused import FusedSpec, fitting
from roadscope.benchmarks.jobs.fusion_job import ALONE, FusionJob
from roadscope.benchmarks.oracle import ORACLE
from roadscope.benchmarks.suite import Suite
from roadscope.core import SpecError
from roadscope.fusion.calibration_file import read_calibration


def check_camera_of(suite: Suite) -> None:
    """Refuse a suite whose rig has no camera."""
    from roadscope.benchmarks.images import camera_of
    from roadscope.envs.sensors.rigs import rig

    camera_of(rig(suite.rig))


def camera_jobs(
    suite: Suite, detectors: Sequence[str], episodes: Sequence[Episode], *, marks: bool
) -> list[CameraJob]:
    """Every camera detector on every episode, and with `marks` the true boxes."""
    check_camera_of(suite)
    specs = dict.fromkeys([*detectors, *([ORACLE] if marks else [])])
    return [
        CameraJob(spec, spec, episode, suite.image_every_s)
        for episode in episodes
        for spec in specs
    ]


def fusion_jobs(
    suite: Suite, fusions: Sequence[str], episodes: Sequence[Episode], calibration: str,
    *, marks: bool,
) -> list[FusionJob]:  # fmt: skip
    """Every fusion on all pairs of detectors on every episode; marks: one sensor alone."""
    from roadscope.benchmarks.images import projection_of
    from roadscope.envs.sensors.rigs import rig

    check_camera_of(suite)
    if calibration:
        fitting(read_calibration(calibration), projection_of(rig(suite.rig)), calibration)
    if not (suite.fused_lidar and suite.fused_camera):
        raise SpecError(f"suite {suite.title} names no fusion.lidar or no fusion.camera")
    pairs = [
        FusedSpec(lidar, camera, "", calibration)
        for lidar in suite.fused_lidar
        for camera in suite.fused_camera
    ]
    names = dict.fromkeys([*fusions, *(ALONE if marks else ())])
    given = [(name, replace(pair, fusion=name)) for pair in pairs for name in names]
    return [
        FusionJob(entry, spec, episode, suite.eligibility, suite.fused_every_s)
        for episode in episodes
        for entry, spec in given
    ]
