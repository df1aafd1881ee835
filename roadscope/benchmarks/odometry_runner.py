"""Runs an odometry on a folder of scans, and compares it with true poses if there are any."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from filecmp import cmp
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from roadscope.benchmarks.formats.kitti_calibration import read_camera_from_lidar
from roadscope.benchmarks.formats.kitti_cameras import CALIBRATION_FILE
from roadscope.benchmarks.formats.scan_folder import ScanFolder, scan_files
from roadscope.benchmarks.formats.table import FormatError, read_lines, visible
from roadscope.benchmarks.formats.trajectories import (
    TUM_COLUMNS,
    Trajectory,
    read_trajectory,
    trajectory_text,
)
from roadscope.benchmarks.kinds import ODOMETRY
from roadscope.benchmarks.loop import open_checked
from roadscope.core import ImuSamples, LidarScan, OdometryEstimate, Pose, WheelSamples
from roadscope.odometry.travel import turned_back, turned_scan

RATE_HZ = 10.0
"""Scans or images a second where nothing has stamps."""
TRUTH_STEPS = 3.0
"""Poses are interpolated between true ones that are at most this many median steps apart. Chosen by
hand: a pose or two may be missing."""
LEAST_AHEAD_M = 2.0
"""Metres along an axis from which on it cannot be the one that points up. Chosen by hand: on a
slope of 20 % the motion ahead is five times as large."""

_COPY = re.compile(r"(.+?)( ?\([0-9]+\)| - Copy( \([0-9]+\))?| copy( [0-9]+)?)")
"""A name that file managers and browsers give to a copy; its first part is the original's."""

Samples = TypeVar("Samples", ImuSamples, WheelSamples)


@dataclass(frozen=True, slots=True)
class RecordedSamples(Generic[Samples]):
    """All samples of one sensor in a recording.

    path: of their file. left_out: number of its lines without usable numbers.
    """

    samples: Samples
    path: Path
    left_out: int = 0

    what = "samples"

    def __str__(self) -> str:
        text = f"{len(self.samples.stamps_s)} {self.what} of {self.path}"
        if not self.left_out:
            return text
        return f"{text} ({self.left_out} left out: no numbers, or stamps that do not rise)"

    def check_times(self, stamps_s: Sequence[float]) -> None:
        """Raise `FormatError` if the samples and the scans are from different times."""
        first_s, last_s = self.samples.stamps_s.min(), self.samples.stamps_s.max()
        if last_s < stamps_s[0] or first_s > stamps_s[-1]:
            raise FormatError(
                f"{self.path}: expected samples from {stamps_s[0]:.3f} to {stamps_s[-1]:.3f} s, "
                f"when scans were taken, got {first_s:.3f} to {last_s:.3f} s"
            )

    def between(self, start_s: float, end_s: float) -> Samples:
        """Return the samples after start_s and up to end_s."""
        begin, end = np.searchsorted(self.samples.stamps_s, [start_s, end_s], side="right")
        kind = type(self.samples)
        arrays = (getattr(self.samples, each.name) for each in fields(kind))
        return kind(*(array[begin:end].copy() for array in arrays))


@dataclass(frozen=True, slots=True)
class RecordedImu(RecordedSamples[ImuSamples]):
    """The inertial samples, and how the IMU is mounted; None: its frame is the LiDAR's."""

    lidar_from_imu: Pose | None = None

    what = "inertial samples"


class RecordedWheels(RecordedSamples[WheelSamples]):
    """The wheel speeds, along the LiDAR's x axis."""

    what = "wheel speeds"


def find_scans(folder: Path, rate_hz: float | None, **options: Any) -> ScanFolder:
    """Return the scans of one drive; refuse copies of scans, and name scans in folders below.

    rate_hz: scans a second; None: `RATE_HZ`. options: of `ScanFolder.find`.
    """
    try:
        scans = ScanFolder.find(folder, rate_hz=rate_of(rate_hz), **options)
    except FormatError as error:
        raise FormatError(f"{error}{hint_below(folder)}") from error
    refuse_copies(scans.inputs)
    check_rate(rate_hz, measured=scans.measured)
    return scans


def rate_of(rate_hz: float | None) -> float:
    """Return a rate of scans or images that a user names, or else `RATE_HZ`."""
    if rate_hz is not None and not rate_hz > 0:
        raise FormatError(f"expected a rate above 0 Hz, got {rate_hz}")
    return RATE_HZ if rate_hz is None else rate_hz


def check_rate(rate_hz: float | None, *, measured: bool) -> None:
    """Refuse a rate that a user names for scans or images with stamps of a clock."""
    if rate_hz is not None and measured:
        raise FormatError(f"--rate-hz {rate_hz:g} has no effect: the recording has stamps")


