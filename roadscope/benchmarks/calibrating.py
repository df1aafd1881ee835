"""Calibrates a rig with a triangular target; shows how many poses of the target that takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.cache import usable_file, write_atomically
from roadscope.benchmarks.images import camera_of
from roadscope.benchmarks.papers.li2021_board import (
    SCANS,
    Views,
    board_views,
    held_out_px,
    misread,
    solved,
    solved_jointly,
)
from roadscope.benchmarks.progress import Progress, silent
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.rigs import rig as rig_of
from roadscope.fusion.calibration import (
    CalibrationError,
    CalibrationResult,
    decompose,
    write_calibration,
)

LEAST_POSES = 4
STEPS = (4, 6, 8, 10, 12, 16, 20, 30, 40, 60, 80, 100)
"""Numbers of poses that are compared, as far as there are so many."""
DRAWS = 9
"""Random choices of that many poses, whose median is shown."""
ENDINGS = (".json", ".toml")


@dataclass(frozen=True, slots=True)
class PoseRow:
    """Errors of calibrations from a number of poses, medians over choices of them.

    reprojection_px: error of the points used. held_out_px: error of points 8 to 30 m away, against
    the truth; held_out_most_px: that of the worst choice. position_m, rotation_deg: errors of the
    camera's pose. corners_px: held_out_px of the paper's method, from corners alone.
    """

    poses: int
    reprojection_px: float
    held_out_px: float
    held_out_most_px: float
    position_m: float
    rotation_deg: float
    corners_px: float = math.nan


@dataclass(frozen=True, slots=True)
class RigCalibration:
    """A calibration from all poses, and the errors with fewer poses.

    poses: of the target. usable: in how many of them both sensors detected all three corners.
    """

    result: CalibrationResult
    rows: tuple[PoseRow, ...]
    usable: int
    poses: int


def calibrate_rig(
    name: str = "li2021",
    *,
    poses: int = 20,
    seed: int = 0,
    known_intrinsics: bool = False,
    corners_only: bool = False,
    upright: bool = False,
    scans: int = SCANS,
    outliers: float = 0.0,
    progress: Progress | None = None,
) -> RigCalibration:
    """Simulate a target before a rig and estimate the projection into its images (Li 2021, 2.2).

    name: of a rig with a camera. poses: number of poses of the target. seed: of poses and noise.
    known_intrinsics: estimate only the camera's pose. corners_only: the paper's method, without
    the joint refinement of the poses of camera and targets. upright: the target stands on even
    ground; otherwise it is held at a tilt, which gives more information. scans: of each pose.
    outliers: share of the poses in which one corner in the image is misread. `CalibrationError` if
    too few poses have the whole target in view of both sensors.
    """
    if poses < LEAST_POSES:
        raise CalibrationError(f"poses: expected at least {LEAST_POSES}, got {poses}")
    if scans < 1:
        raise CalibrationError(f"scans: expected at least 1, got {scans}")
    if not 0 <= outliers <= 0.5:
        raise CalibrationError(f"outliers: expected a share from 0 to 0.5, got {outliers}")
    rig, report = rig_of(name), progress or silent
    camera_of(rig)
    report("poses", 0, poses)
    views = board_views(
        rig,
        poses,
        np.random.default_rng([seed, poses]),
        told=lambda done: report("poses", done, poses),
        scans=scans,
        tilted=not upright,
    )
    if len(views) < LEAST_POSES:
        raise CalibrationError(
            f"both sensors saw the whole target in only {len(views)} of {poses} poses, "
            f"{LEAST_POSES} are needed"
        )
    if outliers:
        views = misread(views, outliers, np.random.default_rng([seed, poses, 1]))
    counts = [n for n in STEPS if n < len(views)] + [len(views)]
    trial = _Trial(rig, seed, known_intrinsics, corners_only)
    rows = []
    for number, count in enumerate(counts):
        report("solving", number, len(counts))
        rows.append(_row(trial, views, count))
    report("solving", len(counts), len(counts))
    _, result = trial.solved(views)
    return RigCalibration(result, tuple(rows), len(views), poses)


def save_rig_calibration(calibration: RigCalibration, path: Path | str, origin: str) -> None:
    """Write a calibration for fusions; no reader ever sees half of the file.

    origin: the command that made it, as a comment in the file.
    """
    place = calibration_path(path)

    def write(part: Path) -> None:
        suffixed = part.with_name(part.name + place.suffix)
        write_calibration(suffixed, calibration.result, origin)
        suffixed.replace(part)

    write_atomically(place, write)


def calibration_path(path: Path | str) -> Path:
    """Return the path; raise `FolderError` if no calibration can be written there."""
    return usable_file(path, ENDINGS, "a calibration")


def enough(rows: Sequence[PoseRow], share: float = 1.5) -> int:
    """Return from how many poses on the median held-out error is at most `share` times the last."""
    least = rows[-1].poses
    for row in reversed(rows):
        if row.held_out_px > share * rows[-1].held_out_px:
            break
        least = row.poses
    return least


@dataclass(frozen=True, slots=True)
class _Trial:
    """The settings of a calibration."""

    rig: Rig
    seed: int
    known_intrinsics: bool
    corners_only: bool

    def solved(self, views: Views) -> tuple[CalibrationResult, CalibrationResult]:
        """Return the paper's calibration, and the refined one unless there are only corners."""
        start = solved(self.rig, views, self.seed, known=self.known_intrinsics)
        if self.corners_only:
            return start, start
        return start, solved_jointly(self.rig, views, start, known=self.known_intrinsics)


def _row(trial: _Trial, views: Views, count: int) -> PoseRow:
    rng = np.random.default_rng([trial.seed, count])
    draws = 1 if count == len(views) else DRAWS
    errors = []
    for _ in range(draws):
        chosen = np.sort(rng.choice(len(views), count, replace=False)).tolist()
        try:
            start, result = trial.solved(views.select(chosen))
            before = held_out_px(trial.rig, start.projection)
            errors.append((result.reprojection_px, *_errors(trial.rig, result), before))
        except CalibrationError:
            errors.append((np.inf,) * 5)
    medians = np.median(errors, axis=0).tolist()
    most = float(np.max([row[1] for row in errors]))
    return PoseRow(count, medians[0], medians[1], most, *medians[2:])


def _errors(rig: Rig, result: CalibrationResult) -> tuple[float, float, float]:
    """Return errors: pixels of points not used, metres and degrees of the camera's pose."""
    true = camera_of(rig).ego_from_camera
    _, pose = decompose(result.projection.matrix)
    turn = pose.rotation.T @ true.rotation
    # The arccosine of the trace loses half the digits where the angle is small.
    sine = np.linalg.norm(turn - turn.T) / np.sqrt(8.0)
    angle = float(np.degrees(np.arctan2(sine, (np.trace(turn) - 1) / 2)))
    away = float(np.linalg.norm(pose.translation - true.translation))
    return held_out_px(rig, result.projection), away, angle
