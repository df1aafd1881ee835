"""The calibration of Li 2021 repeated: a board stands in front of a rig in several poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.core import Pose
from roadscope.core.projection import Projection
from roadscope.envs.imaging.raster import rasterise
from roadscope.envs.raycast.scene import Scene
from roadscope.envs.sensors.lidar import sweep
from roadscope.envs.sensors.rig import Rig
from roadscope.envs.world.prisms import Prisms
from roadscope.fusion.board import Board, corners_in_image, corners_in_scans
from roadscope.fusion.board_sight import Beams, BoardSight, board_sight
from roadscope.fusion.bundle import refine
from roadscope.fusion.calibration import (
    CalibrationError,
    CalibrationResult,
    calibrate,
    distances_px,
)

SLICE_M = 0.004
THICK_M = 0.002
SCANS = 25
"""Scans of each pose, two seconds of a LUX: the board stands still."""
LEAST_BOARDS = 3
"""Boards seen without outliers that a joint refinement needs."""
GREY = {"board": 235.0, "ground": 80.0, "sky": 120.0}
GREY_NOISE = 4.0
GATE_PX = 25.0


@dataclass(frozen=True, slots=True)
class BoardErrors:
    """How far a calibration is from the truth.

    held_out_px: root mean square over a grid of places that were not used, 8 to 30 m away.
    reprojection_px: of the points that were used. poses: that gave all three corners.
    """

    held_out_px: float
    reprojection_px: float
    poses: int


def board_prisms(board: Board, bottom_m: float) -> Prisms:
    """Stack thin slices into a triangle across x, facing along x, its face at x = 0."""
    count = round(board.height_m / SLICE_M)
    parts = []
    for k in range(count):
        half = board.base_m / 2 * (1 - (k + 0.5) / count)
        outline = np.array([[0.0, -half], [THICK_M, -half], [THICK_M, half], [0.0, half]])
        low = bottom_m + k * SLICE_M
        parts.append(Prisms.of(outline, low, low + SLICE_M, reflectivity=0.8))
    return Prisms.join(parts)


def corners_of(
    rig: Rig, board: Board, place: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (3, 3) corners in scans, ego frame, (3, 2) in the image, and (3, 3) the true ones.

    place: (4,) x, y of the middle of the base, height of the base, yaw; ego frame.
    """
    corners, pixels, _ = board_view(rig, board, place, rng)
    return corners, pixels, true_corners(board, place)


def board_view(
    rig: Rig, board: Board, place: np.ndarray, rng: np.random.Generator, scans: int = SCANS
) -> tuple[np.ndarray, np.ndarray, BoardSight]:
    """Return (3, 3) corners in scans, ego frame, (3, 2) in the image, and what scans tell besides.

    place: as of `corners_of`.
    """
    x, y, bottom, yaw = place
    scene = Scene.still(Prisms.empty(), board_prisms(board, bottom), np.array([[x, y, yaw]]))
    corners, sight = _in_scans(rig, scene, board, rng, scans)
    return corners, _in_image(rig, scene, rng), sight


def true_corners(board: Board, place: np.ndarray) -> np.ndarray:
    """(3, 3) left, right and top corner of a board at a place, ego frame."""
    x, y, bottom, yaw = place
    flat = board.corners
    return Pose.planar(x, y, yaw, bottom).apply(
        np.column_stack([np.zeros(3), -flat[:, 0], flat[:, 1]])
    )