def hint_below(folder: Path) -> str:
    """Return as text which folder below one without scans has scans; empty if none has."""
    below = (path for stars in ("*/", "*/*/", "*/*/*/") for path in visible(folder, stars))
    first = None if scan_files(folder) else next(filter(scan_files, below), None)
    return f"; name a folder with the scans of one drive, such as {first}" if first else ""


def refuse_copies(files: Sequence[Path]) -> None:
    """Raise `FormatError` for a file that is a copy of another one, by its name and content."""
    for path in files:
        match = _COPY.fullmatch(path.stem)
        original = path.with_stem(match[1]) if match else path
        if match and original in files and cmp(path, original, shallow=False):
            raise FormatError(f"{path} is a copy of {original.name}: remove it, and other copies")


@dataclass(frozen=True, slots=True)
class TurnedScans:
    """The scans of a folder, rotated; rotation: (3, 3)."""

    folder: ScanFolder
    rotation: np.ndarray

    def __len__(self) -> int:
        return len(self.folder)

    def part(self, first: int, end: int) -> Iterator[LidarScan]:
        """Yield the scans from `first` up to but not including `end`."""
        for scan in self.folder.part(first, end):
            yield turned_scan(scan, self.rotation)


def folder_estimates(
    folder: ScanFolder,
    odometry: str,
    *,
    imu: RecordedImu | None = None,
    wheels: RecordedWheels | None = None,
    ahead_from_lidar: Pose | None = None,
) -> Iterator[OdometryEstimate]:
    """Yield an odometry's estimates, scan by scan.

    ahead_from_lidar: a rotation that brings the LiDAR's axes to x ahead, y left, z up; None: they
        are so. Scans are turned by it, and estimates turned back.

    An unknown spec raises `SpecError`, a plug-in that fails `PluginError`. A plug-in that is not
    part of roadscope runs in a process of its own, without a time limit for the whole recording.
    """
    spec, start_s = ODOMETRY.registry.resolve(odometry), -np.inf
    lidar_from_imu = imu.lidar_from_imu if imu else None
    if imu is not None and ahead_from_lidar is not None:
        lidar_from_imu = ahead_from_lidar @ (lidar_from_imu or Pose.identity())
    with open_checked(spec, ODOMETRY, reset=(lidar_from_imu,)) as update:
        for scan in folder:
            # Samples since the last scan, up to the end of the sweep.
            end_s = max(start_s, scan.stamp_s + float(scan.time_offset_s.max(initial=0)))
            inertial = imu.between(start_s, end_s) if imu else None
            speeds = wheels.between(start_s, end_s) if wheels else None
            start_s = end_s
            if ahead_from_lidar is None:
                yield update(scan, inertial, wheels=speeds)
            else:
                turned = turned_scan(scan, ahead_from_lidar.rotation)
                estimate = update(turned, inertial, wheels=speeds)
                yield turned_back(estimate, ahead_from_lidar)


def write_estimates(
    estimates: Iterable[OdometryEstimate], out: Path, form: str = "kitti"
) -> Iterator[OdometryEstimate]:
    """Yield estimates, and write each pose before the next is estimated.

    An existing file is overwritten only when the first pose is there. Poses are those of the LiDAR
    in its first frame and its own axes, in either format.

    form: `kitti` or `tum`.
    """
    trajectory_text(form, (), ())
    for number, estimate in enumerate(estimates):
        with out.open("a" if number else "w", encoding="utf-8") as file:
            file.write(trajectory_text(form, (estimate.start_from_lidar,), (estimate.stamp_s,)))
        yield estimate


class PoseErrors(NamedTuple):
    """Errors of estimated poses.

    distance_m: length of the true trajectory. ate_m: absolute trajectory error (RMS) after
        alignment.
    end_m: distance of the last pose from the true one, both from the same start.
    t_rel, r_rel: KITTI's drift over `lengths_m`, per cent and degrees in 100 m; None where the
        trajectory is too short.
    lengths_m: of the stretches in these: lengths that the trajectory has.
    compared, scans: how many scans have a true pose, of all.
    """

    distance_m: float
    ate_m: float
    end_m: float
    t_rel: float | None
    r_rel: float | None
    lengths_m: tuple[float, ...]
    compared: int
    scans: int

    def __str__(self) -> str:
        from roadscope.benchmarks.metrics.trajectory_errors import SHORT_M

        ends = dict.fromkeys((*self.lengths_m[:1], *self.lengths_m[-1:]))
        lengths = " to ".join(f"{length_m:g}" for length_m in ends)
        drifts = (
            f"too short for t_rel over {SHORT_M[0]:g} m"
            if self.t_rel is None
            else f"t_rel {self.t_rel:.2f} %, r_rel {self.r_rel:.2f} deg/100m over {lengths} m"
        )
        rest = self.scans - self.compared
        lacking = f"; {rest} of {self.scans} scans have no true pose near in time" if rest else ""
        return (
            f"{self.distance_m:.1f} m: ATE {self.ate_m:.3f} m, at the end {self.end_m:.3f} m off, "
            f"{drifts}{lacking}"
        )


