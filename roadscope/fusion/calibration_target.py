"""A triangular calibration target in both sensors (Li 2021, 2.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.fusion.calibration import CalibrationError

# --------------------------------------------------------------------------------------------------
# A triangular target's corners in both sensors (Li 2021, 2.2).

LEAST_RINGS = 3
LEAST_ROWS_PX = 12
BLUR_PX = 4
"""Farther than this from an edge, smoothed values are those of inside and outside."""
TRIM = 0.12
"""Share of an edge at each of its ends that is left out: corners are rounded by pixels."""


@dataclass(frozen=True, slots=True)
class TriangularTarget:
    """An isosceles triangle that stands on its base; all in metres."""

    base_m: float = 1.5
    height_m: float = 1.2

    @property
    def corners(self) -> np.ndarray:
        """(3, 2) left, right, top, in the target's plane about the middle of the base."""
        half = self.base_m / 2
        return np.array([[-half, 0.0], [half, 0.0], [0.0, self.height_m]])


def corners_in_scans(
    points: np.ndarray,
    ring: np.ndarray,
    column: np.ndarray,
    target: TriangularTarget,
    step_rad: float,
) -> np.ndarray:
    """Return (3, 3) left, right and top corner, LiDAR frame, from returns of the target alone.

    points: (N, 3) metres, of one or more scans of a target at rest. ring, column: (N,) of each.
    step_rad: between neighbouring columns. Beams are right in direction and wrong in range, so a
    plane gives the ranges; a ring ends half a step beyond its last beams, and the triangle of
    known size is fitted to these ends by least squares.
    """
    if len(np.unique(ring)) < LEAST_RINGS:
        raise CalibrationError(
            f"{len(np.unique(ring))} rings have returns of the target, {LEAST_RINGS} are needed"
        )
    normal, offset = _plane(points)
    across = np.cross([0.0, 0.0, 1.0], normal)
    across /= np.linalg.norm(across)
    up = np.cross(normal, across)
    ends, sides = _ring_ends(points, ring, column, step_rad)
    rays = ends / np.linalg.norm(ends, axis=1, keepdims=True)
    on_plane = rays * (offset / (rays @ normal))[:, None]
    flat = np.column_stack([on_plane @ across, on_plane @ up])
    # The sign of the normal decides whether `across` runs to the left or to the right.
    if flat[sides > 0, 0].mean() < flat[sides < 0, 0].mean():
        across, flat = -across, flat * [-1.0, 1.0]
    corners = _fitted_triangle(target.corners, flat, sides)
    # The origin of flat coordinates is the point of the plane nearest to the sensor.
    in_space: np.ndarray = corners[:, :1] * across + corners[:, 1:] * up + offset * normal
    return in_space


def corners_in_image(grey: np.ndarray) -> np.ndarray:
    """Return (3, 2) left, right and top corner in pixels of a bright triangle in a dark scene.

    grey: (H, W). The largest bright patch is the target; its edges are lines through where rows
    and columns cross the middle between bright and dark, to a part of a pixel.
    """
    from scipy.ndimage import gaussian_filter, label

    smooth = gaussian_filter(grey.astype(np.float64), 1.0)
    level = (np.percentile(smooth, 99.9) + np.median(smooth)) / 2
    patches, count = label(smooth > level)
    if not count:
        raise CalibrationError("no bright target in the image")
    largest = int(np.bincount(patches.ravel())[1:].argmax()) + 1
    rows, columns = np.nonzero(patches == largest)
    top, bottom = int(rows.min()), int(rows.max())
    if bottom - top < LEAST_ROWS_PX:
        raise CalibrationError(f"the target is {bottom - top} pixels high, {LEAST_ROWS_PX} needed")
    if (
        top == 0
        or bottom == grey.shape[0] - 1
        or columns.min() == 0
        or (columns.max() == grey.shape[1] - 1)
    ):
        raise CalibrationError("the image cuts the target")
    inside = _without_ends(top, bottom)
    lines = []
    for edge, step in ((np.min, -1), (np.max, 1)):
        pixels = [(int(edge(columns[rows == row])), row) for row in inside]
        lines.append(_line([(_crossing(smooth[row], c, step), row + 0.5) for c, row in pixels]))
    spread = _without_ends(int(columns.min()), int(columns.max()))
    feet = [(c, rows[columns == c].max()) for c in spread]
    lines.append(_line([(c + 0.5, _crossing(smooth[:, c], int(r), 1)) for c, r in feet]))
    left, right, base = lines
    return np.array(
        [_intersection(left, base), _intersection(right, base), _intersection(left, right)]
    )


