"""Estimates a projection from points that both sensors measure (Li 2021, 2.2); its file."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.core import Pose, RecordError
from roadscope.core.projection import Projection

# --------------------------------------------------------------------------------------------------
# The matrix from points to pixels (Li 2021, 2.2, eq. 4).

LEAST_POINTS = 6
"""Six points determine the eleven degrees of freedom of the matrix."""
TRIES = 200
"""Number of random samples of `LEAST_POINTS` points. Chosen by hand."""
FLAT = 1e-4
"""Points lie in a plane if the third singular value of their scatter is less than this share of the
first. Chosen by hand."""


class CalibrationError(ValueError):
    """There is no calibration: points do not determine it, or a file does not hold one."""


@dataclass(frozen=True, slots=True)
class CalibrationResult:
    """A calibration and how well it holds.

    projection: from the frame of the points to pixels. inliers: (N,) bool, points within the gate.
    reprojection_px: root mean square reprojection error of the inliers, pixels.
    """

    projection: Projection
    inliers: np.ndarray
    reprojection_px: float


def calibrate(
    points: np.ndarray,
    pixels: np.ndarray,
    width: int,
    height: int,
    *,
    gate_px: float = 8.0,
    seed: int = 0,
    intrinsics: np.ndarray | None = None,
) -> CalibrationResult:
    """Return the projection that maps points to their pixels.

    points: (N, 3) metres, ego frame, N at least 6, not all in one plane. pixels: (N, 2).
    width, height: of the image, pixels. gate_px: greatest reprojection error of an inlier.
    seed: of the random samples. intrinsics: (3, 3) if they are known; then only the mounting pose
    is estimated.

    Outliers are left out by RANSAC on samples of six points. The linear solution of the inliers is
    refined by least squares of reprojection errors with a robust loss, for a camera without skew.
    """
    points, pixels = np.asarray(points, np.float64), np.asarray(pixels, np.float64)
    _check(points, pixels)
    inliers = _agreeing(points, pixels, gate_px, np.random.default_rng(seed))
    for _ in range(3):
        linear = solve_linear(points[inliers], pixels[inliers])
        matrix = _refined(linear, points[inliers], pixels[inliers], intrinsics)
        errors = distances_px(matrix, points, pixels)
        near = errors < gate_px
        if near.sum() < LEAST_POINTS or (near == inliers).all():
            break
        inliers = near
    rms = float(np.sqrt((distances_px(matrix, points[inliers], pixels[inliers]) ** 2).mean()))
    return CalibrationResult(Projection(matrix, width, height), inliers, rms)


def solve_linear(points: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return A of eq. 4, (3, 4), by the normalised direct linear transform (Hartley 1997).

    points: (N, 3) metres. pixels: (N, 2).
    """
    to_points, scaled_points = _normalised(points)
    to_pixels, scaled_pixels = _normalised(pixels)
    homogeneous = np.column_stack([scaled_points, np.ones(len(points))])
    zero = np.zeros_like(homogeneous)
    u, v = scaled_pixels.T[:, :, None]
    rows = np.concatenate(
        [
            np.concatenate([homogeneous, zero, -u * homogeneous], axis=1),
            np.concatenate([zero, homogeneous, -v * homogeneous], axis=1),
        ]
    )
    # The last right singular vector, which a reduced matrix of fewer than 12 rows lacks.
    solution = np.linalg.svd(rows, full_matrices=len(rows) < 12)[2][-1].reshape(3, 4)
    matrix = np.linalg.inv(to_pixels) @ solution @ to_points
    return _with_depths(matrix, points)


def decompose(matrix: np.ndarray) -> tuple[np.ndarray, Pose]:
    """Return intrinsics (3, 3), last entry 1, and pose `ego_from_camera` of a matrix (3, 4).

    Raises `CalibrationError` if the matrix is that of a mirrored image.
    """
    from scipy.linalg import rq

    upper, rotation = rq(matrix[:, :3])
    signs = np.diag(np.where(np.diag(upper) < 0, -1.0, 1.0))
    upper, rotation = upper @ signs, signs @ rotation
    if np.linalg.det(rotation) < 0:
        raise CalibrationError("the matrix mirrors space")
    translation = np.linalg.solve(upper, matrix[:, 3])
    # The nearest rotation: rounding errors are more than a pose accepts.
    left, _, right = np.linalg.svd(rotation)
    camera_from_ego = Pose.from_parts(left @ right, translation)
    return upper / upper[2, 2], camera_from_ego.inverse()


