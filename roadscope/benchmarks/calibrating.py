"""A simulated rig calibrated with a triangular target, and how many poses of the target it takes.

The target and what both sensors measure of it: Li 2021, section 2.2. A *view* is what both sensors
measure of the target in one pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.cache import usable_file, write_atomically
from roadscope.benchmarks.images import camera_of, projection_of
from roadscope.benchmarks.progress import Progress, silent
from roadscope.core import Pose
from roadscope.core.projection import Projection
from roadscope.envs.imaging.raster import GROUND_FACE, rasterise
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.lidar import sweep
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.sensors.rigs import rig as find_rig
from roadscope.envs.world.prisms import Prisms
from roadscope.fusion.bundle import refine
from roadscope.fusion.calibration import (
    CalibrationError,
    CalibrationResult,
    calibrate,
    decompose,
    distances_px,
    write_calibration,
)
from roadscope.fusion.calibration_target import (
    BeamDirections,
    ScannedTarget,
    TriangularTarget,
    corners_in_image,
    corners_in_scans,
    scanned_target,
)

SCANS = 25
"""Scans of each pose, two seconds of a LUX: the target stands still."""
SLICE_M, THICKNESS_M = 0.004, 0.002
"""Height of the slices that the target is built of, and its thickness; chosen by hand."""
TARGET_REFLECTIVITY = 0.8
GREY = {"target": 235.0, "ground": 80.0, "sky": 120.0}
GREY_NOISE = 4.0
"""Grey levels in the image, of 255, and the standard deviation of their noise; chosen by hand."""
LEAST_HEIGHT_M, FARTHEST_RETURN_M = 0.08, 15.0
"""Returns above the ground and within this distance from the LiDAR are the target's: it stands
alone on even ground."""
PITCH_RAD, ROLL_RAD = 0.3, 0.15
"""Greatest tilts of a target; with more roll its base would no longer be its lowest edge."""
LEAST_TARGETS = 3
"""Views without outliers that a joint refinement needs."""
GATE_PX = 25.0
"""A corner that is farther from its projection is an outlier; chosen by hand."""
MISREAD_PX = (30.0, 90.0)
"""Least and greatest error of a misread corner; chosen by hand."""
LEAST_POSES = 4
"""Views that a calibration needs."""
STEPS = (4, 6, 8, 10, 12, 16, 20, 30, 40, 60, 80, 100)
"""Numbers of views whose calibrations are compared, as far as there are views."""
DRAWS = 9
"""Random choices of views for each of these numbers; medians of their errors are shown."""
ENDINGS = (".json", ".toml")
"""Endings of the files that hold a calibration."""


class TargetPose(NamedTuple):
    """Where the middle of the target's base is, ego frame, metres, and how the target is turned.

    Without turns the target faces along -x. Pitch leans it ahead; roll turns it in its plane.
    Radians.
    """

    x_m: float
    y_m: float
    bottom_m: float
    yaw_rad: float
    pitch_rad: float = 0.0
    roll_rad: float = 0.0


class TargetView(NamedTuple):
    """The left, right and top corner of a target, as both sensors measured them.

    points: (3, 3) metres, ego frame. pixels: (3, 2). scanned: what else the scans measured.
    """

    points: np.ndarray
    pixels: np.ndarray
    scanned: ScannedTarget | None = None


# --------------------------------------------------------------------------------------------------
# The target and its poses.


def true_corners(target: TriangularTarget, pose: TargetPose) -> np.ndarray:
    """Return (3, 3) left, right and top corner of a target in a pose, ego frame."""
    flat = target.corners
    x_m, y_m, bottom_m, yaw, pitch, roll = pose
    ego_from_target = Pose.from_euler(x_m, y_m, bottom_m, yaw=yaw, pitch=pitch, roll=roll)
    return ego_from_target.apply(np.column_stack([np.zeros(3), -flat[:, 0], flat[:, 1]]))


def target_prisms(target: TriangularTarget, pose: TargetPose) -> Prisms:
    """Return the target in this pose as a stack of thin slices, but with x, y and yaw of 0."""
    corners = true_corners(target, pose._replace(x_m=0.0, y_m=0.0, yaw_rad=0.0))
    low, high = float(corners[:, 2].min()), float(corners[:, 2].max())
    count = round((high - low) / SLICE_M)
    edges = low + (high - low) / count * np.arange(count + 1)
    behind = np.array([THICKNESS_M, 0.0])
    slices = []
    for bottom, top in pairwise(edges.tolist()):
        right, left = _ends_at_height(corners, (bottom + top) / 2)
        outline = np.array([right, right + behind, left + behind, left])
        slices.append(Prisms.of(outline, bottom, top, reflectivity=TARGET_REFLECTIVITY))
    return Prisms.join(slices)


def _ends_at_height(corners: np.ndarray, height_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (2,) x and y where two edges of a triangle pass a height, the right one first."""
    ends = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if (a[2] - height_m) * (b[2] - height_m) < 0:
            ends.append(a[:2] + (height_m - a[2]) / (b[2] - a[2]) * (b[:2] - a[:2]))
    first, second = ends
    return (first, second) if first[1] < second[1] else (second, first)