def _plane(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return unit normal away from the sensor and distance of the plane whose ranges fit best.

    For n . p = d and p = range * ray, 1 / range = (n / d) . ray: linear in n / d, and noise
    stays along the ray. It is solved twice, the second time without outliers.
    """
    ranges = np.linalg.norm(points, axis=1)
    rays = points / ranges[:, None]
    inliers = np.ones(len(points), bool)
    for _ in range(2):
        scaled, ones = rays[inliers] * ranges[inliers, None], np.ones(inliers.sum())
        solved = np.linalg.lstsq(scaled, ones, rcond=None)[0]
        errors = np.abs(1 / np.maximum(rays @ solved, 1e-9) - ranges)
        inliers = errors < 3 * max(1.5 * float(np.median(errors)), 1e-6)
    length = float(np.linalg.norm(solved))
    return solved / length, 1 / length


def _ring_ends(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, step_rad: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return directions half a step beyond each ring's ends, and their sides: -1 right, 1 left."""
    directions, sides = [], []
    for one in np.unique(ring):
        members = np.flatnonzero(ring == one)
        azimuths = np.arctan2(points[members, 1], points[members, 0])
        for side in (-1.0, 1.0):
            last = members[(side * azimuths).argmax()]
            same = points[members[column[members] == column[last]]].mean(axis=0)
            turn = side * step_rad / 2
            c, s = np.cos(turn), np.sin(turn)
            x, y, z = same
            directions.append([c * x - s * y, s * x + c * y, z])
            sides.append(side)
    return np.array(directions), np.array(sides)


def _fitted_triangle(corners: np.ndarray, ends: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Move and turn a triangle so that ends lie on its slopes; left has greater first values."""
    from scipy.optimize import least_squares

    mirrored = corners * [-1.0, 1.0]
    left, right, top = mirrored

    def moved(numbers: np.ndarray) -> np.ndarray:
        c, s = np.cos(numbers[2]), np.sin(numbers[2])
        result: np.ndarray = mirrored @ np.array([[c, s], [-s, c]]) + numbers[:2]
        return result

    def residuals(numbers: np.ndarray) -> np.ndarray:
        a, b, peak = moved(numbers)
        from_left = _distances_from_line(ends, a, peak)
        return np.where(sides > 0, from_left, _distances_from_line(ends, b, peak))

    widths = ends[sides > 0, 0].mean() - ends[sides < 0, 0].mean()
    share = np.clip(widths / np.linalg.norm(left - right), 0.0, 1.0)
    start = [ends[:, 0].mean(), ends[:, 1].mean() - (1 - share) * top[1], 0.0]
    solution = least_squares(residuals, start, loss="soft_l1", f_scale=0.02)
    return moved(solution.x)


def _distances_from_line(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    along = (end - start) / np.linalg.norm(end - start)
    offsets = points - start
    result: np.ndarray = offsets[:, 0] * along[1] - offsets[:, 1] * along[0]
    return result


def _without_ends(low: int, high: int) -> np.ndarray:
    trim = TRIM * (high - low)
    return np.arange(int(np.ceil(low + trim)), int(high - trim) + 1)


def _crossing(values: np.ndarray, near: int, step: int) -> float:
    """Return where values fall through the middle between inside and outside, in pixel edges.

    near: an index at the edge; step: 1 or -1, the direction outwards. The background differs along
    the edge, road here and sky there, so each crossing has a middle of its own.
    """
    reach = [k for k in near + step * np.arange(-BLUR_PX, BLUR_PX + 1) if 0 <= k < len(values)]
    level = (values[reach[0]] + values[reach[-1]]) / 2
    for k, after in pairwise(reach):
        if values[k] > level >= values[after]:
            share = (values[k] - level) / (values[k] - values[after])
            return k + 0.5 + step * float(share)
    return near + 0.5


def _line(points: list[tuple[float, float]]) -> np.ndarray:
    """Return (3,) a, b, c of a x + b y = c, unit normal, by least squares without outliers."""
    inliers = np.array(points)
    line = np.zeros(3)
    for _ in range(8):
        middle = inliers.mean(axis=0)
        normal = np.linalg.svd(inliers - middle)[2][1]
        line = np.append(normal, normal @ middle)
        errors = np.abs(inliers @ normal - line[2])
        inliers = inliers[errors <= max(2.5 * float(np.median(errors)), 0.2)]
    return line


def _intersection(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    matrix = np.stack([first[:2], second[:2]])
    if abs(np.linalg.det(matrix)) < 1e-6:
        raise CalibrationError("two edges of the target are parallel in the image")
    solved: np.ndarray = np.linalg.solve(matrix, [first[2], second[2]])
    return solved


# --------------------------------------------------------------------------------------------------
# What a LiDAR at rest measures of a target: its plane, and between which beams it ends.

NEAR_BEAMS = 2
"""Beams farther than this from the target's edge, in columns, do not help to locate it."""
LEAST_RETURNS = 6
OUTLYING = 4.0
"""Ranges off by more than this many standard deviations are not the target's."""


@dataclass(frozen=True, slots=True, eq=False)
class BeamDirections(Record):
    """Directions of a LiDAR's beams: azimuths (C,) of columns, elevations (R,) of rings, rad."""

    azimuths: np.ndarray
    elevations: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, azimuths=(np.float64, ("C",)), elevations=(np.float64, ("R",)))

    @property
    def step_rad(self) -> float:
        """Between neighbouring columns."""
        return float(np.abs(np.median(np.diff(self.azimuths))))

    def rays(self, ring: np.ndarray, column: np.ndarray) -> np.ndarray:
        """(N, 3) unit directions, LiDAR frame."""
        azimuth, elevation = self.azimuths[column], self.elevations[ring]
        flat = np.cos(elevation)
        return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], -1)