def distances_px(matrix: np.ndarray, points: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return (N,) reprojection errors, infinite for points behind the camera."""
    projected = points @ matrix[:, :3].T + matrix[:, 3]
    depth = projected[:, 2]
    in_front = depth > 1e-6
    errors = projected[:, :2] / np.where(in_front, depth, 1.0)[:, None] - pixels
    return np.where(in_front, np.hypot(errors[:, 0], errors[:, 1]), np.inf)


def _check(points: np.ndarray, pixels: np.ndarray) -> None:
    if points.ndim != 2 or points.shape[1] != 3 or pixels.shape != (len(points), 2):
        raise CalibrationError(
            f"expected (N, 3) points and (N, 2) pixels, got {points.shape} and {pixels.shape}"
        )
    if not (np.isfinite(points).all() and np.isfinite(pixels).all()):
        raise CalibrationError("expected finite points and pixels")
    if len(points) < LEAST_POINTS:
        raise CalibrationError(f"expected at least {LEAST_POINTS} points, got {len(points)}")
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if extents[2] < FLAT * extents[0]:
        raise CalibrationError("all points lie in one plane; move the target between poses")


def _agreeing(
    points: np.ndarray, pixels: np.ndarray, gate_px: float, rng: np.random.Generator
) -> np.ndarray:
    """Return the (N,) mask of the most inliers of the linear solution of any sample (RANSAC).

    The solution of all points counts as a sample, too.
    """
    best = distances_px(solve_linear(points, pixels), points, pixels) < gate_px
    if best.all():
        return best
    for _ in range(TRIES):
        chosen = rng.choice(len(points), LEAST_POINTS, replace=False)
        near = distances_px(solve_linear(points[chosen], pixels[chosen]), points, pixels) < gate_px
        if near.sum() > best.sum():
            best = near
    # Some matrix fits any six points, so a minority of inliers proves nothing.
    if 2 * best.sum() <= len(points):
        raise CalibrationError(
            f"no camera explains more than half of the {len(points)} points to {gate_px} pixels; "
            f"at best {best.sum()} of them"
        )
    return best


def _refined(
    matrix: np.ndarray, points: np.ndarray, pixels: np.ndarray, intrinsics: np.ndarray | None
) -> np.ndarray:
    """Return a (3, 4) matrix refined with a robust loss.

    intrinsics: (3, 3) where they are known: then only the mounting pose is refined.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    try:
        linear_intrinsics, ego_from_camera = decompose(matrix)
    except CalibrationError:
        return matrix
    first = linear_intrinsics if intrinsics is None else np.asarray(intrinsics, np.float64)
    camera_from_ego = ego_from_camera.inverse()

    def matrix_of(unknowns: np.ndarray) -> np.ndarray:
        fx, fy, cx, cy = unknowns[:4]
        rotation = Rotation.from_rotvec(unknowns[4:7]).as_matrix()
        inner = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        product: np.ndarray = inner @ np.column_stack([rotation, unknowns[7:10]])
        return product

    def residuals(unknowns: np.ndarray) -> np.ndarray:
        candidate = matrix_of(unknowns)
        projected = points @ candidate[:, :3].T + candidate[:, 3]
        depth = np.maximum(projected[:, 2:], 1e-3)
        return np.asarray((projected[:, :2] / depth - pixels).ravel())

    start = np.concatenate(
        [
            [first[0, 0], first[1, 1], first[0, 2], first[1, 2]],
            Rotation.from_matrix(camera_from_ego.rotation).as_rotvec(),
            camera_from_ego.translation,
        ]
    )
    scale = np.concatenate([np.full(4, 1000.0), np.ones(6)])
    if intrinsics is None:
        return matrix_of(least_squares(residuals, start, loss="soft_l1", x_scale=scale).x)
    pose = least_squares(
        lambda mounting: residuals(np.append(start[:4], mounting)), start[4:], loss="soft_l1"
    )
    return matrix_of(np.append(start[:4], pose.x))


def _normalised(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the homogeneous transform of (N, D) values to mean 0 and mean size 1, and the result.

    Size is the absolute value of a coordinate.
    """
    dimensions = values.shape[1]
    mean = values.mean(axis=0)
    scale = 1.0 / max(float(np.abs(values - mean).mean()), 1e-12)
    transform = np.eye(dimensions + 1)
    transform[:dimensions] *= scale
    transform[:dimensions, dimensions] = -scale * mean
    return transform, scale * (values - mean)


def _with_depths(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the matrix scaled so that its third row gives depths in metres, mostly positive."""
    scaled = matrix / np.linalg.norm(matrix[2, :3])
    depths = points @ scaled[2, :3] + scaled[2, 3]
    result: np.ndarray = scaled if np.median(depths) > 0 else -scaled
    return result


# --------------------------------------------------------------------------------------------------
# A calibration as a TOML or JSON file.

KEYS = ("matrix", "width", "height", "origin", "reprojection_px", "points")
"""Keys of a file; the first three are needed to read it."""
LOWEST_M = 0.05
"""Least height of a camera above the ground; a matrix that implies less is refused as an error.
Chosen by hand."""


def write_calibration(path: Path | str, result: CalibrationResult, origin: str) -> None:
    """Write a calibration: JSON if the path ends in .json, otherwise TOML.

    origin: says where the calibration comes from.
    """
    projection, path = result.projection, Path(path)
    if path.suffix.lower() == ".json":
        path.write_text(_json(result, origin), encoding="utf-8")
        return
    rows = ",\n".join(
        f"    [{', '.join(repr(float(v)) for v in row)}]" for row in projection.matrix
    )
    text = (
        "# Maps homogeneous points of the ego frame, metres, to homogeneous pixels.\n"
        f"matrix = [\n{rows},\n]\n"
        f"width = {projection.width}\nheight = {projection.height}\n"
        f"reprojection_px = {result.reprojection_px:.4f}\npoints = {int(result.inliers.sum())}\n"
        f"origin = {_quoted(origin)}\n"
    )
    path.write_text(text, encoding="utf-8")


def _json(result: CalibrationResult, origin: str) -> str:
    projection = result.projection
    content = {
        "matrix": projection.matrix.tolist(),
        "width": projection.width,
        "height": projection.height,
        "reprojection_px": round(result.reprojection_px, 4),
        "points": int(result.inliers.sum()),
        "origin": origin,
    }
    return json.dumps(content, indent=1) + "\n"


def read_calibration(path: Path | str) -> Projection:
    """Read a projection; `CalibrationError` names the file and what is wrong with it."""
    path = Path(path)
    file_format = "JSON" if path.suffix.lower() == ".json" else "TOML"
    try:
        text = path.read_text(encoding="utf-8")
        table = json.loads(text) if file_format == "JSON" else tomllib.loads(text)
    except OSError as error:
        raise CalibrationError(f"cannot read {path}: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{path} is not a {file_format} file: {error}") from error
    if not isinstance(table, dict):
        raise CalibrationError(f"{path}: expected names with values, got {type(table).__name__}")
    unknown = [key for key in table if key not in KEYS]
    missing = [key for key in KEYS[:3] if key not in table]
    if unknown or missing:
        what = f"unknown key '{unknown[0]}'" if unknown else f"no key '{missing[0]}'"
        raise CalibrationError(f"{path}: {what}; known: {', '.join(KEYS)}")
    try:
        matrix = np.array(table["matrix"], np.float64)
    except (ValueError, TypeError) as error:
        raise CalibrationError(f"{path}: matrix: expected 3 rows of 4 numbers") from error
    if matrix.shape != (3, 4):
        raise CalibrationError(f"{path}: matrix: expected 3 rows of 4 numbers, got {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise CalibrationError(f"{path}: matrix: expected finite numbers")
    for key in ("width", "height"):
        if type(table[key]) is not int:
            raise CalibrationError(f"{path}: {key}: expected whole pixels, got {table[key]!r}")
    try:
        projection = Projection(matrix, table["width"], table["height"])
    except RecordError as error:
        raise CalibrationError(f"{path}: {error}") from error
    if projection.height_m < LOWEST_M:
        raise CalibrationError(
            f"{path}: matrix: expected a camera above the ground, got one at "
            f"{projection.height_m:.2f} m"
        )
    return projection


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
    return f'"{escaped}"'
