"""A rig calibrated with a triangular target, and how many poses of the target that takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.cache import usable_file, write_atomically
from roadscope.benchmarks.calibration_views import (
    SCANS,
    TargetViews,
    calibrate_from_corners,
    held_out_error_px,
    refine_jointly,
    target_views,
    with_misread_corners,
)
from roadscope.benchmarks.images import camera_of
from roadscope.benchmarks.progress import Progress, silent
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.rigs import rig as find_rig
from roadscope.fusion.calibration import (
    CalibrationError,
    CalibrationResult,
    decompose,
    write_calibration,
)

LEAST_POSES = 4
STEPS = (4, 6, 8, 10, 12, 16, 20, 30, 40, 60, 80, 100)
"""Numbers of poses that are compared, up to the number of views."""
DRAWS = 9
"""Random choices of poses for each of these numbers; medians of their errors are shown."""
ENDINGS = (".json", ".toml")


@dataclass(frozen=True, slots=True)
class PoseRow:
    """Errors of a calibration from a number of poses: medians over choices of the poses.

    reprojection_px: of the points used. held_out_px: of points 8 to 30 m away, against the truth;
    held_out_most_px: that of the worst choice. position_m, rotation_deg: of the camera's pose.
    corners_px: held_out_px of the paper's method, from corners alone.
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
    """A calibration from all poses, and the errors with fewer.

    usable_poses: those in which both sensors detected all three corners, of `poses` in all.
    """

    result: CalibrationResult
    rows: tuple[PoseRow, ...]
    usable_poses: int
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
    """Hold a target before a rig and estimate the matrix from points to pixels (Li 2021, 2.2).

    name: of a rig with a camera. seed: of poses and noise. known_intrinsics: only the camera's
    pose is estimated. corners_only: the paper's method, without the joint refinement of camera and
    targets. upright: whether the target stands on even ground; otherwise it is held at a tilt,
    which is more informative. scans: of each pose. outliers: share of the poses in which one
    corner in the image is misread. `CalibrationError` where poses are too few or the target is not
    seen.
    """
    if poses < LEAST_POSES:
        raise CalibrationError(f"poses: expected at least {LEAST_POSES}, got {poses}")
    if scans < 1:
        raise CalibrationError(f"scans: expected at least 1, got {scans}")
    if not 0 <= outliers <= 0.5:
        raise CalibrationError(f"outliers: expected a share from 0 to 0.5, got {outliers}")
    rig, report = find_rig(name), progress or silent
    camera_of(rig)
    report("poses", 0, poses)
    views = target_views(
        rig,
        poses,
        np.random.default_rng([seed, poses]),
        progress=lambda done: report("poses", done, poses),
        scans=scans,
        tilted=not upright,
    )
    trial = CalibrationTrial(rig, seed, known_intrinsics, corners_only)
    return calibration_from_views(trial, views, poses, outliers=outliers, progress=report)


@dataclass(frozen=True, slots=True)
class CalibrationTrial:
    """The settings with which a rig is calibrated from some of its views; see `calibrate_rig`."""

    rig: Rig
    seed: int = 0
    known_intrinsics: bool = False
    corners_only: bool = False

    def calibrate(self, views: TargetViews) -> tuple[CalibrationResult, CalibrationResult]:
        """Return the paper's calibration, and the refined one unless corners alone are used."""
        known = self.known_intrinsics
        start = calibrate_from_corners(self.rig, views, self.seed, known_intrinsics=known)
        if self.corners_only:
            return start, start
        return start, refine_jointly(self.rig, views, start, known_intrinsics=known)


def calibration_from_views(
    trial: CalibrationTrial,
    views: TargetViews,
    poses: int,
    *,
    outliers: float = 0.0,
    progress: Progress | None = None,
) -> RigCalibration:
    """Estimate the matrix from the views of `poses` poses, and from fewer and fewer of them.

    outliers, progress: as in `calibrate_rig`. `CalibrationError` where there are too few views.
    """
    report = progress or silent
    if len(views) < LEAST_POSES:
        raise CalibrationError(
            f"both sensors saw the whole target in {len(views)} of {poses} poses only, "
            f"{LEAST_POSES} are needed"
        )
    if outliers:
        views = with_misread_corners(views, outliers, np.random.default_rng([trial.seed, poses, 1]))
    counts = [n for n in STEPS if n < len(views)] + [len(views)]
    rows = []
    for number, count in enumerate(counts):
        report("solving", number, len(counts))
        rows.append(_row(trial, views, count))
    report("solving", len(counts), len(counts))
    _, result = trial.calibrate(views)
    return RigCalibration(result, tuple(rows), len(views), poses)


def save_rig_calibration(calibration: RigCalibration, path: Path | str, origin: str) -> None:
    """Write the file that fusions read; half of a file is never visible."""
    place = calibration_path(path)

    def write(part: Path) -> None:
        whole = part.with_name(part.name + place.suffix)
        write_calibration(whole, calibration.result, origin)
        whole.replace(part)

    write_atomically(place, write)


def calibration_path(path: Path | str) -> Path:
    """Return the path; raise `FolderError` if no calibration can be written there."""
    return usable_file(path, ENDINGS, "a calibration")


def sufficient_poses(rows: Sequence[PoseRow], factor: float = 1.5) -> int:
    """Return from how many poses on the median held-out error is near that of the last row.

    factor: greatest ratio of both.
    """
    poses = rows[-1].poses
    for row in reversed(rows):
        if row.held_out_px > factor * rows[-1].held_out_px:
            break
        poses = row.poses
    return poses


def _row(trial: CalibrationTrial, views: TargetViews, count: int) -> PoseRow:
    rng = np.random.default_rng([trial.seed, count])
    draws = 1 if count == len(views) else DRAWS
    errors = []
    for _ in range(draws):
        chosen = np.sort(rng.choice(len(views), count, replace=False)).tolist()
        try:
            start, result = trial.calibrate(views.select(chosen))
            before = held_out_error_px(trial.rig, start.projection)
            errors.append((result.reprojection_px, *_errors(trial.rig, result), before))
        except CalibrationError:
            errors.append((np.inf,) * 5)
    middle = np.median(errors, axis=0).tolist()
    most = float(np.max([row[1] for row in errors]))
    return PoseRow(count, middle[0], middle[1], most, *middle[2:])


def _errors(rig: Rig, result: CalibrationResult) -> tuple[float, float, float]:
    """Return errors of held-out points, pixels, and of the camera's pose, metres and degrees."""
    true = camera_of(rig).ego_from_camera
    _, pose = decompose(result.projection.matrix)
    turn = pose.rotation.T @ true.rotation
    # The arccosine of the trace loses half the digits where the angle is small.
    sine = np.linalg.norm(turn - turn.T) / np.sqrt(8.0)
    angle = float(np.degrees(np.arctan2(sine, (np.trace(turn) - 1) / 2)))
    distance_m = float(np.linalg.norm(pose.translation - true.translation))
    return held_out_error_px(rig, result.projection), distance_m, angle
