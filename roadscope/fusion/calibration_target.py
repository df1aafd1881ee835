"""A triangular calibration target as both sensors measure it (Li 2021, 2.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record
from roadscope.fusion.calibration import CalibrationError

# --------------------------------------------------------------------------------------------------
# The target's corners in scans and in images.

LEAST_RINGS = 3
"""Least number of rings with returns of the target. Chosen by hand."""
EDGE_SCALE_M = 0.02
"""Larger distances of ring ends from the triangle's edges have less weight. Chosen by hand."""
LEAST_ROWS_PX = 12
"""Least height of the target in the image. Chosen by hand."""
BLUR_PX = 4
"""Farther than this from an edge, smoothed brightness is that of the inside or of the outside: four
standard deviations of the smoothing."""
TRIM = 0.12
"""Share of an edge at each of its ends that is left out: pixels and smoothing round the corners.
Chosen by hand."""


@dataclass(frozen=True, slots=True)
class TriangularTarget:
    """The size of a target: an isosceles triangle that stands on its base."""

    base_m: float = 1.5
    height_m: float = 1.2

    @property
    def corners(self) -> np.ndarray:
        """(3, 2) left, right and top corner: x right and y up from the base's middle, metres."""
        half = self.base_m / 2
        return np.array([[-half, 0.0], [half, 0.0], [0.0, self.height_m]])


def corners_in_scans(
    points: np.ndarray,
    ring: np.ndarray,
    column: np.ndarray,
    target: TriangularTarget,
    step_rad: float,
) -> np.ndarray:
    """Return the (3, 3) left, right and top corner, metres, LiDAR frame.

    points: (N, 3) metres, LiDAR frame, returns of the target alone, from one or more scans of a
        target at rest. ring, column: (N,) of each.
    step_rad: azimuth between neighbouring columns.

    Directions of beams are taken as exact, ranges as noisy: a plane fitted to the returns gives the
    ranges. A ring of the target ends half a step beyond its last beams. The triangle of known size
    is fitted to these ends by least squares.
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
    # `across` must point to the left; the sign of the normal decides where it points.
    if flat[sides > 0, 0].mean() < flat[sides < 0, 0].mean():
        across, flat = -across, flat * [-1.0, 1.0]
    corners = _fitted_triangle(target.corners, flat, sides)
    # Coordinates in the plane count from its point nearest to the sensor.
    result: np.ndarray = corners[:, :1] * across + corners[:, 1:] * up + offset * normal
    return result


def corners_in_image(grey: np.ndarray) -> np.ndarray:
    """Return the (3, 2) left, right and top corner, pixels, of a bright triangle in a dark scene.

    grey: (H, W) brightness in any unit. The largest bright patch is the target. Along each row and
    column the brightness falls through the middle between inside and outside at a fraction of a
    pixel; lines are fitted to these places, and their intersections are the corners.
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
    rows_inside = _without_ends(top, bottom)
    lines = []
    for edge, step in ((np.min, -1), (np.max, 1)):
        pixels = [(int(edge(columns[rows == row])), row) for row in rows_inside]
        lines.append(_line([(_crossing(smooth[row], c, step), row + 0.5) for c, row in pixels]))
    columns_inside = _without_ends(int(columns.min()), int(columns.max()))
    lowest = [(c, rows[columns == c].max()) for c in columns_inside]
    lines.append(_line([(c + 0.5, _crossing(smooth[:, c], int(r), 1)) for c, r in lowest]))
    left, right, base = lines
    return np.array(
        [_intersection(left, base), _intersection(right, base), _intersection(left, right)]
    )