def random_poses(
    rig: Rig, count: int, rng: np.random.Generator, *, tilted: bool = False
) -> list[TargetPose]:
    """Draw poses in which both sensors see the whole target, near and far, left and right.

    tilted: whether it is also leaned and turned in its plane, as by a person who holds it.
    """
    ahead = rng.uniform(3.5, 9.0, count) + rig.lidar.ego_from_lidar.translation[0]
    left = rng.uniform(-0.22, 0.22, count) * ahead
    is_low_lidar = rig.lidar.ego_from_lidar.translation[2] < 1.0
    bottom = rng.uniform(0.1, 0.3, count) if is_low_lidar else rng.uniform(0.2, 0.7, count)
    yaw = rng.uniform(-0.6, 0.6, count)
    pitch, roll = np.zeros(count), np.zeros(count)
    if tilted:
        pitch = rng.uniform(-PITCH_RAD, PITCH_RAD, count)
        roll = rng.uniform(-ROLL_RAD, ROLL_RAD, count)
        # With roll, one corner of the base is lower than its middle: the target is raised by that.
        bottom = bottom + TriangularTarget().base_m / 2 * np.abs(np.sin(roll))
    columns = np.column_stack([ahead, left, bottom, yaw, pitch, roll])
    return [TargetPose(*row) for row in columns.tolist()]


# --------------------------------------------------------------------------------------------------
# Both sensors.


def target_view(
    rig: Rig,
    target: TriangularTarget,
    pose: TargetPose,
    rng: np.random.Generator,
    *,
    scans: int = SCANS,
) -> TargetView:
    """Return what both sensors measure of a target.

    scans: how many are taken. `CalibrationError` where a sensor does not see the whole target.
    """
    position = np.array([[pose.x_m, pose.y_m, pose.yaw_rad]])
    scene = Scene.still(Prisms.empty(), target_prisms(target, pose), position)
    points, ring, column = _returns_of_target(rig, scene, rng, scans)
    mount = rig.lidar
    beams = BeamDirections(mount.spec.azimuths(), mount.spec.elevations)
    corners = corners_in_scans(points, ring, column, target, beams.step_rad)
    scanned = scanned_target(points, ring, column, beams, scans)
    pixels = _corner_pixels(rig, scene, rng)
    return TargetView(mount.ego_from_lidar.apply(corners), pixels, scanned)