@dataclass(frozen=True, slots=True)
class TruePoses:
    """The true poses of scans, (4, 4), in any fixed frame; None for a scan without a true pose."""

    poses: tuple[np.ndarray | None, ...]

    @staticmethod
    def read(path: Path, stamps_s: Sequence[float]) -> TruePoses:
        """Read KITTI's poses, one a scan, or TUM's, interpolated at the stamps of the scans."""
        lines = (line.split() for line in read_lines(path))
        first = next((words for words in lines if words and not words[0].startswith("#")), [])
        if len(first) == len(TUM_COLUMNS):
            return TruePoses(_interpolated(read_trajectory(path, "tum"), stamps_s, path))
        poses = read_trajectory(path, "kitti").poses
        if len(poses) != len(stamps_s):
            raise FormatError(
                f"{path}: expected {len(stamps_s)} poses, one a scan, got {len(poses)}"
            )
        return TruePoses(tuple(pose.matrix for pose in poses))

    def of_lidar(self, path: Path, scans: Path) -> TruePoses:
        """Return the poses of the LiDAR if these seem to be of a camera, whose z axis points ahead.

        KITTI's own poses are those of a camera. The position of the LiDAR relative to the camera is
        read from `CALIBRATION_FILE` in the folder of scans or beside it; without this file, poses
        of a camera are refused.
        path: of these poses, for the error message.
        """
        poses = [matrix for matrix in self.poses if matrix is not None]
        x, y, z = np.abs(np.linalg.inv(poses[0]) @ poses[-1])[:3, 3]
        if z <= max(x, y, LEAST_AHEAD_M):
            return self
        places = (folder / CALIBRATION_FILE for folder in (scans, scans.parent))
        calibration = next((each for each in places if each.is_file()), None)
        if calibration is None:
            raise FormatError(
                f"{path}: its z axis points ahead: expected poses of the LiDAR, x ahead, or "
                f"{CALIBRATION_FILE} beside the scans for poses of a camera, as KITTI's own are"
            )
        mount = read_camera_from_lidar(calibration).matrix
        return TruePoses(tuple(None if pose is None else pose @ mount for pose in self.poses))

    def errors(self, poses: Sequence[Pose]) -> PoseErrors:
        """Return the errors of estimated poses, of which there may be fewer than true ones."""
        from roadscope.benchmarks.metrics.trajectory_errors import (
            KITTI_M,
            SHORT_M,
            Trajectories,
            absolute_errors,
            drift,
        )

        pairs = [(p.matrix, t) for p, t in zip(poses, self.poses, strict=False) if t is not None]
        both = Trajectories(np.array([p for p, _ in pairs]), np.array([t for _, t in pairs]))
        distance_m = float(both.distances[-1])
        lengths = KITTI_M if distance_m > KITTI_M[-1] else SHORT_M
        errors = drift(both, lengths, every=10 if lengths is KITTI_M else 1)
        return PoseErrors(
            distance_m,
            float(absolute_errors(both, "se3").rmse_m),
            float(absolute_errors(both, "origin").end_m),
            float(errors.t_rel) if len(errors) else None,
            float(errors.r_rel) if len(errors) else None,
            tuple(np.unique(errors.lengths_m).tolist()),
            len(pairs),
            len(poses),
        )


def _interpolated(
    trajectory: Trajectory, stamps_s: Sequence[float], path: Path
) -> tuple[np.ndarray | None, ...]:
    """Return poses at those stamps that lie between two of a trajectory that are near in time."""
    times_s = np.array(trajectory.stamps_s)
    longest_s = TRUTH_STEPS * float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    poses: list[np.ndarray | None] = []
    for stamp_s in stamps_s:
        k = int(np.searchsorted(times_s, stamp_s, side="right")) - 1
        if k >= 0 and times_s[k] == stamp_s:
            poses.append(trajectory.poses[k].matrix)
        elif 0 <= k < len(times_s) - 1 and times_s[k + 1] - times_s[k] <= longest_s:
            share = float((stamp_s - times_s[k]) / (times_s[k + 1] - times_s[k]))
            poses.append(trajectory.poses[k].interpolate(trajectory.poses[k + 1], share).matrix)
        else:
            poses.append(None)
    if sum(pose is not None for pose in poses) < 2:
        raise FormatError(
            f"{path}: expected poses from {stamps_s[0]:.3f} to {stamps_s[-1]:.3f} s, when scans "
            f"were taken, got "
            f"{f'{times_s[0]:.3f} to {times_s[-1]:.3f} s' if len(times_s) else 'none'}"
        )
    return tuple(poses)
