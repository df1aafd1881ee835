"""Runs a tracker that is told where the ego is by truth, by an odometry, or not at all."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.benchmarks.cache import cache_dir, kept
from roadscope.benchmarks.ego import NO_POSES, TRUE_POSES, split_ego
from roadscope.benchmarks.episode import Episode, sensing_of
from roadscope.benchmarks.fingerprint import code_hash, fingerprint
from roadscope.benchmarks.jobs.apart import ApartError, apart
from roadscope.benchmarks.jobs.odometry_job import OdometryJob
from roadscope.benchmarks.jobs.ride import ride
from roadscope.benchmarks.jobs.stack import STAMP_TOLERANCE_S, EntryError, track
from roadscope.benchmarks.oracle_odometry import entry_of
from roadscope.benchmarks.perceived import Perceived
from roadscope.benchmarks.recorded.recording import Recording
from roadscope.core import Pose, RecordError, Tracks, Truth
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class EgoPoses(Record):
    """Where an odometry says that the ego was.

    stamps_s: (T,) float64, seconds, ascending, of the scans.
    start_from_ego: (T, 4, 4) float64, poses in the ego frame of the first scan, metres.
    """

    stamps_s: np.ndarray
    start_from_ego: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, stamps_s=(np.float64, ("T",)), start_from_ego=(np.float64, ("T", 4, 4)))

    def save(self, path: Path) -> None:
        """Write a compressed `.npz` file."""
        with path.open("wb") as file:
            np.savez_compressed(file, stamps_s=self.stamps_s, start_from_ego=self.start_from_ego)

    @staticmethod
    def load(path: Path) -> EgoPoses:
        """Undo `save`; anything else is refused."""
        try:
            with np.load(path, allow_pickle=False) as data:
                return EgoPoses(data["stamps_s"], data["start_from_ego"])
        except (KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise RecordError(f"{path}: not a file of ego poses: {error}") from error

    def at(self, stamps_s: Sequence[float]) -> list[Pose]:
        """Return the pose last told at each stamp; the start before the first scan."""
        rows = np.searchsorted(self.stamps_s, np.asarray(stamps_s) + STAMP_TOLERANCE_S) - 1
        start = np.eye(4)
        return [Pose(start if row < 0 else self.start_from_ego[row]) for row in rows]


def track_told(
    spec: str, perceived: Perceived, episode: Episode | Recording, *, unsure: bool = False
) -> tuple[list[Tracks], np.ndarray]:
    """Run a tracker over an episode's detections, told the poses that its spec asks for.

    Detections are the same whatever is told: they reach the tracker in the ego frame. A tracker
    lives in the world of who tells the poses: that of an odometry begins in the first ego frame
    and drifts; with `none` it gets None and lives in the ego frame. What is scored are its tracks
    where it sees them from the ego: they go by the told pose of each frame into the ego frame, and
    from there by the true one into the true world (`stack.track`). So a drift that is slow costs
    little, a step of the poses costs tracks. Velocities stay what they are in the told world, only
    turned: what an odometry errs in speed is an error of every velocity, and with `none` the ego's
    whole motion is.

    Returns what `stack.track` does.
    """
    tracker, ego = split_ego(spec)
    return track(tracker, perceived, unsure=unsure, told=told(ego, episode, perceived.truths))


def told(
    ego: str, episode: Episode | Recording, truths: Sequence[Truth]
) -> Sequence[Pose | None] | None:
    """Return the poses that a tracker is told, frame by frame; None: the true ones."""
    if ego == TRUE_POSES:
        return None
    if ego == NO_POSES:
        return [None] * len(truths)
    if isinstance(episode, Recording):
        raise EntryError(f"ego={ego}: recorded detections come without scans")
    return odometry_poses(ego, episode).at([truth.stamp_s for truth in truths])


def told_content(ego: str, episode: Episode | Recording) -> Mapping[str, Any]:
    """Return what the poses depend on, as JSON can hold it; nothing for the true ones."""
    if ego == TRUE_POSES:
        return {}
    code = code_hash("benchmarks/jobs/ego_poses.py")
    if ego == NO_POSES or isinstance(episode, Recording):
        return {"ego": ego, "ego_code": code}
    return {"ego": _riding(ego, episode).content(), "ego_code": code}


def odometry_poses(odometry: str, episode: Episode) -> EgoPoses:
    """Read what an odometry told of an episode, or let it run and keep it: all trackers share it.

    What goes wrong with it raises `EntryError`.
    """
    path = cache_dir() / "egos" / f"{fingerprint(told_content(odometry, episode))}.npz"

    def make() -> EgoPoses:
        if _riding(odometry, episode).ours:
            return ridden(odometry, episode)
        try:
            answer: EgoPoses | str = apart(_answered, odometry, episode)
        except ApartError as error:
            raise EntryError(f"{odometry}: {error}") from error
        if isinstance(answer, str):
            raise EntryError(answer)
        return answer

    return kept(path, EgoPoses.load, make)


def ridden(odometry: str, episode: Episode) -> EgoPoses:
    """Let an odometry run, and carry its poses over to the ego as the calibration has it."""
    found, sensing = ride(odometry, episode), sensing_of(episode)
    mount = sensing.calibration.pose(sensing.rig.lidar.name)
    back = mount.inverse()
    poses = [(mount @ Pose(pose) @ back).matrix for pose in found.both.estimate]
    return EgoPoses(found.stamps_s, np.array(poses))


def _answered(odometry: str, episode: Episode) -> EgoPoses | str:
    """Let an odometry run; what it did wrong is said in words, which other processes understand."""
    try:
        return ridden(odometry, episode)
    except EntryError as error:
        return str(error)


def _riding(odometry: str, episode: Episode) -> OdometryJob:
    return OdometryJob(entry_of(odometry), odometry, episode)
