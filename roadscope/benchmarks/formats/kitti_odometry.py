"""Folders of KITTI's odometry data: sequences of scans with calibration, stamps and true poses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.formats.kitti_calibration import read_camera_from_lidar
from roadscope.benchmarks.formats.kitti_cameras import CALIBRATION_FILE
from roadscope.benchmarks.formats.kitti_scans import (
    check_scan_files,
    loss_notes,
    numbered_files,
    read_scans,
)
from roadscope.benchmarks.formats.table import FormatError, names_in, read_table, visible
from roadscope.benchmarks.formats.trajectories import read_trajectory
from roadscope.core import LidarScan, Pose

EXPECTED = (
    "sequences/NN with velodyne/NNNNNN.bin, calib.txt and times.txt, and poses/NN.txt beside "
    "sequences"
)


@dataclass(frozen=True, slots=True)
class KittiOdometrySequence:
    """A sequence of KITTI's odometry data whose true poses are known.

    root: the folder that holds `sequences` and `poses`. numbers: those of its scans, rising.
    """

    root: str
    name: str
    numbers: tuple[int, ...]

    @property
    def folder(self) -> Path:
        """The folder of its files."""
        return Path(self.root, "sequences", self.name)

    @property
    def pose_file(self) -> Path:
        """The file of its true poses."""
        return Path(self.root, "poses", f"{self.name}.txt")

    @property
    def scan_files(self) -> list[Path]:
        """The files of its scans."""
        return [self.folder / "velodyne" / f"{number:06d}.bin" for number in self.numbers]

    def scans(self) -> Iterator[LidarScan]:
        """Yield the scans; their points are x y z intensity, float32."""
        yield from read_scans(self.scan_files, self.stamps_s())

    def stamps_s(self) -> list[float]:
        """Return the stamps of the scans, seconds."""
        path = self.folder / "times.txt"
        values = read_table(path, ("seconds",)).numbers(0, 1)[:, 0].tolist()
        self._require(path, len(values), "a stamp")
        stamps_s = [values[number] for number in self.numbers]
        if not np.all(np.diff(stamps_s) > 0):
            raise FormatError(f"{path}: expected stamps that rise from scan to scan")
        return stamps_s

    def camera_from_lidar(self) -> Pose:
        """Return the pose of the LiDAR in the frame of the left grey camera."""
        return read_camera_from_lidar(self.folder / CALIBRATION_FILE)

    def camera_poses(self) -> list[Pose]:
        """Return the true pose of the camera at each scan, in the frame of the first one."""
        poses = read_trajectory(self.pose_file, "kitti").poses
        self._require(self.pose_file, len(poses), "a pose")
        return [poses[number] for number in self.numbers]

    def length_m(self) -> float:
        """Return the length of the true path of the camera, metres."""
        places = np.array([pose.translation for pose in self.camera_poses()])
        return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())

    def digest(self) -> str:
        """Return a digest of the files: bytes of text files, names, sizes and times of scans."""
        digest = sha256()
        for path in (self.folder / "times.txt", self.folder / CALIBRATION_FILE, self.pose_file):
            digest.update(path.read_bytes() + b"\0")
        for path in self.scan_files:
            state = path.stat()
            digest.update(f"{path.name} {state.st_size} {state.st_mtime_ns}\n".encode())
        return digest.hexdigest()[:16]

    def check(self) -> None:
        """Read everything but the scans, and look at these; raise `FormatError`."""
        self.stamps_s()
        self.camera_from_lidar()
        self.camera_poses()
        check_scan_files(self.scan_files)

    def _require(self, path: Path, count: int, what: str) -> None:
        last = self.numbers[-1]
        if count <= last:
            raise FormatError(
                f"{path}: expected {what} for each of the scans 0 to {last}, got {count}"
            )


class FoundSequences(NamedTuple):
    """The sequences of a folder. notes: what is left out, in sentences."""

    sequences: tuple[KittiOdometrySequence, ...]
    notes: tuple[str, ...]


def find_kitti_odometry(folder: Path | str) -> FoundSequences:
    """Return the sequences of a folder, or of its `dataset`, that have scans and true poses.

    Missing folders and files raise `FormatError`.
    """
    folder = Path(folder)
    if not folder.is_dir():
        what = "a file" if folder.is_file() else "no such folder"
        raise FormatError(f"{folder}: {what}; expected a folder with {EXPECTED}")
    roots = [each for each in (folder, folder / "dataset") if (each / "sequences").is_dir()]
    if not roots:
        raise FormatError(f"{folder}: expected {EXPECTED}; got {names_in(folder)}{_hint(folder)}")
    root = roots[0].resolve()
    names = [path.name for path in visible(root / "sequences") if path.is_dir()]
    posed = [name for name in names if (root / "poses" / f"{name}.txt").is_file()]
    if not posed:
        raise FormatError(
            f"{root / 'poses'}: expected NN.txt with the true poses of a sequence "
            f"({', '.join(names[:8]) or 'none'}), got {names_in(root / 'poses')}"
        )
    sequences = []
    for name in posed:
        numbers = numbered_files(root / "sequences" / name / "velodyne", "bin")
        if not numbers:
            continue
        sequence = KittiOdometrySequence(str(root), name, tuple(numbers))
        for path in (sequence.folder / CALIBRATION_FILE, sequence.folder / "times.txt"):
            if not path.is_file():
                raise FormatError(f"{path}: missing; sequence {name} needs it")
        sequences.append(sequence)
    if not sequences:
        raise FormatError(
            f"{root / 'sequences' / posed[0]}: expected velodyne/000000.bin, got "
            f"{names_in(root / 'sequences' / posed[0])}"
        )
    left_out = len(names) - len(sequences)
    note = f"{left_out} of {len(names)} sequences are left out: no scans or no true poses."
    lost = loss_notes([path for each in sequences for path in each.scan_files])
    return FoundSequences(tuple(sequences), (*(note,) * bool(left_out), *lost))


def _hint(folder: Path) -> str:
    """Return where the sequences are instead, near the folder; empty if nowhere."""
    resolved = folder.resolve()
    places = (*resolved.parents[:3], *(path for path in visible(folder, "*/*") if path.is_dir()))
    place = next((each for each in places if (each / "sequences").is_dir()), None)
    return "" if place is None else f"; name {place}"
