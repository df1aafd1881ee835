"""What speaks for a target: features of pairs, and of what one sensor alone found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import ImageDetections
from roadscope.core.projection import Projection
from roadscope.fusion.assembly import Views
from roadscope.fusion.depth import BORDER_PX
from roadscope.fusion.masses import camera_features, families_of, log_odds
from roadscope.fusion.matched_views import Agreement
from roadscope.fusion.matching import leftovers
from roadscope.fusion.overlap import areas, intersections, ious
from roadscope.fusion.weights import ranking_model

LEND_DEPTH = 4.0
"""A camera box without a partner takes the distance of a cluster that covers its middle when
their depths agree to two standard deviations: of a crowd that is one cluster."""
NEARER = 0.85
"""A cluster at less than this share of a camera box's distance may hide what that shows."""
WORST = 40.0
"""Costs of pairs are bounded here: they agree in nothing."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """Who may be a target: (P,) rows and columns of pairs, (L,) and (C,) rows of the others."""

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

    Beside those of each sensor, and how sure the camera alone would be: how well pairs agree, in
    all and in depth; how far away a camera's box is, whether it is cut, how much of it nearer
    clusters cover; how much of a cluster lies in a camera's box (it may be a part of what that
    shows), how large it is there and in space; and how well the best other one agrees with what
    has no partner.
    """
    of_lidar, of_camera = lidar_features(views), camera_alone_features(views.camera)
    rows, columns = candidates.rows, candidates.columns
    cost = np.minimum(agreement.cost, WORST) / 10.0
    far = agreement.log_depths - np.log(20.0)
    image, extent = in_image(views)
    covered, cut = covered_shares(views, agreement), cut_boxes(views.camera, projection)
    alone = ranking_model().values(of_camera)[:, 0]
    pairs = np.column_stack(
        [
            of_lidar[rows], of_camera[columns], cost[rows, columns],
            agreement.depth[rows, columns] / 10.0, far[columns], image[rows], extent[rows],
            covered[columns], cut[columns], alone[columns],
        ]
    )  # fmt: skip
    shared = intersections(views.lidar_boxes, views.camera.boxes).max(axis=1, initial=0.0)
    part = shared / np.maximum(areas(views.lidar_boxes), 1.0)
    best = cost.min(axis=1, initial=WORST / 10.0)
    lidar_only = np.column_stack([of_lidar, part, image, extent, best])
    nearest = cost.min(axis=0, initial=WORST / 10.0)
    lent = lenders(views, agreement)[0]
    camera_only = np.column_stack([of_camera, far, lent, covered, cut, nearest, alone])
    return pairs, lidar_only[candidates.lidar_only], camera_only[candidates.camera_only]


def lidar_features(views: Views) -> np.ndarray:
    """(N, 4): log odds of the score, log of range over 20 m, which family."""
    ranges = np.hypot(views.lidar.centres[:, 0], views.lidar.centres[:, 1])
    family = families_of(views.lidar.categories)
    return np.column_stack(
        [
            log_odds(views.lidar.scores), np.log(np.maximum(ranges, 1.0) / 20.0),
            family == 1, family == 2,
        ]
    )  # fmt: skip


def camera_alone_features(camera: ImageDetections) -> np.ndarray:
    """(M, 5): those of its masses, and the greatest overlap with a box that is surer."""
    surer = camera.scores[None] > camera.scores[:, None]
    overlap = np.where(surer, ious(camera.boxes, camera.boxes), 0.0).max(axis=1, initial=0.0)
    return np.column_stack([camera_features(camera), overlap])


def in_image(views: Views) -> tuple[np.ndarray, np.ndarray]:
    """(N,) log of a cluster's height in pixels over 40, and log of its greatest extent, metres."""
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
    apart = np.where(covers, agreement.depth, np.inf)
    best = apart.argmin(axis=0)
    return apart[best, np.arange(len(boxes))] < LEND_DEPTH, best
