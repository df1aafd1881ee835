"""Pairs of LiDAR and camera detections, and the features by which they are judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import ImageDetections
from roadscope.core.category import families_of
from roadscope.core.projection import Projection
from roadscope.fusion.assembly import Views
from roadscope.fusion.evidence import camera_features, log_odds
from roadscope.fusion.overlap import areas, intersections, ious
from roadscope.fusion.sizes import SPREAD, USUAL_M
from roadscope.fusion.weights import ranking_model

# --------------------------------------------------------------------------------------------------
# Pairs of a LiDAR box and a camera box by overlap in the image, one to one.


def matched(views: Views, least_iou: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of P pairs of LiDAR and camera, (P,) each, one to one.

    They are the pairs of greatest total, where each counts 1 plus its intersection over union. A
    pair must have at least `least_iou`.
    """
    from scipy.optimize import linear_sum_assignment

    overlaps = ious(views.lidar_boxes, views.camera.boxes)
    overlaps[~views.in_image] = 0.0
    possible = overlaps >= least_iou
    rows, columns = linear_sum_assignment(np.where(possible, -overlaps - 1.0, 0.0))
    accepted = possible[rows, columns]
    return rows[accepted], columns[accepted]


def leftovers(count: int, paired: np.ndarray) -> np.ndarray:
    """Return the rows from 0 to `count` - 1 that are not among the paired ones."""
    return np.setdiff1d(np.arange(count), paired)


# --------------------------------------------------------------------------------------------------
# Depths of camera boxes, from their height and from the ground below them.

EDGE_PX, EDGE_SHARE = 2.0, 0.04
"""Standard deviation of an edge of a camera box: root sum of squares of the first and of this share
of the box's height. Chosen by hand."""
FARTHEST_M = 150.0
"""Greatest depth of the ground behind a pixel, also at and above the horizon. Chosen by hand."""
BORDER_PX = 2.0
"""A box that ends this close to the border of the image is cut by it. Chosen by hand."""
CUT_SD, LEAST_GROUND_SD, LOST_GROUND_SD = 1.0, 0.02, 3.0
"""Standard deviations of log depths: from the height of a box that the image cuts; the least one
from the ground; that from ground which is not visible. Chosen by hand."""


def depths_of(
    boxes: np.ndarray, categories: np.ndarray, projection: Projection
) -> tuple[np.ndarray, np.ndarray]:
    """Return (N,) natural logarithms of depths in metres, and their standard deviations.

    Depths are along the optical axis. Two estimates are averaged with inverse variances: one from
    the height in pixels and the usual height of the category, one from the depth of the ground,
    z = 0, at the lower edge of the box. The height of a box at the upper or the lower border of the
    image says little, because the box is cut. At the lower border the ground says little, too.
    """
    tall = np.maximum(boxes[:, 3] - boxes[:, 1], 1.0)
    edge = np.hypot(EDGE_PX, EDGE_SHARE * tall)
    focal = _focal(projection)
    by_height = np.log(focal * USUAL_M[categories, 2] / tall)
    sd_height = np.hypot(SPREAD[categories], 1.5 * edge / tall)
    cut_top = boxes[:, 1] <= BORDER_PX
    cut_bottom = boxes[:, 3] >= projection.height - BORDER_PX
    sd_height = np.where(cut_top | cut_bottom, CUT_SD, sd_height)
    middles = (boxes[:, 0] + boxes[:, 2]) / 2
    ground = ground_depths(np.column_stack([middles, boxes[:, 3]]), projection)
    beyond = ground_depths(np.column_stack([middles, boxes[:, 3] - edge]), projection)
    sd_ground = np.maximum(np.log(beyond / ground), LEAST_GROUND_SD)
    sd_ground = np.where(cut_bottom | (ground >= FARTHEST_M), LOST_GROUND_SD, sd_ground)
    weights = np.stack([sd_height**-2, sd_ground**-2])
    logs = (weights * np.stack([by_height, np.log(ground)])).sum(axis=0) / weights.sum(axis=0)
    return logs, 1 / np.sqrt(weights.sum(axis=0))


