"""An odometry on a folder of scans, beside the truth where there is one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.scan_folder import ScanFolder
from roadscope.benchmarks.formats.table import FormatError, read_lines
from roadscope.benchmarks.formats.trajectories import (
    TUM_COLUMNS,
    Trajectory,
    read_trajectory,
    trajectory_text,
)
from roadscope.benchmarks.isolation import Limits, PluginError, open_plugin
from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose, WheelSamples
from roadscope.core.answers import AnswerError, check_estimate
from roadscope.odometry import ODOMETRIES

ALONG_M = 10.0
"""Nobody drives so far along an axis that points upwards and less along the others."""


@dataclass(frozen=True, slots=True)
class Inertial:
    """All samples of a recording, and how the IMU is mounted; None: its frame is the LiDAR's.

    path: where they come from. left_out: lines of it that told nothing.
    """

    samples: ImuSamples
    lidar_from_imu: Pose | None = None
    path: Path = Path("imu")
    left_out: int = 0

    def __str__(self) -> str:
        return _told(len(self.samples.stamps_s), "inertial samples", self.path, self.left_out)

    def within(self, begin: int, end: int) -> ImuSamples:
        """Return the samples of these numbers."""
        arrays = (self.samples.stamps_s, self.samples.angular_velocity, self.samples.specific_force)
        return ImuSamples(*(array[begin:end].copy() for array in arrays))


@dataclass(frozen=True, slots=True)
class Wheels:
    """All wheel speeds of a recording, along the LiDAR's x axis.

    path: where they come from. left_out: lines of it that told nothing.
    """

    samples: WheelSamples
    path: Path = Path("wheels")
    left_out: int = 0

    def __str__(self) -> str:
        return _told(len(self.samples.stamps_s), "wheel speeds", self.path, self.left_out)

    def within(self, begin: int, end: int) -> WheelSamples:
        """Return the samples of these numbers."""
        return WheelSamples(
            self.samples.stamps_s[begin:end].copy(), self.samples.speeds[begin:end].copy()
        )


def _told(count: int, what: str, path: Path, left_out: int) -> str:
    less = f" ({left_out} left out: no numbers, or stamps that do not rise)" if left_out else ""
    return f"{count} {what} of {path}{less}"


def check_times(recorded: Inertial | Wheels, stamps_s: Sequence[float]) -> None:
    """Refuse samples of another time than the scans'."""
    stamps = recorded.samples.stamps_s
    if stamps.max() < stamps_s[0] or stamps.min() > stamps_s[-1]:
        raise FormatError(
            f"{recorded.path}: expected samples from {stamps_s[0]:.3f} to {stamps_s[-1]:.3f} s, "
            f"when scans were taken, got {stamps.min():.3f} to {stamps.max():.3f} s"
        )


def followed(
    folder: ScanFolder,
    odometry: str,
    *,
    inertial: Inertial | None = None,
    wheels: Wheels | None = None,
) -> Iterator[OdometryEstimate]:
    """Yield an odometry's estimate of one scan after the other.

    A spec that names none is refused before anything is read; what a plug-in does wrong raises
    `PluginError`. One that is not ours runs in a process of its own, without a limit of time for
    the whole recording.
    """
    spec = ODOMETRIES.resolve(odometry)
    limits = Limits(episode_s=float("inf"))

    def estimates() -> Iterator[OdometryEstimate]:
        with open_plugin(spec, limits=limits) as plugin:
            plugin.call("reset", inertial.lidar_from_imu if inertial else None)
            for scan, imu, speeds in _joined(folder, inertial, wheels):
                if speeds is not None and plugin.traits.takes_wheels:
                    plugin.call("add_wheels", speeds)
                answer = plugin.call("update", scan, imu).answer
                try:
                    yield check_estimate(answer, stamp_s=scan.stamp_s, returns=len(scan))
                except AnswerError as error:
                    raise PluginError(odometry, str(error)) from error

    return estimates()


def _joined(
    folder: ScanFolder, inertial: Inertial | None, wheels: Wheels | None
) -> Iterator[tuple[LidarScan, ImuSamples | None, WheelSamples | None]]:
    """Yield scans with the samples up to the ends of their sweeps."""
    felt = rolled = 0
    imu, speeds = None, None
    for scan in folder:
        end_s = scan.stamp_s + float(scan.time_offset_s.max(initial=0))
        if inertial is not None:
            begin, felt = felt, max(felt, _until(inertial.samples.stamps_s, end_s))
            imu = inertial.within(begin, felt)
        if wheels is not None:
            begin, rolled = rolled, max(rolled, _until(wheels.samples.stamps_s, end_s))
            speeds = wheels.within(begin, rolled)
        yield scan, imu, speeds


