"""The calibration of Li 2021 repeated: a board stands in front of a rig in several poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

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
    Beams,
    Board,
    BoardSight,
    board_sight,
    corners_in_image,
    corners_in_scans,
)

SLICE_M = 0.004
THICK_M = 0.002
SCANS = 25
"""Scans of each pose, two seconds of a LUX: the board stands still."""
PITCH_RAD = 0.3
ROLL_RAD = 0.15
"""Tilts of a board; turned farther in its plane, its base is no longer below its slopes."""
LEAST_BOARDS = 3
"""Boards seen without outliers that a joint refinement needs."""
GREY = {"board": 235.0, "ground": 80.0, "sky": 120.0}
GREY_NOISE = 4.0
GATE_PX = 25.0
MISREAD_PX = (30.0, 90.0)


@dataclass(frozen=True, slots=True)
class BoardErrors:
    """How far a calibration is from the truth.

    held_out_px: root mean square over a grid of places that were not used, 8 to 30 m away.
    reprojection_px: of the points that were used. poses: that gave all three corners.
    """

    held_out_px: float
    reprojection_px: float
    poses: int


def board_prisms(
    board: Board, bottom_m: float, pitch_rad: float = 0.0, roll_rad: float = 0.0
) -> Prisms:
    """Stack thin slices into a triangle that faces along -x, the middle of its base above 0, 0.

    bottom_m: height of that middle. Pitch leans it ahead, roll turns it in its plane.
    """
    corners = true_corners(board, np.array([0.0, 0.0, bottom_m, 0.0, pitch_rad, roll_rad]))
    low, high = float(corners[:, 2].min()), float(corners[:, 2].max())
    count = round((high - low) / SLICE_M)
    edges = low + (high - low) / count * np.arange(count + 1)
    parts, behind = [], np.array([THICK_M, 0.0])
    for bottom, top in pairwise(edges.tolist()):
        right, left = _cut(corners, (bottom + top) / 2)
        outline = np.array([right, right + behind, left + behind, left])
        parts.append(Prisms.of(outline, bottom, top, reflectivity=0.8))
    return Prisms.join(parts)


def _cut(corners: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """(2,) x and y of where two edges of a triangle pass a height, the one farther right first."""
    ends = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if (a[2] - height) * (b[2] - height) < 0:
            ends.append(a[:2] + (height - a[2]) / (b[2] - a[2]) * (b[:2] - a[:2]))
    first, second = ends
    return (first, second) if first[1] < second[1] else (second, first)


def corners_of(
    rig: Rig, board: Board, place: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (3, 3) corners in scans, ego frame, (3, 2) in the image, and (3, 3) the true ones.

    place: (6,) x, y and height of the middle of the base, yaw, pitch, roll; ego frame.
    """
    corners, pixels, _ = board_view(rig, board, place, rng)
    return corners, pixels, true_corners(board, place)


def board_view(
    rig: Rig, board: Board, place: np.ndarray, rng: np.random.Generator, scans: int = SCANS
) -> tuple[np.ndarray, np.ndarray, BoardSight]:
    """Return (3, 3) corners in scans, ego frame, (3, 2) in the image, and what scans tell besides.

    place: as of `corners_of`.
    """
    x, y, bottom, yaw, pitch, roll = place.tolist()
    prisms = board_prisms(board, bottom, pitch, roll)
    scene = Scene.still(Prisms.empty(), prisms, np.array([[x, y, yaw]]))
    corners, sight = _in_scans(rig, scene, board, rng, scans)
    return corners, _in_image(rig, scene, rng), sight


def true_corners(board: Board, place: np.ndarray) -> np.ndarray:
    """(3, 3) left, right and top corner of a board at a place, ego frame."""
    x, y, bottom, yaw, pitch, roll = place.tolist()
    flat = board.corners
    return Pose.from_euler(x, y, bottom, yaw=yaw, pitch=pitch, roll=roll).apply(
        np.column_stack([np.zeros(3), -flat[:, 0], flat[:, 1]])
    )


def places(rig: Rig, count: int, rng: np.random.Generator, *, tilted: bool = False) -> np.ndarray:
    """Draw (count, 6) poses of the board that both sensors see whole, near and far, left and right.

    tilted: whether it is also leaned and turned in its plane, as a person would who holds it.
    """
    ahead = rng.uniform(3.5, 9.0, count) + rig.lidar.ego_from_lidar.translation[0]
    aside = rng.uniform(-0.22, 0.22, count) * ahead
    low = rig.lidar.ego_from_lidar.translation[2] < 1.0
    bottom = rng.uniform(0.1, 0.3, count) if low else rng.uniform(0.2, 0.7, count)
    yaw, pitch, roll = rng.uniform(-0.6, 0.6, count), np.zeros(count), np.zeros(count)
    if tilted:
        pitch, roll = (
            rng.uniform(-PITCH_RAD, PITCH_RAD, count),
            rng.uniform(-ROLL_RAD, ROLL_RAD, count),
        )
        # The lower corner keeps off the ground.
        bottom = bottom + Board().base_m / 2 * np.abs(np.sin(roll))
    return np.column_stack([ahead, aside, bottom, yaw, pitch, roll])


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
    tilted: bool = False,
) -> Views:  # fmt: skip
    """Hold the board before a rig in random poses; told: how many are done."""
    views = []
    for number, place in enumerate(places(rig, poses, rng, tilted=tilted), start=1):
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


def misread(views: Views, share: float, rng: np.random.Generator) -> Views:
    """Return the views with a corner in the image taken for another thing in a share of the poses.

    It is 30 to 90 pixels off, whichever corner and way.
    """
    pixels = [corners.copy() for corners in views.pixels]
    for pose in rng.choice(len(views), round(share * len(views)), replace=False):
        way = rng.uniform(-np.pi, np.pi)
        off_px = rng.uniform(*MISREAD_PX) * np.array([np.cos(way), np.sin(way)])
        pixels[pose][rng.integers(3)] += off_px
    return Views(views.points, tuple(pixels), views.sights)


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