def ground_depths(pixels: np.ndarray, projection: Projection) -> np.ndarray:
    """Return (N,) depths, metres, of the ground behind (N, 2) pixels, up to `FARTHEST_M`."""
    ground_from_pixel = np.linalg.inv(projection.matrix[:, [0, 1, 3]])
    ground = np.column_stack([pixels, np.ones(len(pixels))]) @ ground_from_pixel.T
    # Homogeneous x and y on the ground, divided by the depth; the third entry is 1 / depth.
    depths: np.ndarray = 1 / np.maximum(ground[:, 2], 1 / FARTHEST_M)
    return depths


def places_at(pixels: np.ndarray, depths: np.ndarray, projection: Projection) -> np.ndarray:
    """Return (N, 3) points, metres, ego frame, behind (N, 2) pixels at (N,) depths in metres."""
    homogeneous = np.column_stack([pixels, np.ones(len(pixels))]) * depths[:, None]
    inverse = np.linalg.inv(projection.matrix[:, :3])
    points: np.ndarray = (homogeneous - projection.matrix[:, 3]) @ inverse.T
    return points


def _focal(projection: Projection) -> float:
    """Return the vertical focal length, pixels."""
    return float(np.linalg.norm(np.cross(projection.matrix[1, :3], projection.matrix[2, :3])))


# --------------------------------------------------------------------------------------------------
# Pairs of LiDAR and camera detections of one target: bearing, size and depth must agree.

OUTSIDE_COST = 1e6
"""Cost of pairs whose LiDAR box is not in the image."""
GATE = 14.0
"""Greatest cost of a pair; a chi-square with three degrees of freedom exceeds it in 0.3 %."""
FAMILY_COST = 2.0
"""Added to the cost of pairs whose families differ. Chosen by hand."""
BEARING_SHARE, BEARING_PX = 0.12, 2.0
"""Standard deviation of the difference of left, or of right edges: root sum of squares of the first
as a share of the camera box's width and of the second. Chosen by hand."""
SIZE_SLACK, MOST_SIZE_COST = 2.5, 9.0
"""Factor of that deviation for the difference of half widths, and greatest cost of this difference:
a cluster may show a part of a vehicle, or hold a person and what stands beside. Chosen by hand."""
LIDAR_DEPTH_SD = 0.08
"""Standard deviation of the log depth of a LiDAR detection. Chosen by hand."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """How well each of N LiDAR detections agrees with each of M camera detections.

    cost: (N, M) sum of squared differences of bearing, size and depth, each in standard deviations,
        `OUTSIDE_COST` for LiDAR boxes outside of the image.
    depth: (N, M) squared differences of log depth alone, in standard deviations.
    lidar_depths: (N,) metres, of centres along the optical axis, at least 0.5.
    log_depths, spreads: (M,) as from `depths_of`, of camera detections.
    """

    cost: np.ndarray
    depth: np.ndarray
    lidar_depths: np.ndarray
    log_depths: np.ndarray
    spreads: np.ndarray

    @staticmethod
    def of(views: Views, projection: Projection) -> Agreement:
        """Compare all pairs."""
        lidar_boxes, camera_boxes = views.lidar_boxes, views.camera.boxes
        logs, spreads = depths_of(camera_boxes, views.camera.categories, projection)
        _, centre_depths = projection.project(views.lidar.centres)
        depths = np.maximum(centre_depths, 0.5)
        wide = np.maximum(camera_boxes[:, 2] - camera_boxes[:, 0], 2.0)
        sd_px = np.hypot(BEARING_SHARE * wide, BEARING_PX)
        # Where the image cuts both boxes, their edges are equal and the difference is 0.
        offsets_px = lidar_boxes[:, None, [0, 2]] - camera_boxes[None][..., [0, 2]]
        edge_errors = offsets_px / sd_px[None, :, None]
        bearing_error = edge_errors.mean(axis=-1)
        size_error = (edge_errors[..., 1] - edge_errors[..., 0]) / 2 / SIZE_SLACK
        depth_error = (np.log(depths)[:, None] - logs) / np.hypot(spreads, LIDAR_DEPTH_SD)[None]
        cost = bearing_error**2 + np.minimum(size_error**2, MOST_SIZE_COST) + depth_error**2
        differs = families_of(views.lidar.categories)[:, None] != families_of(
            views.camera.categories
        )
        cost = cost + FAMILY_COST * differs
        cost[~views.in_image] = OUTSIDE_COST
        return Agreement(cost, depth_error**2, depths, logs, spreads)

    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of P pairs of LiDAR and camera, (P,) each, one to one.

        They have the least total of costs minus `GATE`.
        """
        from scipy.optimize import linear_sum_assignment

        gain = np.minimum(self.cost - GATE, 0.0)
        rows, columns = linear_sum_assignment(gain)
        accepted = self.cost[rows, columns] < GATE
        return rows[accepted], columns[accepted]


