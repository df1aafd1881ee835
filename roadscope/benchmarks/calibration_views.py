"""A triangular calibration target before a simulated rig, as both sensors see it (Li 2021, 2.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.images import camera_of, projection_of
from roadscope.core import Pose
from roadscope.core.projection import Projection
from roadscope.envs.imaging.raster import rasterise
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.lidar import sweep
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.world.prisms import Prisms
from roadscope.fusion.bundle import refine
from roadscope.fusion.calibration import (
    CalibrationError,
    CalibrationResult,
    calibrate,
    distances_px,
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
"""Targets without outliers that a joint refinement needs."""
GATE_PX = 25.0
"""A corner that is farther from its projection is an outlier; chosen by hand."""
MISREAD_PX = (30.0, 90.0)
"""Least and greatest error of a misread corner; chosen by hand."""


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
    """The left, right and top corner of a target by both sensors.

    points: (3, 3) metres, ego frame. pixels: (3, 2). scanned: what else the scans measured.
    """

    points: np.ndarray
    pixels: np.ndarray
    scanned: ScannedTarget


@dataclass(frozen=True, slots=True)
class TargetViews:
    """Corners of the target by both sensors, pose by pose; poses that failed are left out.

    points: (3, 3) each, metres, ego frame. pixels: (3, 2) each. scanned: what else the scans
    measured, of every pose or of none.
    """

    points: tuple[np.ndarray, ...]
    pixels: tuple[np.ndarray, ...]
    scanned: tuple[ScannedTarget, ...] = ()

    def __len__(self) -> int:
        return len(self.points)

    def select(self, rows: Sequence[int]) -> TargetViews:
        """Return the views of some poses."""
        return TargetViews(
            tuple(self.points[k] for k in rows),
            tuple(self.pixels[k] for k in rows),
            tuple(self.scanned[k] for k in rows) if self.scanned else (),
        )


# --------------------------------------------------------------------------------------------------
# The target and its poses.


def true_corners(target: TriangularTarget, pose: TargetPose) -> np.ndarray:
    """Return (3, 3) left, right and top corner of a target in a pose, ego frame."""
    flat = target.corners
    ego_from_target = Pose.from_euler(
        pose.x_m,
        pose.y_m,
        pose.bottom_m,
        yaw=pose.yaw_rad,
        pitch=pose.pitch_rad,
        roll=pose.roll_rad,
    )
    return ego_from_target.apply(np.column_stack([np.zeros(3), -flat[:, 0], flat[:, 1]]))


def target_prisms(target: TriangularTarget, pose: TargetPose) -> Prisms:
    """Return the target as a stack of thin slices, for x, y and yaw of 0."""
    corners = true_corners(target, pose._replace(x_m=0.0, y_m=0.0, yaw_rad=0.0))
    low, high = float(corners[:, 2].min()), float(corners[:, 2].max())
    count = round((high - low) / SLICE_M)
    edges = low + (high - low) / count * np.arange(count + 1)
    slices, behind = [], np.array([THICKNESS_M, 0.0])
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
    low = rig.lidar.ego_from_lidar.translation[2] < 1.0
    bottom = rng.uniform(0.1, 0.3, count) if low else rng.uniform(0.2, 0.7, count)
    yaw, pitch, roll = rng.uniform(-0.6, 0.6, count), np.zeros(count), np.zeros(count)
    if tilted:
        pitch = rng.uniform(-PITCH_RAD, PITCH_RAD, count)
        roll = rng.uniform(-ROLL_RAD, ROLL_RAD, count)
        # The lower corner stays above the ground.
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
    mount, parts = rig.lidar, []
    for _ in range(scans):
        scan, _ = sweep(scene, mount.spec, [mount.ego_from_lidar], 0.0, rng=rng)
        high = mount.ego_from_lidar.apply(scan.points)[:, 2] > LEAST_HEIGHT_M
        near = high & (np.linalg.norm(scan.points, axis=1) < FARTHEST_RETURN_M)
        parts.append((scan.points[near], scan.ring[near], scan.column[near]))
    points, ring, column = (np.concatenate(part) for part in zip(*parts, strict=True))
    return points.astype(np.float64), ring, column


def _corner_pixels(rig: Rig, scene: Scene, rng: np.random.Generator) -> np.ndarray:
    camera = camera_of(rig)
    raster = rasterise(scene, camera.spec.pinhole, camera.ego_from_camera, 0.0)
    levels = np.array([GREY["sky"], GREY["ground"]])
    grey = np.where(raster.faces >= 0, GREY["target"], levels[np.minimum(raster.faces, -1) + 2])
    return corners_in_image(grey + GREY_NOISE * rng.standard_normal(grey.shape))


def target_views(
    rig: Rig,
    poses: int,
    rng: np.random.Generator,
    *,
    target: TriangularTarget | None = None,
    progress: Callable[[int], None] | None = None,
    scans: int = SCANS,
    tilted: bool = False,
) -> TargetViews:
    """Hold a target before a rig in random poses and return the views that succeeded.

    progress: called with the number of poses done. scans: of each pose. tilted: as in
    `random_poses`. `CalibrationError` where no pose succeeded.
    """
    views = []
    for number, pose in enumerate(random_poses(rig, poses, rng, tilted=tilted), start=1):
        try:
            views.append(target_view(rig, target or TriangularTarget(), pose, rng, scans=scans))
        except CalibrationError:
            continue
        finally:
            if progress is not None:
                progress(number)
    if not views:
        raise CalibrationError(f"none of {poses} poses showed the target to both sensors")
    points, pixels, scanned = zip(*views, strict=True)
    return TargetViews(points, pixels, scanned)


def with_misread_corners(views: TargetViews, share: float, rng: np.random.Generator) -> TargetViews:
    """Return the views with one corner in the image misread in a share of the poses.

    The corner is 30 to 90 pixels off in any direction.
    """
    pixels = [corners.copy() for corners in views.pixels]
    for pose in rng.choice(len(views), round(share * len(views)), replace=False):
        angle = rng.uniform(-np.pi, np.pi)
        offset_px = rng.uniform(*MISREAD_PX) * np.array([np.cos(angle), np.sin(angle)])
        pixels[pose][rng.integers(3)] += offset_px
    return TargetViews(views.points, tuple(pixels), views.scanned)


# --------------------------------------------------------------------------------------------------
# The calibration.


def calibrate_from_corners(
    rig: Rig, views: TargetViews, seed: int, *, known_intrinsics: bool = False
) -> CalibrationResult:
    """Calibrate a rig from corners alone, as the paper does (eq. 4).

    known_intrinsics: whether the camera's intrinsics are known.
    """
    pinhole = camera_of(rig).spec.pinhole
    return calibrate(
        np.concatenate(views.points),
        np.concatenate(views.pixels),
        pinhole.width,
        pinhole.height,
        gate_px=GATE_PX,
        seed=seed,
        intrinsics=pinhole.intrinsics if known_intrinsics else None,
    )


def refine_jointly(
    rig: Rig,
    views: TargetViews,
    start: CalibrationResult,
    *,
    known_intrinsics: bool = False,
    target: TriangularTarget | None = None,
) -> CalibrationResult:
    """Refine camera and targets together, from the paper's solution and without its outliers.

    The result's reprojection error is still that of the corners found in scans; most of it is the
    error of these corners. Views without `scanned`, or with too few targets, return the start.
    """
    without_outliers = np.flatnonzero(start.inliers.reshape(-1, 3).all(axis=1)).tolist()
    if not views.scanned or len(without_outliers) < LEAST_TARGETS:
        return start
    ego_from_lidar, used = rig.lidar.ego_from_lidar, views.select(without_outliers)
    refined = refine(
        start.projection.matrix @ ego_from_lidar.matrix,
        np.stack([ego_from_lidar.inverse().apply(corners) for corners in used.points]),
        np.stack(used.pixels),
        used.scanned,
        target or TriangularTarget(),
        free_intrinsics=not known_intrinsics,
    )
    matrix = refined.matrix @ ego_from_lidar.inverse().matrix
    errors = distances_px(matrix, np.concatenate(used.points), np.concatenate(used.pixels))
    projection = Projection(matrix, start.projection.width, start.projection.height)
    inliers = np.zeros(len(views), bool)
    inliers[without_outliers] = True
    reprojection_px = float(np.sqrt((errors**2).mean()))
    return CalibrationResult(projection, np.repeat(inliers, 3), reprojection_px)


def held_out_error_px(rig: Rig, projection: Projection) -> float:
    """Return how far a calibration projects points from where they are, root mean square.

    The points, a grid 8 to 30 m away, were not used to calibrate.
    """
    axes = [8.0, 15, 30], [-0.2, 0, 0.2], [0.2, 1.0, 1.8]
    points = np.stack(np.meshgrid(*axes), -1).reshape(-1, 3)
    points[:, 1] *= points[:, 0]
    pixels, _ = projection_of(rig).project(points)
    errors = distances_px(projection.matrix, points, pixels)
    return float(np.sqrt((errors**2).mean()))