def _returns_of_target(
    rig: Rig, scene: Scene, rng: np.random.Generator, scans: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (N, 3) points, LiDAR frame, and (N,) ring and column of the target's returns."""
    mount = rig.lidar
    parts = []
    for _ in range(scans):
        scan, _ = sweep(scene, mount.spec, [mount.ego_from_lidar], 0.0, rng=rng)
        is_high = mount.ego_from_lidar.apply(scan.points)[:, 2] > LEAST_HEIGHT_M
        is_near = np.linalg.norm(scan.points, axis=1) < FARTHEST_RETURN_M
        rows = is_high & is_near
        parts.append((scan.points[rows], scan.ring[rows], scan.column[rows]))
    points, ring, column = (np.concatenate(part) for part in zip(*parts, strict=True))
    return points.astype(np.float64), ring, column


def _corner_pixels(rig: Rig, scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Return (3, 2) pixels of the target's corners, found in a noisy grey image of the scene."""
    camera = camera_of(rig)
    raster = rasterise(scene, camera.spec.pinhole, camera.ego_from_camera, 0.0)
    background = np.where(raster.faces == GROUND_FACE, GREY["ground"], GREY["sky"])
    grey = np.where(raster.faces >= 0, GREY["target"], background)
    return corners_in_image(grey + GREY_NOISE * rng.standard_normal(grey.shape))


def target_views(
    rig: Rig,
    poses: int,
    rng: np.random.Generator,
    *,
    progress: Callable[[int], None] | None = None,
    target: TriangularTarget | None = None,
    scans: int = SCANS,
    tilted: bool = False,
) -> list[TargetView]:
    """Hold a target before a rig in random poses and return the views that succeeded.

    progress: called with the number of poses done. target: None is the paper's. scans: of each
    pose. tilted: as in `random_poses`. `CalibrationError` where no pose succeeded.
    """
    target = target or TriangularTarget()
    views = []
    for number, pose in enumerate(random_poses(rig, poses, rng, tilted=tilted), start=1):
        try:
            views.append(target_view(rig, target, pose, rng, scans=scans))
        except CalibrationError:
            continue
        finally:
            if progress is not None:
                progress(number)
    if not views:
        raise CalibrationError(f"none of {poses} poses showed the target to both sensors")
    return views


def with_misread_corners(
    views: Sequence[TargetView], share: float, rng: np.random.Generator
) -> list[TargetView]:
    """Return the views with one corner in the image misread in a share of the poses.

    The corner is 30 to 90 pixels off in any direction.
    """
    pixels = [view.pixels.copy() for view in views]
    for pose in rng.choice(len(views), round(share * len(views)), replace=False):
        angle = rng.uniform(-np.pi, np.pi)
        offset_px = rng.uniform(*MISREAD_PX) * np.array([np.cos(angle), np.sin(angle)])
        pixels[pose][rng.integers(3)] += offset_px
    return [view._replace(pixels=each) for view, each in zip(views, pixels, strict=True)]


# --------------------------------------------------------------------------------------------------
# The calibration.


def calibrate_from_corners(
    rig: Rig, views: Sequence[TargetView], seed: int, *, known_intrinsics: bool = False
) -> CalibrationResult:
    """Calibrate a rig from corners alone, as the paper does (eq. 4).

    known_intrinsics: whether the camera's intrinsics are known.
    """
    pinhole = camera_of(rig).spec.pinhole
    return calibrate(
        np.concatenate([view.points for view in views]),
        np.concatenate([view.pixels for view in views]),
        pinhole.width,
        pinhole.height,
        gate_px=GATE_PX,
        seed=seed,
        intrinsics=pinhole.intrinsics if known_intrinsics else None,
    )


def refine_jointly(
    rig: Rig,
    views: Sequence[TargetView],
    start: CalibrationResult,
    *,
    known_intrinsics: bool = False,
) -> CalibrationResult:
    """Refine camera and targets together, from the paper's solution and without its outliers.

    The result's reprojection error is still that of the corners found in scans; most of it is the
    error of these corners. The start is returned if a used view has no `scanned`, or if too few
    views are without outliers.
    """
    # All three corners of a view have to be inliers.
    inliers = np.asarray(start.inliers.reshape(-1, 3).all(axis=1))
    used = [view for view, inlier in zip(views, inliers, strict=True) if inlier]
    scanned = [view.scanned for view in used if view.scanned is not None]
    if len(scanned) < len(used) or len(used) < LEAST_TARGETS:
        return start
    ego_from_lidar = rig.lidar.ego_from_lidar
    points, pixels = np.stack([v.points for v in used]), np.stack([v.pixels for v in used])
    refined = refine(
        start.projection.matrix @ ego_from_lidar.matrix,
        np.stack([ego_from_lidar.inverse().apply(corners) for corners in points]),
        pixels,
        scanned,
        TriangularTarget(),
        free_intrinsics=not known_intrinsics,
    )
    matrix = refined.matrix @ ego_from_lidar.inverse().matrix
    errors = distances_px(matrix, points.reshape(-1, 3), pixels.reshape(-1, 2))
    projection = Projection(matrix, start.projection.width, start.projection.height)
    reprojection_px = float(np.sqrt((errors**2).mean()))
    return CalibrationResult(projection, np.repeat(inliers, 3), reprojection_px)


def held_out_error_px(rig: Rig, projection: Projection) -> float:
    """Return how far a calibration projects points from their true pixels, root mean square.

    The points, a grid 8 to 30 m away, were not used to calibrate.
    """
    ahead_m, left_per_ahead, up_m = [8.0, 15, 30], [-0.2, 0, 0.2], [0.2, 1.0, 1.8]
    points = np.stack(np.meshgrid(ahead_m, left_per_ahead, up_m), -1).reshape(-1, 3)
    points[:, 1] *= points[:, 0]
    pixels, _ = projection_of(rig).project(points)
    errors = distances_px(projection.matrix, points, pixels)
    return float(np.sqrt((errors**2).mean()))


# --------------------------------------------------------------------------------------------------
# How many poses it takes.


@dataclass(frozen=True, slots=True)
class PoseRow:
    """Errors of a calibration from a number of poses: medians over choices of the poses.

    reprojection_px: of the points used.
    held_out_px: of points 8 to 30 m away, against the truth.
    held_out_most_px: `held_out_px` of the worst choice, no median.
    position_m, rotation_deg: of the camera's pose.
    corners_px: `held_out_px` of the paper's method, from corners alone.
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

    def calibrate(self, views: Sequence[TargetView]) -> tuple[CalibrationResult, CalibrationResult]:
        """Return the paper's calibration, and the refined one unless corners alone are used."""
        known = self.known_intrinsics
        start = calibrate_from_corners(self.rig, views, self.seed, known_intrinsics=known)
        if self.corners_only:
            return start, start
        return start, refine_jointly(self.rig, views, start, known_intrinsics=known)


def calibration_from_views(
    trial: CalibrationTrial,
    views: Sequence[TargetView],
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
        rng = np.random.default_rng([trial.seed, count])
        draws = 1 if count == len(views) else DRAWS
        choices = [rng.choice(len(views), count, replace=False) for _ in range(draws)]
        chosen = [[views[k] for k in np.sort(numbers)] for numbers in choices]
        rows.append(_row(trial, chosen))
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


def sufficient_poses(rows: Sequence[PoseRow]) -> int:
    """Return the least number of poses from which on the held-out error is near the last row's.

    Near: at most 1.5 times the error of the last row, which has all poses.
    """
    poses = rows[-1].poses
    for row in reversed(rows):
        if row.held_out_px > 1.5 * rows[-1].held_out_px:
            break
        poses = row.poses
    return poses


def _row(trial: CalibrationTrial, choices: Sequence[Sequence[TargetView]]) -> PoseRow:
    """Return the errors of calibrations from choices of equally many views."""
    errors = []
    for views in choices:
        try:
            start, result = trial.calibrate(views)
            corners_px = held_out_error_px(trial.rig, start.projection)
            errors.append((result.reprojection_px, *_errors(trial.rig, result), corners_px))
        except CalibrationError:
            errors.append((np.inf,) * 5)
    medians = np.median(errors, axis=0).tolist()
    reprojection_px, held_out_px, position_m, rotation_deg, corners_px = medians
    return PoseRow(
        poses=len(choices[0]),
        reprojection_px=reprojection_px,
        held_out_px=held_out_px,
        held_out_most_px=float(np.max([row[1] for row in errors])),
        position_m=position_m,
        rotation_deg=rotation_deg,
        corners_px=corners_px,
    )


def _errors(rig: Rig, result: CalibrationResult) -> tuple[float, float, float]:
    """Return errors of held-out points, pixels, and of the camera's pose, metres and degrees."""
    true = camera_of(rig).ego_from_camera
    _, pose = decompose(result.projection.matrix)
    turn = pose.rotation.T @ true.rotation
    # The arccosine of the trace loses half the digits where the angle is small.
    sine = np.linalg.norm(turn - turn.T) / np.sqrt(8.0)
    rotation_deg = float(np.degrees(np.arctan2(sine, (np.trace(turn) - 1) / 2)))
    position_m = float(np.linalg.norm(pose.translation - true.translation))
    return held_out_error_px(rig, result.projection), position_m, rotation_deg