def _until(stamps_s: np.ndarray, end_s: float) -> int:
    """Return how many of (K,) rising stamps are no later than a time."""
    return int(np.searchsorted(stamps_s, end_s, side="right"))


def write_followed(
    folder: ScanFolder,
    odometry: str,
    out: Path,
    form: str = "kitti",
    *,
    inertial: Inertial | None = None,
    wheels: Wheels | None = None,
) -> Iterator[OdometryEstimate]:
    """Yield likewise, and write each pose as soon as it is known: what is done stays.

    Before the first pose nothing is written, so that what was in the file stays. Poses are the
    LiDAR's in its first frame, x ahead, y left, z up, whatever the format.
    """
    estimates = followed(folder, odometry, inertial=inertial, wheels=wheels)
    trajectory_text(form, (), ())
    for number, told in enumerate(estimates):
        with out.open("a" if number else "w", encoding="utf-8") as file:
            file.write(trajectory_text(form, (told.start_from_lidar,), (told.stamp_s,)))
        yield told


@dataclass(frozen=True, slots=True)
class Truth:
    """True poses of scans, (4, 4) in a frame of their own; None where the file tells nothing."""

    poses: tuple[np.ndarray | None, ...]

    @staticmethod
    def read(path: Path, stamps_s: Sequence[float]) -> Truth:
        """Read KITTI's poses, one a scan, or TUM's, brought to the stamps of the scans."""
        lines = (line.split() for line in read_lines(path))
        first = next((words for words in lines if words and not words[0].startswith("#")), [])
        if len(first) == len(TUM_COLUMNS):
            return Truth(_brought(read_trajectory(path, "tum"), stamps_s, path))
        poses = read_trajectory(path, "kitti").poses
        if len(poses) != len(stamps_s):
            raise FormatError(
                f"{path}: expected {len(stamps_s)} poses, one a scan, got {len(poses)}"
            )
        return Truth(tuple(pose.matrix for pose in poses))


def _brought(
    found: Trajectory, stamps_s: Sequence[float], path: Path
) -> tuple[np.ndarray | None, ...]:
    """Return poses at the stamps that lie between two of a file."""
    known = np.array(found.stamps_s)
    brought: list[np.ndarray | None] = []
    for stamp_s in stamps_s:
        k = int(np.searchsorted(known, stamp_s, side="right")) - 1
        if k < 0 or k >= len(known) or (k == len(known) - 1 and known[k] < stamp_s):
            brought.append(None)
        elif known[k] == stamp_s:
            brought.append(found.poses[k].matrix)
        else:
            share = float((stamp_s - known[k]) / (known[k + 1] - known[k]))
            brought.append(found.poses[k].interpolate(found.poses[k + 1], share).matrix)
    if sum(pose is not None for pose in brought) < 2:
        raise FormatError(
            f"{path}: expected poses from {stamps_s[0]:.3f} to {stamps_s[-1]:.3f} s, when scans "
            f"were taken, got {f'{known[0]:.3f} to {known[-1]:.3f} s' if len(known) else 'none'}"
        )
    return tuple(brought)


def compared(poses: Sequence[Pose], truth: Truth) -> str:
    """Say in a line how far off poses are: the first of them may be fewer than the truth's."""
    from roadscope.benchmarks.metrics.odometry import (
        KITTI_M,
        SHORT_M,
        Trajectories,
        absolute_errors,
        drift,
    )

    pairs = [(p.matrix, t) for p, t in zip(poses, truth.poses, strict=False) if t is not None]
    both = Trajectories(np.array([p for p, _ in pairs]), np.array([t for _, t in pairs]))
    way_m = float(both.distances[-1])
    lengths = KITTI_M if way_m > KITTI_M[-1] else SHORT_M
    found = drift(both, lengths, every=10 if lengths is KITTI_M else 1)
    drifts = (
        f"t_rel {found.t_rel:.2f} %, r_rel {found.r_rel:.2f} deg/100m over "
        f"{lengths[0]:g} to {lengths[-1]:g} m"
        if len(found)
        else f"too short for t_rel over {lengths[0]:g} m"
    )
    ate_m, end_m = absolute_errors(both, "se3").rmse_m, absolute_errors(both, "origin").end_m
    return f"{way_m:.1f} m: ATE {ate_m:.3f} m, at the end {end_m:.3f} m off, {drifts}"


def of_camera(truth: Truth) -> bool:
    """Say whether true poses seem to be a camera's, whose z axis points ahead, as KITTI's own."""
    known = [matrix for matrix in truth.poses if matrix is not None]
    x, y, z = np.abs(np.linalg.inv(known[0]) @ known[-1])[:3, 3]
    return bool(z > max(x, y, ALONG_M))