# --------------------------------------------------------------------------------------------------
# Features of candidates: of pairs, and of detections of one sensor alone.

LEND_DEPTH = 4.0
"""A camera box without a partner takes the distance of a cluster that covers its middle, if the
squared difference of their log depths, in standard deviations, is less than this: several people of
a crowd may be one cluster. Chosen by hand."""
NEARER_SHARE = 0.85
"""A cluster at less than this share of a camera box's depth may hide what the box shows. Chosen by
hand."""
MOST_COST = 40.0
"""Greatest cost of a pair as a feature: such a pair agrees in nothing. Chosen by hand."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """Everything that may be a target: P pairs, L LiDAR and C camera detections without a partner.

    rows, columns: (P,) LiDAR and camera detections of the pairs. lidar_only, camera_only: (L,) and
    (C,) detections without a partner.
    """

    rows: np.ndarray
    columns: np.ndarray
    lidar_only: np.ndarray
    camera_only: np.ndarray

    @staticmethod
    def of(views: Views, agreement: Agreement) -> Candidates:
        """Return the pairs that agree, and all other detections."""
        rows, columns = agreement.pairs()
        return Candidates(
            rows, columns, leftovers(len(views.lidar), rows), leftovers(len(views.camera), columns)
        )

    @property
    def lidar_rows(self) -> np.ndarray:
        """(P + L + C,) rows of LiDAR, -1 where the camera is alone."""
        return np.concatenate([self.rows, self.lidar_only, np.full(len(self.camera_only), -1)])

    @property
    def camera_rows(self) -> np.ndarray:
        """(P + L + C,) rows of the camera, -1 where LiDAR is alone."""
        return np.concatenate([self.columns, np.full(len(self.lidar_only), -1), self.camera_only])


def candidate_features(
    views: Views, agreement: Agreement, projection: Projection, candidates: Candidates
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the features of pairs, (P, 17), of LiDAR alone, (L, 8), and of camera alone, (C, 11).

    All have the features of their sensors. Further features:
    - of pairs: how well they agree, in all and in depth;
    - of camera boxes: the depth, whether the box is cut at the side, how much of it nearer clusters
      cover, and the log odds of the camera alone;
    - of clusters: the size in the image and in space; without a partner also the share of the
      cluster that lies in a camera box, because it may be a part of what the box shows;
    - of detections without a partner: the cost of the best one of the other sensor; of the camera's
      also whether a cluster may lend its distance.
    """
    of_lidar, of_camera = lidar_features(views), camera_alone_features(views.camera)
    rows, columns = candidates.rows, candidates.columns
    cost = np.minimum(agreement.cost, MOST_COST) / 10.0
    log_depths = agreement.log_depths - np.log(20.0)
    image, extent = cluster_sizes(views)
    covered, cut = covered_shares(views, agreement), cut_boxes(views.camera, projection)
    alone = ranking_model().values(of_camera)[:, 0]
    pairs = np.column_stack(
        [
            of_lidar[rows],
            of_camera[columns],
            cost[rows, columns],
            agreement.depth[rows, columns] / 10.0,
            log_depths[columns],
            image[rows],
            extent[rows],
            covered[columns],
            cut[columns],
            alone[columns],
        ]
    )
    shared = intersections(views.lidar_boxes, views.camera.boxes).max(axis=1, initial=0.0)
    part = shared / np.maximum(areas(views.lidar_boxes), 1.0)
    best = cost.min(axis=1, initial=MOST_COST / 10.0)
    lidar_only = np.column_stack([of_lidar, part, image, extent, best])
    nearest = cost.min(axis=0, initial=MOST_COST / 10.0)
    has_lender = lenders(views, agreement)[0]
    camera_only = np.column_stack([of_camera, log_depths, has_lender, covered, cut, nearest, alone])
    return pairs, lidar_only[candidates.lidar_only], camera_only[candidates.camera_only]


