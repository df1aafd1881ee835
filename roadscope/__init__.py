"""Evaluation of driving perception on synthetic LiDAR, camera and IMU data.

These names are public. They are loaded when they are first used. More public names are in
`roadscope.metrics`, `formats` and `testing`, and in the packages `roadscope.envs`, `detectors`,
`odometry`, `trackers`, `fusion`, `driving` and `benchmarks`. Modules inside those packages are
private: they may change in any version.

Importing the package makes its environments known to Gymnasium.
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names

if TYPE_CHECKING:
    from roadscope import (
        benchmarks,
        detectors,
        driving,
        envs,
        formats,
        fusion,
        metrics,
        odometry,
        testing,
        trackers,
    )
    from roadscope.benchmarks.compare import compare
    from roadscope.benchmarks.episode import Episode
    from roadscope.benchmarks.results import Results
    from roadscope.benchmarks.run import leaderboard
    from roadscope.benchmarks.single import run_episode
    from roadscope.benchmarks.suite_files import load_suite
    from roadscope.core.category import Category, Family
    from roadscope.core.checks import RecordError
    from roadscope.core.detections import Detections, ImageDetections
    from roadscope.core.driving import DrivingCommand, DrivingScene
    from roadscope.core.frame import Calibration, Frame
    from roadscope.core.fused import FusedDetections
    from roadscope.core.image import CameraImage
    from roadscope.core.imu import ImuSamples
    from roadscope.core.loading import SpecError
    from roadscope.core.odometry import OdometryEstimate, OdometryStatus
    from roadscope.core.pose import Pose
    from roadscope.core.projection import Projection
    from roadscope.core.scan import LidarScan
    from roadscope.core.spec import Spec
    from roadscope.core.tracks import Tracks, TrackState
    from roadscope.core.truth import Truth
    from roadscope.core.wheels import WheelSamples
    from roadscope.detectors import DETECTORS
    from roadscope.detectors.camera import CAMERA_DETECTORS
    from roadscope.driving import DRIVERS
    from roadscope.driving.wrapper import PerceptionWrapper
    from roadscope.envs.gym.registration import make
    from roadscope.envs.gym.sensor_wrapper import SensorWrapper
    from roadscope.fusion import FUSIONS
    from roadscope.odometry import ODOMETRIES
    from roadscope.testing import check
    from roadscope.trackers import TRACKERS

__version__ = "0.1.0"

_PLACES = {
    "make": "roadscope.envs.gym.registration:make",
    "PerceptionWrapper": "roadscope.driving.wrapper:PerceptionWrapper",
    "SensorWrapper": "roadscope.envs.gym.sensor_wrapper:SensorWrapper",
    "Calibration": "roadscope.core.frame:Calibration",
    "CameraImage": "roadscope.core.image:CameraImage",
    "Category": "roadscope.core.category:Category",
    "Detections": "roadscope.core.detections:Detections",
    "DrivingCommand": "roadscope.core.driving:DrivingCommand",
    "DrivingScene": "roadscope.core.driving:DrivingScene",
    "Family": "roadscope.core.category:Family",
    "Frame": "roadscope.core.frame:Frame",
    "FusedDetections": "roadscope.core.fused:FusedDetections",
    "ImageDetections": "roadscope.core.detections:ImageDetections",
    "ImuSamples": "roadscope.core.imu:ImuSamples",
    "LidarScan": "roadscope.core.scan:LidarScan",
    "OdometryEstimate": "roadscope.core.odometry:OdometryEstimate",
    "OdometryStatus": "roadscope.core.odometry:OdometryStatus",
    "Pose": "roadscope.core.pose:Pose",
    "Projection": "roadscope.core.projection:Projection",
    "RecordError": "roadscope.core.checks:RecordError",
    "TrackState": "roadscope.core.tracks:TrackState",
    "Tracks": "roadscope.core.tracks:Tracks",
    "Truth": "roadscope.core.truth:Truth",
    "WheelSamples": "roadscope.core.wheels:WheelSamples",
    "CAMERA_DETECTORS": "roadscope.detectors.camera:CAMERA_DETECTORS",
    "DETECTORS": "roadscope.detectors:DETECTORS",
    "DRIVERS": "roadscope.driving:DRIVERS",
    "FUSIONS": "roadscope.fusion:FUSIONS",
    "ODOMETRIES": "roadscope.odometry:ODOMETRIES",
    "TRACKERS": "roadscope.trackers:TRACKERS",
    "Spec": "roadscope.core.spec:Spec",
    "SpecError": "roadscope.core.loading:SpecError",
    "Episode": "roadscope.benchmarks.episode:Episode",
    "Results": "roadscope.benchmarks.results:Results",
    "check": "roadscope.testing:check",
    "compare": "roadscope.benchmarks.compare:compare",
    "leaderboard": "roadscope.benchmarks.run:leaderboard",
    "load_suite": "roadscope.benchmarks.suite_files:load_suite",
    "run_episode": "roadscope.benchmarks.single:run_episode",
    "benchmarks": "roadscope.benchmarks",
    "detectors": "roadscope.detectors",
    "driving": "roadscope.driving",
    "envs": "roadscope.envs",
    "formats": "roadscope.formats",
    "fusion": "roadscope.fusion",
    "metrics": "roadscope.metrics",
    "odometry": "roadscope.odometry",
    "testing": "roadscope.testing",
    "trackers": "roadscope.trackers",
}
"""Public name -> `module:attribute`, or a whole module."""

__all__ = [
    "CAMERA_DETECTORS",
    "DETECTORS",
    "DRIVERS",
    "FUSIONS",
    "ODOMETRIES",
    "TRACKERS",
    "Calibration",
    "CameraImage",
    "Category",
    "Detections",
    "DrivingCommand",
    "DrivingScene",
    "Episode",
    "Family",
    "Frame",
    "FusedDetections",
    "ImageDetections",
    "ImuSamples",
    "LidarScan",
    "OdometryEstimate",
    "OdometryStatus",
    "PerceptionWrapper",
    "Pose",
    "Projection",
    "RecordError",
    "Results",
    "SensorWrapper",
    "Spec",
    "SpecError",
    "TrackState",
    "Tracks",
    "Truth",
    "WheelSamples",
    "benchmarks",
    "check",
    "compare",
    "detectors",
    "driving",
    "envs",
    "formats",
    "fusion",
    "leaderboard",
    "load_suite",
    "make",
    "metrics",
    "odometry",
    "run_episode",
    "testing",
    "trackers",
]

if not TYPE_CHECKING:
    # Behind TYPE_CHECKING, so that type checkers refuse names that are not there.
    __getattr__, __dir__ = lazy_names(__name__, _PLACES)


def _is_command_line() -> bool:
    """Return whether this process was started as `roadscope` or as `python -m roadscope`."""
    if sys.argv[:1] == ["-m"]:
        # `runpy` still looks for the module, whose name comes before the arguments.
        return sys.orig_argv[-len(sys.argv)].removeprefix("-m") == "roadscope"
    # A child process of the command has its `sys.argv`, but was not started with it.
    script = sys.argv[0] if sys.argv else ""
    return Path(script).stem == "roadscope" and script in sys.orig_argv


# The command line answers `--help` without Gymnasium: `roadscope.__main__` registers the ids once
# a command runs. All other processes, its own child processes too, register here.
if not _is_command_line():
    from roadscope.envs.gym.registration import register

    register()
    del register