def _plane(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the unit normal, away from the sensor, and the distance in metres of a fitted plane.

    With the plane n . p = d and p = range * ray, range * (n / d) . ray = 1, which is linear in
    n / d. It is solved twice, the second time without outliers.
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
    """Return directions (K, 3) half a step beyond ends of rings, and sides (K,): -1 right, 1 left.

    Directions are not unit vectors. Elevations are means over the returns of the last column.
    """
    directions, sides = [], []
    # From the middle of the target, which may lie across an azimuth of 180 degrees.
    middle_x, middle_y = points[:, :2].mean(axis=0)
    for one in np.unique(ring):
        members = np.flatnonzero(ring == one)
        x, y = points[members, 0], points[members, 1]
        azimuths = np.arctan2(middle_x * y - middle_y * x, middle_x * x + middle_y * y)
        for side in (-1.0, 1.0):
            last = members[(side * azimuths).argmax()]
            x, y, z = points[members[column[members] == column[last]]].mean(axis=0)
            turn = side * step_rad / 2
            c, s = np.cos(turn), np.sin(turn)
            directions.append([c * x - s * y, s * x + c * y, z])
            sides.append(side)
    return np.array(directions), np.array(sides)


def _fitted_triangle(corners: np.ndarray, ends: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return the (3, 2) corners of a triangle moved so that ends of rings lie on its slanted edges.

    corners: as in `TriangularTarget`. ends: (K, 2) metres in the target's plane, the first axis to
    the left; sides: (K,) as from `_ring_ends`.
    """
    from scipy.optimize import least_squares

    mirrored = corners * [-1.0, 1.0]
    left, right, top = mirrored

    def moved(pose: np.ndarray) -> np.ndarray:
        c, s = np.cos(pose[2]), np.sin(pose[2])
        result: np.ndarray = mirrored @ np.array([[c, s], [-s, c]]) + pose[:2]
        return result

    def residuals(pose: np.ndarray) -> np.ndarray:
        a, b, peak = moved(pose)
        from_left = _distances_from_line(ends, a, peak)
        return np.where(sides > 0, from_left, _distances_from_line(ends, b, peak))

    # The mean width of the rings, as a share of the base, says how high up they lie on average.
    mean_width = ends[sides > 0, 0].mean() - ends[sides < 0, 0].mean()
    share = np.clip(mean_width / np.linalg.norm(left - right), 0.0, 1.0)
    start = [ends[:, 0].mean(), ends[:, 1].mean() - (1 - share) * top[1], 0.0]
    solution = least_squares(residuals, start, loss="soft_l1", f_scale=EDGE_SCALE_M)
    return moved(solution.x)


def _distances_from_line(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the (N,) distances of (N, 2) points from a line, positive to the right of it.

    The line goes from `start` to `end`.
    """
    along = (end - start) / np.linalg.norm(end - start)
    offsets = points - start
    result: np.ndarray = offsets[:, 0] * along[1] - offsets[:, 1] * along[0]
    return result


def _without_ends(low: int, high: int) -> np.ndarray:
    """Return the whole numbers from low to high without the share `TRIM` at either end."""
    trim = TRIM * (high - low)
    return np.arange(int(np.ceil(low + trim)), int(high - trim) + 1)


def _crossing(values: np.ndarray, near: int, step: int) -> float:
    """Return where values fall through the middle between inside and outside.

    The unit is pixels; pixel k extends from k to k + 1. near: an index at the edge. step: 1 or -1,
    the direction outwards. The middle is computed for each crossing, because the background differs
    along the edge: road here, sky there.
    """
    outwards = [k for k in near + step * np.arange(-BLUR_PX, BLUR_PX + 1) if 0 <= k < len(values)]
    level = (values[outwards[0]] + values[outwards[-1]]) / 2
    for k, after in pairwise(outwards):
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
    """Return the (2,) intersection of two lines as from `_line`."""
    matrix = np.stack([first[:2], second[:2]])
    if abs(np.linalg.det(matrix)) < 1e-6:
        raise CalibrationError("two edges of the target are parallel in the image")
    solved: np.ndarray = np.linalg.solve(matrix, [first[2], second[2]])
    return solved


# --------------------------------------------------------------------------------------------------
# What a LiDAR at rest measures of a target: its plane, and between which beams its edges lie.

NEAR_BEAMS = 2
"""Beams farther than this from the target's edge, in columns, do not help to locate it. Chosen by
hand."""
LEAST_RETURNS = 6
"""Least number of returns from a target. Chosen by hand."""
OUTLYING = 4.0
"""Ranges whose error is more standard deviations than this are outliers. Chosen by hand."""


@dataclass(frozen=True, slots=True, eq=False)
class BeamDirections(Record):
    """Directions of a LiDAR's beams: azimuths (C,) of columns, elevations (R,) of rings, rad."""

    azimuths: np.ndarray
    elevations: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, azimuths=(np.float64, ("C",)), elevations=(np.float64, ("R",)))

    @property
    def step_rad(self) -> float:
        """Azimuth between neighbouring columns."""
        return float(np.abs(np.median(np.diff(self.azimuths))))

    def rays(self, ring: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Return the (N, 3) unit vectors, LiDAR frame, of beams by (N,) ring and column."""
        azimuth, elevation = self.azimuths[column], self.elevations[ring]
        flat = np.cos(elevation)
        return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], -1)


@dataclass(frozen=True, slots=True, eq=False)
class ScannedTarget(Record):
    """A target at rest in many scans, in the LiDAR frame.

    plane: (3,) float64, 1/m, q of the plane q . p = 1.
    plane_root: (3, 3) float64, metres, square root R of the information matrix R'R of q;
        R (q - plane) has unit covariance at the true q.
    rays: (N, 3) float64, unit vectors of the beams near the target's edges.
    hit_share: (N,) float64, share of the scans in which each of these beams hit the target.
    step_rad: azimuth between neighbouring columns.
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

    points: (N, 3) metres, LiDAR frame, returns of the target alone. ring, column: (N,) of each.
    beams: directions of all beams; those without a return of the target missed it.
    scans: number of scans from which the returns are.
    """
    if len(points) < LEAST_RETURNS:
        raise CalibrationError(f"expected at least {LEAST_RETURNS} returns, got {len(points)}")
    ranges = np.linalg.norm(points, axis=1)
    plane, root = _plane_in_beams(beams.rays(ring, column), ranges)
    rings, columns, hit_share = _beams_at_edges(ring, column, beams, scans)
    return ScannedTarget(plane, root, beams.rays(rings, columns), hit_share, beams.step_rad)


def _plane_in_beams(rays: np.ndarray, ranges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the likeliest q of the plane of noisy ranges, and the root of its information matrix.

    The ranges are 1 / (q . ray). Gauss-Newton steps from the linear solution, without outliers.
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
    """Return ring, column and hit share of the beams near the target's edges."""
    from scipy.ndimage import maximum_filter, minimum_filter

    count = np.zeros((len(beams.elevations), len(beams.azimuths)))
    np.add.at(count, (ring, column), 1.0)
    hit_share = np.minimum(count / scans, 1.0)
    size = (3, 2 * NEAR_BEAMS + 1)
    beside = (maximum_filter(hit_share, size) >= 0.5) & (minimum_filter(hit_share, size) < 0.5)
    rings, columns = np.nonzero(beside)
    return rings, columns, hit_share[rings, columns]


# --------------------------------------------------------------------------------------------------
# Errors of all measurements of targets in assumed poses.

PIXEL_SIGMA = 0.2
"""Standard deviation of a corner in the image, pixels. Chosen by hand."""
STRAY = 0.01
"""Share of beams that hit something else or have no return. Chosen by hand."""
ROBUST = 3.0
"""From about so many standard deviations on, the loss grows in proportion to the error rather than
to its square. Chosen by hand."""


@dataclass(frozen=True, slots=True, eq=False)
class TargetMeasurements:
    """Measurements of P targets, the beams of each padded to the same number N.

    pixels: (P, 3, 2) corners. planes: (P, 3), roots: (P, 3, 3), rays: (P, N, 3) and hit_share:
    (P, N), as in `ScannedTarget`. real: (P, N) bool, False for padding. steps: (P, 1), radians.
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
    """Return the measurements of P targets in one record; pixels: (P, 3, 2) corners."""
    most = max(len(each.rays) for each in scanned)
    rays = np.stack([np.resize(each.rays, (most, 3)) for each in scanned])
    hit_share = np.stack([np.resize(each.hit_share, most) for each in scanned])
    real = np.arange(most) < np.array([[len(each.rays)] for each in scanned])
    planes, roots = np.stack([s.plane for s in scanned]), np.stack([s.plane_root for s in scanned])
    return TargetMeasurements(
        pixels, planes, roots, rays, hit_share, real, np.array([[s.step_rad] for s in scanned])
    )


def corners_of_targets(poses: np.ndarray, target: TriangularTarget) -> np.ndarray:
    """Return the (P, 3, 3) corners, metres, of targets in (P, 3, 4) poses.

    The columns of a pose are the unit vectors to the right, up and towards the sensor, and the
    middle of the base.
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
    """Return the (P, 6) errors of corners in the image, in standard deviations.

    intrinsics: (4,) fx, fy, cx, cy, pixels. camera: (3, 4) `camera_from_lidar`. poses: (P, 3, 4)
    of the targets, see `corners_of_targets`.
    """
    placed = corners_of_targets(poses, target) @ camera[:, :3].T + camera[:, 3]
    pixels = intrinsics[:2] * placed[..., :2] / np.maximum(placed[..., 2:], 1e-3) + intrinsics[2:]
    return _robust(((pixels - measured.pixels) / PIXEL_SIGMA).reshape(len(poses), 6))


def range_errors(poses: np.ndarray, measured: TargetMeasurements) -> np.ndarray:
    """Return the (P, 3) errors of the planes, in standard deviations, for (P, 3, 4) poses."""
    return _robust(np.einsum("pij,pj->pi", measured.roots, planes_of(poses) - measured.planes))


def edge_errors(
    poses: np.ndarray, measured: TargetMeasurements, target: TriangularTarget, edge_width: float
) -> np.ndarray:
    """Return the (P, N) errors of the shares of beams that hit the targets, for (P, 3, 4) poses.

    Their squares are twice the negative log-likelihood of the hit shares, counted from its least
    value for a beam that always hits.
    edge_width: standard deviation of a beam's direction at an edge, as a share of the step between
        columns.
    """
    from scipy.special import ndtr

    inside, reach = _distances_inside(poses, measured, target)
    hit = STRAY + (1 - 2 * STRAY) * ndtr(inside / (edge_width * measured.steps * reach))
    cost = -measured.hit_share * np.log(hit) - (1 - measured.hit_share) * np.log(1 - hit)
    # With the floor the derivative of the root stays finite.
    return np.where(measured.real, np.sqrt(2 * np.maximum(cost + np.log(1 - STRAY), 1e-12)), 0.0)


def planes_of(poses: np.ndarray) -> np.ndarray:
    """Return q, (P, 3) 1/m, of the planes q . p = 1 of targets in (P, 3, 4) poses."""
    normals, middles = poses[:, :, 2], poses[:, :, 3]
    planes: np.ndarray = normals / (normals * middles).sum(axis=1, keepdims=True)
    return planes


def _distances_inside(
    poses: np.ndarray, measured: TargetMeasurements, target: TriangularTarget
) -> tuple[np.ndarray, np.ndarray]:
    """Return (P, N) distances in metres of beams from the nearest edge, and ranges at the planes.

    Distances are positive inside the target.
    """
    along = np.einsum("pni,pi->pn", measured.rays, planes_of(poses))
    reach = 1 / np.maximum(along, 1e-3)
    from_base = measured.rays * reach[..., None] - poses[:, None, :, 3]
    flat = from_base @ poses[:, :, :2]
    inside = np.full(reach.shape, np.inf)
    for start, end in zip(target.corners, np.roll(target.corners, -1, axis=0), strict=True):
        along_edge = (end - start) / np.linalg.norm(end - start)
        offset = flat - start
        from_edge = offset[..., 1] * along_edge[0] - offset[..., 0] * along_edge[1]
        inside = np.minimum(inside, from_edge)
    return inside, reach


def _robust(errors: np.ndarray) -> np.ndarray:
    """Return errors whose squares are the pseudo-Huber loss 2 c^2 (sqrt(1 + (e / c)^2) - 1)."""
    # With x = (e / c)^2 it is 2 e^2 / (sqrt(1 + x) + 1), which does not cancel.
    softer: np.ndarray = errors * np.sqrt(2 / (np.sqrt(1 + (errors / ROBUST) ** 2) + 1))
    return softer