def lidar_features(views: Views) -> np.ndarray:
    """Return (N, 4): log odds of the score, log of range / 20 m, cyclist, pedestrian (0 or 1)."""
    ranges = np.hypot(views.lidar.centres[:, 0], views.lidar.centres[:, 1])
    family = families_of(views.lidar.categories)
    return np.column_stack(
        [
            log_odds(views.lidar.scores),
            np.log(np.maximum(ranges, 1.0) / 20.0),
            family == 1,
            family == 2,
        ]
    )


def camera_alone_features(camera: ImageDetections) -> np.ndarray:
    """Return (M, 5): `camera_features`, and the greatest overlap with a box of higher score."""
    is_higher = camera.scores[None] > camera.scores[:, None]
    overlap = np.where(is_higher, ious(camera.boxes, camera.boxes), 0.0).max(axis=1, initial=0.0)
    return np.column_stack([camera_features(camera), overlap])


def cluster_sizes(views: Views) -> tuple[np.ndarray, np.ndarray]:
    """Return (N,) log of the height of clusters / 40 pixels, and of their greatest extent / 1 m."""
    tall = np.maximum(views.lidar_boxes[:, 3] - views.lidar_boxes[:, 1], 1.0)
    extent = np.maximum(views.lidar.sizes.max(axis=1, initial=0.0), 0.2)
    return np.where(views.in_image, np.log(tall / 40.0), 0.0), np.log(extent)


def covered_shares(views: Views, agreement: Agreement) -> np.ndarray:
    """Return (M,) the greatest share of each camera box that one nearer cluster covers.

    A cluster is nearer at less than `NEARER_SHARE` of the box's depth.
    """
    nearer = agreement.lidar_depths[:, None] < NEARER_SHARE * np.exp(agreement.log_depths)
    shared = intersections(views.lidar_boxes, views.camera.boxes)
    shared = np.where(nearer & views.in_image[:, None], shared, 0.0).max(axis=0, initial=0.0)
    shares: np.ndarray = shared / np.maximum(areas(views.camera.boxes), 1.0)
    return shares


def cut_boxes(camera: ImageDetections, projection: Projection) -> np.ndarray:
    """Return (M,) bool, whether a box ends at the left or right border of the image."""
    right = projection.width - BORDER_PX
    cut: np.ndarray = (camera.boxes[:, 0] < BORDER_PX) | (camera.boxes[:, 2] > right)
    return cut


def lenders(views: Views, agreement: Agreement) -> tuple[np.ndarray, np.ndarray]:
    """Return (M,) whether a cluster may lend its distance to each camera box, and (M,) which.

    It covers the box's middle, from left to right, at about the same depth; see `LEND_DEPTH`.
    """
    boxes = views.camera.boxes
    if not len(views.lidar):
        return np.zeros(len(boxes), bool), np.full(len(boxes), -1)
    middles = (boxes[:, 0] + boxes[:, 2]) / 2
    left, right = views.lidar_boxes[:, None, 0], views.lidar_boxes[:, None, 2]
    covers = (left <= middles) & (middles <= right) & views.in_image[:, None]
    differences = np.where(covers, agreement.depth, np.inf)
    best = differences.argmin(axis=0)
    return differences[best, np.arange(len(boxes))] < LEND_DEPTH, best
