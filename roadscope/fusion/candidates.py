"""Pairs of LiDAR and camera detections, and the features by which they are judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import ImageDetections
from roadscope.core.projection import Projection
from roadscope.fusion.assembly import Views
from roadscope.fusion.evidence import camera_features, families_of, log_odds
from roadscope.fusion.overlap import areas, intersections, ious
from roadscope.fusion.sizes import SPREAD, USUAL_M
from roadscope.fusion.weights import ranking_model

# --------------------------------------------------------------------------------------------------
# Which LiDAR box and which camera box show the same target, one to one.


def matched(views: Views, least_iou: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rows of LiDAR and camera, (M,) each, that maximise the sum of overlaps."""
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
# How far away things in an image are, from their height and from where they stand.

EDGE_PX = 2.0
"""Standard deviation of an edge of a box, beside a share of its size."""
EDGE_SHARE = 0.04
FARTHEST_M = 150.0
"""Greatest depth of the ground behind a pixel, also at and above the horizon."""
BORDER_PX = 2.0
"""A box that ends this close to the edge of the image is cut by it."""


def depths_of(
    boxes: np.ndarray, categories: np.ndarray, projection: Projection
) -> tuple[np.ndarray, np.ndarray]:
    """Return (N,) log depths, metres along the optical axis, and their standard deviations.

    Two estimates are averaged by their variances: that from the height in pixels and the usual
    height of the category, and that from the ground z = 0 under the lower edge. A box that touches
    the upper or the lower edge of the image is cut, and its height says little; at the lower edge
    the second estimate is lost too.
    """
    tall = np.maximum(boxes[:, 3] - boxes[:, 1], 1.0)
    edge = np.hypot(EDGE_PX, EDGE_SHARE * tall)
    focal = _focal(projection)
    by_height = np.log(focal * USUAL_M[categories, 2] / tall)
    sd_height = np.hypot(SPREAD[categories], 1.5 * edge / tall)
    cut_top = boxes[:, 1] <= BORDER_PX
    cut_foot = boxes[:, 3] >= projection.height - BORDER_PX
    sd_height = np.where(cut_top | cut_foot, 1.0, sd_height)
    middles = (boxes[:, 0] + boxes[:, 2]) / 2
    ground = ground_depths(np.column_stack([middles, boxes[:, 3]]), projection)
    beyond = ground_depths(np.column_stack([middles, boxes[:, 3] - edge]), projection)
    sd_ground = np.maximum(np.log(beyond / ground), 0.02)
    sd_ground = np.where(cut_foot | (ground >= FARTHEST_M), 3.0, sd_ground)
    weights = np.stack([sd_height**-2, sd_ground**-2])
    logs = (weights * np.stack([by_height, np.log(ground)])).sum(axis=0) / weights.sum(axis=0)
    return logs, 1 / np.sqrt(weights.sum(axis=0))


def ground_depths(pixels: np.ndarray, projection: Projection) -> np.ndarray:
    """(N,) depths of the ground behind (N, 2) pixels, 150 m at and above the horizon."""
    plane = np.linalg.inv(projection.matrix[:, [0, 1, 3]])
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ plane.T
    # The third entry is the reciprocal of the depth.
    depths: np.ndarray = 1 / np.maximum(rays[:, 2], 1 / FARTHEST_M)
    return depths


def places_at(pixels: np.ndarray, depths: np.ndarray, projection: Projection) -> np.ndarray:
    """(N, 3) points of the ego frame behind (N, 2) pixels at (N,) depths."""
    homogeneous = np.column_stack([pixels, np.ones(len(pixels))]) * depths[:, None]
    inverse = np.linalg.inv(projection.matrix[:, :3])
    points: np.ndarray = (homogeneous - projection.matrix[:, 3]) @ inverse.T
    return points


def _focal(projection: Projection) -> float:
    """Focal length along rows, pixels."""
    return float(np.linalg.norm(np.cross(projection.matrix[1, :3], projection.matrix[2, :3])))