def places(rig: Rig, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw (count, 4) poses of the board that both sensors see whole."""
    ahead = rng.uniform(3.5, 9.0, count) + rig.lidar.ego_from_lidar.translation[0]
    aside = rng.uniform(-0.22, 0.22, count) * ahead
    low = rig.lidar.ego_from_lidar.translation[2] < 1.0
    bottom = rng.uniform(0.1, 0.3, count) if low else rng.uniform(0.2, 0.7, count)
    return np.column_stack([ahead, aside, bottom, rng.uniform(-0.6, 0.6, count)])


@dataclass(frozen=True, slots=True)
class Views:
    """The board's corners in both sensors, pose by pose; poses that failed are not among them.

    points: (3, 3) each, metres, ego frame. pixels: (3, 2) each. sights: what the scans tell
    besides, or none at all.
    """

    points: tuple[np.ndarray, ...]
    pixels: tuple[np.ndarray, ...]
    sights: tuple[BoardSight, ...] = ()

    def __len__(self) -> int:
        return len(self.points)

    def select(self, rows: Sequence[int]) -> Views:
        """Keep some poses."""
        sights = tuple(self.sights[k] for k in rows) if self.sights else ()
        return Views(
            tuple(self.points[k] for k in rows), tuple(self.pixels[k] for k in rows), sights
        )


def board_views(
    rig: Rig, poses: int, rng: np.random.Generator, *, board: Board | None = None,
    told: Callable[[int], None] | None = None, scans: int = SCANS,
) -> Views:  # fmt: skip
    """Hold the board before a rig in random poses; told: how many are done."""
    views = []
    for number, place in enumerate(places(rig, poses, rng), start=1):
        try:
            views.append(board_view(rig, board or Board(), place, rng, scans))
        except CalibrationError:
            continue
        finally:
            if told is not None:
                told(number)
    if not views:
        raise CalibrationError(f"none of {poses} poses showed the board to both sensors")
    points, pixels, sights = zip(*views, strict=True)
    return Views(points, pixels, sights)


def solved(rig: Rig, views: Views, seed: int, *, known: bool = False) -> CalibrationResult:
    """Calibrate a rig from corners, the paper's way; known: whether the intrinsics are known."""
    assert rig.camera is not None
    pinhole = rig.camera.spec.pinhole
    return calibrate(np.concatenate(views.points), np.concatenate(views.pixels), pinhole.width,
                     pinhole.height, gate_px=GATE_PX, seed=seed,
                     intrinsics=pinhole.intrinsics if known else None)  # fmt: skip


def solved_jointly(
    rig: Rig, views: Views, start: CalibrationResult, *, known: bool = False,
    board: Board | None = None,
) -> CalibrationResult:  # fmt: skip
    """Refine camera and boards together from the paper's solution, without boards it left out.

    The result's reprojection error is of corners in scans, as before: what is left of it is
    their own error. Views without sights, or with too few whole boards, leave the start.
    """
    good = np.flatnonzero(start.inliers.reshape(-1, 3).all(axis=1)).tolist()
    if not views.sights or len(good) < LEAST_BOARDS:
        return start
    ego_from_lidar, seen = rig.lidar.ego_from_lidar, views.select(good)
    found = refine(
        start.projection.matrix @ ego_from_lidar.matrix,
        np.stack([ego_from_lidar.inverse().apply(corners) for corners in seen.points]),
        np.stack(seen.pixels), seen.sights, board or Board(), free=not known,
    )  # fmt: skip
    matrix = found.matrix @ ego_from_lidar.inverse().matrix
    errors = distances_px(matrix, np.concatenate(seen.points), np.concatenate(seen.pixels))
    projection = Projection(matrix, start.projection.width, start.projection.height)
    kept = np.zeros(len(views), bool)
    kept[good] = True
    return CalibrationResult(projection, np.repeat(kept, 3), float(np.sqrt((errors**2).mean())))


def held_out_px(rig: Rig, projection: Projection) -> float:
    """Return how far a calibration puts places that were not used from where they are."""
    assert rig.camera is not None
    pinhole = rig.camera.spec.pinhole
    truth = Projection.of(pinhole.intrinsics, rig.camera.ego_from_camera, pinhole.width,
                          pinhole.height)  # fmt: skip
    far = np.stack(np.meshgrid([8.0, 15, 30], [-0.2, 0, 0.2], [0.2, 1.0, 1.8]), -1).reshape(-1, 3)
    far[:, 1] *= far[:, 0]
    errors = distances_px(projection.matrix, far, truth.project(far)[0])
    return float(np.sqrt((errors**2).mean()))


def calibrated(
    rig: Rig, poses: int, seed: int, *, board: Board | None = None, known: bool = False
) -> tuple[CalibrationResult, BoardErrors]:
    """Calibrate a rig from boards at random poses and compare with the truth.

    known: whether the intrinsics are known already.
    """
    views = board_views(rig, poses, np.random.default_rng([seed, poses]), board=board)
    result = solved(rig, views, seed, known=known)
    off_px = held_out_px(rig, result.projection)
    return result, BoardErrors(off_px, result.reprojection_px, len(views))


def _in_scans(
    rig: Rig, scene: Scene, board: Board, rng: np.random.Generator, scans: int
) -> tuple[np.ndarray, BoardSight]:
    mount, parts = rig.lidar, []
    for _ in range(scans):
        scan, _ = sweep(scene, mount.spec, [mount.ego_from_lidar], 0.0, rng=rng)
        # The board stands alone on even ground: whatever is above the ground is the board.
        high = mount.ego_from_lidar.apply(scan.points)[:, 2] > 0.08
        near = high & (np.linalg.norm(scan.points, axis=1) < 15.0)
        parts.append((scan.points[near], scan.ring[near], scan.column[near]))
    points, ring, column = (np.concatenate(part) for part in zip(*parts, strict=True))
    points = points.astype(np.float64)
    beams = Beams(mount.spec.azimuths(), mount.spec.elevations)
    found = corners_in_scans(points, ring, column, board, beams.step_rad)
    return mount.ego_from_lidar.apply(found), board_sight(points, ring, column, beams, scans)


def _in_image(rig: Rig, scene: Scene, rng: np.random.Generator) -> np.ndarray:
    assert rig.camera is not None
    raster = rasterise(scene, rig.camera.spec.pinhole, rig.camera.ego_from_camera, 0.0)
    levels = np.array([GREY["sky"], GREY["ground"]])
    grey = np.where(raster.faces >= 0, GREY["board"], levels[np.minimum(raster.faces, -1) + 2])
    return corners_in_image(grey + GREY_NOISE * rng.standard_normal(grey.shape))
