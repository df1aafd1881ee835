"""The matrix from points to pixels, by points that both sensors see (Li 2021, 2.2); its file."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.core import Pose, RecordError
from roadscope.core.projection import Projection

# --------------------------------------------------------------------------------------------------
# The matrix from points to pixels, found by points that both sensors see (Li 2021, 2.2, eq. 4).

LEAST_POINTS = 6
"""Six points fix the eleven numbers of the matrix."""
TRIES = 200
"""Number of random samples."""
FLAT = 1e-4
"""Points whose third extent is smaller than this share of the first lie in a plane."""


class CalibrationError(ValueError):
    """The points do not determine the matrix."""


@dataclass(frozen=True, slots=True)
class CalibrationResult:
    """A calibration and how well it holds.

    projection: the matrix. inliers: (N,) bool, points that agree with it.
    reprojection_px: root mean square of the distances of inliers in the image.
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
    """Find the projection from (N, 3) points, metres, and their (N, 2) pixels.

    Outliers are left out by random sampling of six points and a gate; the linear solution of the
    rest is refined to a camera with square-cornered pixels and a rotation, by least squares of
    pixels with a robust loss. intrinsics: (3, 3) where they are known already, which leaves only
    the mounting pose to be found.
    """
    points, pixels = np.asarray(points, np.float64), np.asarray(pixels, np.float64)
    _check(points, pixels)
    inliers = _agreeing(points, pixels, gate_px, np.random.default_rng(seed))
    for _ in range(3):
        linear = solve_linear(points[inliers], pixels[inliers])
        matrix = _refined(linear, points[inliers], pixels[inliers], intrinsics)
        errors = distances_px(matrix, points, pixels)
        now = errors < gate_px
        if now.sum() < LEAST_POINTS or (now == inliers).all():
            break
        inliers = now
    rms = float(np.sqrt((distances_px(matrix, points[inliers], pixels[inliers]) ** 2).mean()))
    return CalibrationResult(Projection(matrix, width, height), inliers, rms)


def solve_linear(points: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return (3, 4) A by the direct linear transform with normalised data (Hartley 1997)."""
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
    solution = np.linalg.svd(rows, full_matrices=len(rows) < 12)[2][-1].reshape(3, 4)
    matrix = np.linalg.inv(to_pixels) @ solution @ to_points
    return _with_depths(matrix, points)


def decompose(matrix: np.ndarray) -> tuple[np.ndarray, Pose]:
    """Split a (3, 4) matrix into (3, 3) intrinsics, last entry 1, and `ego_from_camera`."""
    from scipy.linalg import rq

    upper, rotation = rq(matrix[:, :3])
    signs = np.diag(np.where(np.diag(upper) < 0, -1.0, 1.0))
    upper, rotation = upper @ signs, signs @ rotation
    if np.linalg.det(rotation) < 0:
        raise CalibrationError("the matrix mirrors space")
    translation = np.linalg.solve(upper, matrix[:, 3])
    # Rounded once more to a rotation, so that the pose accepts it.
    left, _, right = np.linalg.svd(rotation)
    camera_from_ego = Pose.from_parts(left @ right, translation)
    return upper / upper[2, 2], camera_from_ego.inverse()


def distances_px(matrix: np.ndarray, points: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(N,) distances in the image; infinite for points behind the camera."""
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
    """Find the largest set of points that a linear solution of six of them explains."""
    best = distances_px(solve_linear(points, pixels), points, pixels) < gate_px
    if best.all():
        return best
    for _ in range(TRIES):
        chosen = rng.choice(len(points), LEAST_POINTS, replace=False)
        near = distances_px(solve_linear(points[chosen], pixels[chosen]), points, pixels) < gate_px
        if near.sum() > best.sum():
            best = near
    # Any six points have a matrix of their own.
    if 2 * best.sum() <= len(points):
        raise CalibrationError(
            f"no camera explains more than half of the {len(points)} points to {gate_px} pixels; "
            f"at best {best.sum()} of them"
        )
    return best


def _refined(
    matrix: np.ndarray,
    points: np.ndarray,
    pixels: np.ndarray,
    intrinsics: np.ndarray | None,
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

    def matrix_of(numbers: np.ndarray) -> np.ndarray:
        fx, fy, cx, cy = numbers[:4]
        turn = Rotation.from_rotvec(numbers[4:7]).as_matrix()
        inner = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        product: np.ndarray = inner @ np.column_stack([turn, numbers[7:10]])
        return product

    def residuals(numbers: np.ndarray) -> np.ndarray:
        projected = points @ matrix_of(numbers)[:, :3].T + matrix_of(numbers)[:, 3]
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
        lambda six: residuals(np.append(start[:4], six)), start[4:], loss="soft_l1"
    )
    return matrix_of(np.append(start[:4], pose.x))


def _normalised(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Move to mean 0 and mean distance 1 per axis: the transform, homogeneous, and the values."""
    dimensions = values.shape[1]
    mean = values.mean(axis=0)
    scale = 1.0 / max(float(np.abs(values - mean).mean()), 1e-12)
    transform = np.eye(dimensions + 1)
    transform[:dimensions] *= scale
    transform[:dimensions, dimensions] = -scale * mean
    return transform, scale * (values - mean)


def _with_depths(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Scale the matrix so that its third row gives metres, positive for most points."""
    scaled = matrix / np.linalg.norm(matrix[2, :3])
    depths = points @ scaled[2, :3] + scaled[2, 3]
    result: np.ndarray = scaled if np.median(depths) > 0 else -scaled
    return result


# --------------------------------------------------------------------------------------------------
# A calibration as a TOML or JSON file, and read back.

KEYS = ("matrix", "width", "height", "origin", "reprojection_px", "points")
LOWEST_M = 0.05
"""Height of the lowest camera that is believed."""


def write_calibration(path: Path | str, result: CalibrationResult, origin: str) -> None:
    """Write matrix, size of the image, error and where it comes from.

    A path that ends in .json gets JSON, any other TOML.
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
    """Read a projection; a file that holds none is refused with what is wrong in it."""
    path = Path(path)
    kind = "JSON" if path.suffix.lower() == ".json" else "TOML"
    try:
        text = path.read_text(encoding="utf-8")
        table = json.loads(text) if kind == "JSON" else tomllib.loads(text)
    except OSError as error:
        raise CalibrationError(f"cannot read {path}: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{path} is not a {kind} file: {error}") from error
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