# --------------------------------------------------------------------------------------------------
# Which LiDAR and camera detections are one target: bearing, size and depth must agree.

NEVER = 1e6
GATE = 14.0
"""Greatest cost of a pair; a chi-square of three terms exceeds it in 0.3 %."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """How well each pair agrees.

    cost: (N, M) sum of squared deviations in standard deviations, `NEVER` outside of the image.
    depth: (N, M) those of depth alone. lidar_depths: (N,) metres, of centres
        along the optical axis, 0.5 at least.
    log_depths, spreads: (M,) of the camera's boxes.
    """

    cost: np.ndarray
    depth: np.ndarray
    lidar_depths: np.ndarray
    log_depths: np.ndarray
    spreads: np.ndarray

    @staticmethod
    def of(views: Views, projection: Projection) -> Agreement:
        """Compare all pairs."""
        ours, theirs = views.lidar_boxes, views.camera.boxes
        logs, spreads = depths_of(theirs, views.camera.categories, projection)
        _, middle = projection.project(views.lidar.centres)
        depths = np.maximum(middle, 0.5)
        wide = np.maximum(theirs[:, 2] - theirs[:, 0], 2.0)
        tolerance = np.hypot(0.12 * wide, 2.0)
        # An edge that the image cuts says nothing; both are cut at the same place.
        ends = (ours[:, None, [0, 2]] - theirs[None][..., [0, 2]]) / tolerance[None, :, None]
        middle_error = ends.mean(axis=-1)
        size_error = (ends[..., 1] - ends[..., 0]) / 2
        # A cluster may show a part of a vehicle, or hold a person and what stands beside.
        size_error = size_error / 2.5
        depth_error = (np.log(depths)[:, None] - logs) / np.hypot(spreads, 0.08)[None]
        cost = middle_error**2 + np.minimum(size_error**2, 9.0) + depth_error**2
        differs = families_of(views.lidar.categories)[:, None] != families_of(
            views.camera.categories
        )
        cost = cost + 2.0 * differs
        cost[~views.in_image] = NEVER
        return Agreement(cost, depth_error**2, depths, logs, spreads)

    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of LiDAR and camera, one to one, of least total cost below the gate."""
        from scipy.optimize import linear_sum_assignment

        gain = np.minimum(self.cost - GATE, 0.0)
        rows, columns = linear_sum_assignment(gain)
        accepted = self.cost[rows, columns] < GATE
        return rows[accepted], columns[accepted]


# --------------------------------------------------------------------------------------------------
# Features of candidates: of pairs, and of detections of one sensor alone.