@dataclass(frozen=True, slots=True, eq=False)
class ScannedTarget(Record):
    """A target at rest in many scans, all in the LiDAR's frame.

    plane: (3,) float64, 1/m, q of the plane q . p = 1.
    plane_root: (3, 3) float64; plane_root @ (q - plane) has unit covariance at the true q.
    rays: (N, 3) float64, unit directions of the beams beside the target's edge.
    hit_share: (N,) float64, share of the scans in which each beam met the target.
    step_rad: between neighbouring columns.
    """

    plane: np.ndarray
    plane_root: np.ndarray
    rays: np.ndarray
    hit_share: np.ndarray
    step_rad: float

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            plane=(np.float64, (3,)),
            plane_root=(np.float64, (3, 3)),
            rays=(np.float64, ("N", 3)),
            hit_share=(np.float64, ("N",)),
        )


def scanned_target(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, beams: BeamDirections, scans: int
) -> ScannedTarget:
    """Return what many scans measured of a target at rest.

    points: (N, 3) metres, LiDAR frame, of the target alone, from `scans` scans. ring, column: (N,).
    A beam without returns passed beside the target; `beams` has its direction.
    """
    if len(points) < LEAST_RETURNS:
        raise CalibrationError(f"expected at least {LEAST_RETURNS} returns, got {len(points)}")
    ranges = np.linalg.norm(points, axis=1)
    plane, root = _plane_in_beams(beams.rays(ring, column), ranges)
    rings, columns, hit_share = _beams_at_edges(ring, column, beams, scans)
    return ScannedTarget(plane, root, beams.rays(rings, columns), hit_share, beams.step_rad)