LEND_DEPTH = 4.0
"""A camera box without a partner takes the distance of a cluster that covers its middle, if the
squared difference of their depths, in standard deviations, is less: several people of a crowd may
be one cluster."""
NEARER = 0.85
"""A cluster at less than this share of a camera box's distance may hide what the box shows."""
WORST = 40.0
"""Greatest cost of a pair as a feature; such a pair agrees in nothing."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """Everything that may be a target.

    rows, columns: (P,) the LiDAR and the camera detections of pairs. lidar_only, camera_only: (L,)
    and (C,) the detections without a partner.
    """

    rows: np.ndarray
    columns: np.ndarray
    lidar_only: np.ndarray
    camera_only: np.ndarray

    @staticmethod
    def of(views: Views, agreement: Agreement) -> Candidates:
        """Pair what agrees."""
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
    """Features of pairs, (P, 17), of LiDAR's alone, (L, 8), of the camera's alone, (C, 11).

    All have the features of their sensors. Further features:
    - of pairs: how well they agree, in all and in depth;
    - of camera boxes: the distance, whether the box is cut, how much of it nearer clusters cover,
      and how sure the camera alone would be;
    - of clusters: the size in the image and in space; without a partner also the share of the
      cluster that lies in a camera box, because it may be a part of what the box shows;
    - of both without a partner: how well the best one of the other sensor agrees.
    """
    of_lidar, of_camera = lidar_features(views), camera_alone_features(views.camera)
    rows, columns = candidates.rows, candidates.columns
    cost = np.minimum(agreement.cost, WORST) / 10.0
    far = agreement.log_depths - np.log(20.0)
    image, extent = cluster_sizes(views)
    covered, cut = covered_shares(views, agreement), cut_boxes(views.camera, projection)
    alone = ranking_model().values(of_camera)[:, 0]
    pairs = np.column_stack(
        [
            of_lidar[rows],
            of_camera[columns],
            cost[rows, columns],
            agreement.depth[rows, columns] / 10.0,
            far[columns],
            image[rows],
            extent[rows],
            covered[columns],
            cut[columns],
            alone[columns],
        ]
    )
    shared = intersections(views.lidar_boxes, views.camera.boxes).max(axis=1, initial=0.0)
    part = shared / np.maximum(areas(views.lidar_boxes), 1.0)
    best = cost.min(axis=1, initial=WORST / 10.0)
    lidar_only = np.column_stack([of_lidar, part, image, extent, best])
    nearest = cost.min(axis=0, initial=WORST / 10.0)
    has_lender = lenders(views, agreement)[0]
    camera_only = np.column_stack([of_camera, far, has_lender, covered, cut, nearest, alone])
    return pairs, lidar_only[candidates.lidar_only], camera_only[candidates.camera_only]


def lidar_features(views: Views) -> np.ndarray:
    """(N, 4): log odds of the score, log of the range over 20 m, cyclist, pedestrian (0, 1)."""
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
    """(M, 5): `camera_features`, and the greatest overlap with a box of higher score."""
    surer = camera.scores[None] > camera.scores[:, None]
    overlap = np.where(surer, ious(camera.boxes, camera.boxes), 0.0).max(axis=1, initial=0.0)
    return np.column_stack([camera_features(camera), overlap])


def cluster_sizes(views: Views) -> tuple[np.ndarray, np.ndarray]:
    """(N,) log of a cluster's height over 40 pixels, and log of its greatest extent in metres."""
    tall = np.maximum(views.lidar_boxes[:, 3] - views.lidar_boxes[:, 1], 1.0)
    extent = np.maximum(views.lidar.sizes.max(axis=1, initial=0.0), 0.2)
    return np.where(views.in_image, np.log(tall / 40.0), 0.0), np.log(extent)


def covered_shares(views: Views, agreement: Agreement) -> np.ndarray:
    """(M,) greatest share of a camera's box that a cluster nearer than what it shows covers."""
    nearer = agreement.lidar_depths[:, None] < NEARER * np.exp(agreement.log_depths)
    shared = intersections(views.lidar_boxes, views.camera.boxes)
    shared = np.where(nearer & views.in_image[:, None], shared, 0.0).max(axis=0, initial=0.0)
    shares: np.ndarray = shared / np.maximum(areas(views.camera.boxes), 1.0)
    return shares


def cut_boxes(camera: ImageDetections, projection: Projection) -> np.ndarray:
    """(M,) bool, whether a box ends at the left or right edge of the image."""
    right = projection.width - BORDER_PX
    cut: np.ndarray = (camera.boxes[:, 0] < BORDER_PX) | (camera.boxes[:, 2] > right)
    return cut


def lenders(views: Views, agreement: Agreement) -> tuple[np.ndarray, np.ndarray]:
    """(M,) bool whether a cluster covers a camera box's middle at its depth, and (M,) which."""
    boxes = views.camera.boxes
    if not len(views.lidar):
        return np.zeros(len(boxes), bool), np.full(len(boxes), -1)
    middles = (boxes[:, 0] + boxes[:, 2]) / 2
    left, right = views.lidar_boxes[:, None, 0], views.lidar_boxes[:, None, 2]
    covers = (left <= middles) & (middles <= right) & views.in_image[:, None]
    differences = np.where(covers, agreement.depth, np.inf)
    best = differences.argmin(axis=0)
    return differences[best, np.arange(len(boxes))] < LEND_DEPTH, best