def _plane_in_beams(rays: np.ndarray, ranges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the likeliest plane of noisy ranges, and the root of its information matrix.

    range = 1 / (q . ray), by Gauss and Newton from the linear solution, without outliers.
    """
    plane = np.linalg.lstsq(rays * ranges[:, None], np.ones(len(rays)), rcond=None)[0]
    root, inliers = np.eye(3), np.ones(len(rays), bool)
    for _ in range(6):
        along = rays @ plane
        errors = ranges - 1 / along
        sigma = max(1.4826 * float(np.median(np.abs(errors[inliers]))), 1e-4)
        inliers = np.abs(errors) < OUTLYING * sigma
        slope = -rays[inliers] / along[inliers, None] ** 2
        plane = plane + np.linalg.lstsq(slope, errors[inliers], rcond=None)[0]
        root = np.asarray(np.linalg.qr(slope, mode="r")) / sigma
    return plane, root


def _beams_at_edges(
    ring: np.ndarray, column: np.ndarray, beams: BeamDirections, scans: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ring, column and share of returns of the beams next to the target's edge."""
    from scipy.ndimage import maximum_filter, minimum_filter

    count = np.zeros((len(beams.elevations), len(beams.azimuths)))
    np.add.at(count, (ring, column), 1.0)
    hit_share = np.minimum(count / scans, 1.0)
    size = (3, 2 * NEAR_BEAMS + 1)
    beside = (maximum_filter(hit_share, size) >= 0.5) & (minimum_filter(hit_share, size) < 0.5)
    rings, columns = np.nonzero(beside)
    return rings, columns, hit_share[rings, columns]


# --------------------------------------------------------------------------------------------------
# Errors between what both sensors should measure of targets in given poses, and what they did.

PIXEL_SIGMA = 0.2
"""Standard deviation of a corner in the image, pixels."""
STRAY = 0.01
"""Share of beams that meet something else or get lost; chosen by hand."""
ROBUST = 3.0
"""From so many standard deviations on, an error counts by its amount, not by its square."""


@dataclass(frozen=True, slots=True, eq=False)
class TargetMeasurements:
    """Measurements of P targets, the beams of each filled up to the same N.

    pixels: (P, 3, 2). planes: (P, 3), roots: (P, 3, 3), as in `ScannedTarget`. rays: (P, N, 3).
    hit_share: (P, N). real: (P, N) bool, false where filled up. steps: (P, 1), radians.
    """

    pixels: np.ndarray
    planes: np.ndarray
    roots: np.ndarray
    rays: np.ndarray
    hit_share: np.ndarray
    real: np.ndarray
    steps: np.ndarray


def stacked_measurements(
    pixels: np.ndarray, scanned: Sequence[ScannedTarget]
) -> TargetMeasurements:
    """Stack the measurements of all targets; pixels: (P, 3, 2)."""
    most = max(len(each.rays) for each in scanned)
    rays = np.stack([np.resize(each.rays, (most, 3)) for each in scanned])
    hit_share = np.stack([np.resize(each.hit_share, most) for each in scanned])
    real = np.arange(most) < np.array([[len(each.rays)] for each in scanned])
    planes, roots = np.stack([s.plane for s in scanned]), np.stack([s.plane_root for s in scanned])
    return TargetMeasurements(
        pixels, planes, roots, rays, hit_share, real, np.array([[s.step_rad] for s in scanned])
    )


def corners_of_targets(poses: np.ndarray, target: TriangularTarget) -> np.ndarray:
    """(P, 3, 3) corners of targets in (P, 3, 4) poses.

    The columns of a pose are right, up, towards the sensor, and the middle of the base.
    """
    corners: np.ndarray = np.einsum("pij,kj->pki", poses[:, :, :2], target.corners)
    return np.asarray(corners + poses[:, None, :, 3])


def image_errors(
    intrinsics: np.ndarray,
    camera: np.ndarray,
    poses: np.ndarray,
    measured: TargetMeasurements,
    target: TriangularTarget,
) -> np.ndarray:
    """(P, 6) errors of corners in pixels, in standard deviations.

    intrinsics: (4,) fx, fy, cx, cy, pixels. camera: (3, 4) `camera_from_lidar`.
    """
    placed = corners_of_targets(poses, target) @ camera[:, :3].T + camera[:, 3]
    pixels = intrinsics[:2] * placed[..., :2] / np.maximum(placed[..., 2:], 1e-3) + intrinsics[2:]
    return _robust(((pixels - measured.pixels) / PIXEL_SIGMA).reshape(len(poses), 6))


def range_errors(poses: np.ndarray, measured: TargetMeasurements) -> np.ndarray:
    """(P, 3) errors of the planes, in standard deviations."""
    return _robust(np.einsum("pij,pj->pi", measured.roots, planes_of(poses) - measured.planes))


def edge_errors(
    poses: np.ndarray, measured: TargetMeasurements, target: TriangularTarget, edge_width: float
) -> np.ndarray:
    """(P, N) errors of beams that met the target or passed beside it.

    Their squares are twice the log-likelihood that a beam loses by the target's pose.
    edge_width: standard deviation of where a beam ends, as a share of the step between columns.
    """
    from scipy.special import ndtr

    inside, reach = _distances_inside(poses, measured, target)
    chance = STRAY + (1 - 2 * STRAY) * ndtr(inside / (edge_width * measured.steps * reach))
    lost = -measured.hit_share * np.log(chance) - (1 - measured.hit_share) * np.log(1 - chance)
    # The floor keeps the root's slope finite.
    return np.where(measured.real, np.sqrt(2 * np.maximum(lost + np.log(1 - STRAY), 1e-12)), 0.0)


def planes_of(poses: np.ndarray) -> np.ndarray:
    """(P, 3) q of the targets' planes q . p = 1."""
    normals, middles = poses[:, :, 2], poses[:, :, 3]
    planes: np.ndarray = normals / (normals * middles).sum(axis=1, keepdims=True)
    return planes


def _distances_inside(
    poses: np.ndarray, measured: TargetMeasurements, target: TriangularTarget
) -> tuple[np.ndarray, np.ndarray]:
    """Return (P, N) metres of each beam from the nearest edge, positive inside, and its range."""
    along = np.einsum("pni,pi->pn", measured.rays, planes_of(poses))
    reach = 1 / np.maximum(along, 1e-3)
    from_middle = measured.rays * reach[..., None] - poses[:, None, :, 3]
    flat = from_middle @ poses[:, :, :2]
    inside = np.full(reach.shape, np.inf)
    for start, end in zip(target.corners, np.roll(target.corners, -1, axis=0), strict=True):
        along_edge = (end - start) / np.linalg.norm(end - start)
        offset = flat - start
        from_edge = offset[..., 1] * along_edge[0] - offset[..., 0] * along_edge[1]
        inside = np.minimum(inside, from_edge)
    return inside, reach


def _robust(errors: np.ndarray) -> np.ndarray:
    """Errors whose squares are the robust loss 2 c^2 (sqrt(1 + (e / c)^2) - 1)."""
    # 2 c^2 (sqrt(1 + x) - 1) = 2 e^2 / (sqrt(1 + x) + 1), which does not cancel.
    softer: np.ndarray = errors * np.sqrt(2 / (np.sqrt(1 + (errors / ROBUST) ** 2) + 1))
    return softer
