"""Fusion of our own: targets must agree in bearing, size and depth before evidence is joined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Category, Detections, ImageDetections
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.fusion.assembly import Views, assemble
from roadscope.fusion.depth import places_at
from roadscope.fusion.evidence import combine_or_keep
from roadscope.fusion.masses import (
    camera_features,
    camera_masses,
    families_of,
    lidar_masses,
    log_odds,
)
from roadscope.fusion.matched_views import Agreement
from roadscope.fusion.matching import leftovers
from roadscope.fusion.overlap import areas, intersections
from roadscope.fusion.sizes import USUAL_M
from roadscope.fusion.weights import odds_model

LEND_DEPTH = 4.0
"""A camera box without a partner takes the distance of a cluster that covers its middle when
their depths agree to two standard deviations: of a crowd that is one cluster."""


class ConsistentFusion:
    """One-to-one matches, learned scores, a box in space for every target.

    Scores are chances: log odds of both sensors, range and size in the image, weighed as fitted
    on train seeds, with weights of their own for pairs, for what one sensor alone found although
    the other looked there, and for a sensor that works alone.
    """

    def reset(self) -> None:
        """Forget nothing: every moment stands alone."""

    def fuse(
        self, lidar: Detections | None, camera: ImageDetections | None, projection: Projection
    ) -> FusedDetections:
        """Join both sensors' targets."""
        views = Views.of(lidar, camera, projection)
        agreement = Agreement.of(views, projection)
        rows, columns = agreement.pairs()
        single = leftovers(len(views.lidar), rows), leftovers(len(views.camera), columns)
        masses = _masses(views, rows, columns, single)
        features = candidate_features(views, agreement, rows, columns, single)
        names = kinds_of(lidar is None, camera is None)
        odds = [odds_of(name, part) for name, part in zip(names, features, strict=True)]
        lidar_rows = np.concatenate([rows, single[0], np.full(len(single[1]), -1)])
        camera_rows = np.concatenate([columns, np.full(len(single[0]), -1), single[1]])
        scores = 1 / (1 + np.exp(-np.concatenate(odds)))
        fused = assemble(views, lidar_rows, camera_rows, masses, scores)
        return with_places(fused, views, agreement, (camera_rows, projection))


def odds_of(name: str, features: np.ndarray) -> np.ndarray:
    """(N,) log odds; a sensor that works alone has the first few features only."""
    model = odds_model(name)
    return model.odds(features[:, : model.size])


def kinds_of(no_lidar: bool, no_camera: bool) -> tuple[str, str, str]:
    """Names of the models for pairs, for LiDAR's alone and for the camera's alone."""
    return (
        "pair",
        "lidar_alone" if no_camera else "lidar_only",
        "camera_alone" if no_lidar else "camera_only",
    )


def candidate_features(
    views: Views, agreement: Agreement, rows: np.ndarray, columns: np.ndarray,
    single: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Features of pairs, (P, 10), of LiDAR's alone, (L, 5), of the camera's alone, (C, 6).

    Beside those of each sensor: how well pairs agree, how much of a cluster lies in a camera's
    box (it may be a part of what that shows), how far away a camera's box is, and whether a
    cluster at its depth covers it.
    """
    of_lidar, of_camera = lidar_features(views), camera_features(views.camera)
    cost = agreement.cost[rows, columns] / 10.0
    far = agreement.log_depths - np.log(20.0)
    pairs = np.column_stack([of_lidar[rows], of_camera[columns], cost, far[columns]])
    shared = intersections(views.lidar_boxes, views.camera.boxes).max(axis=1, initial=0.0)
    part = shared / np.maximum(areas(views.lidar_boxes), 1.0)
    lent = lenders(views, agreement)[0]
    return (
        pairs,
        np.column_stack([of_lidar, part])[single[0]],
        np.column_stack([of_camera, far, lent])[single[1]],
    )


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


def with_places(
    fused: FusedDetections, views: Views, agreement: Agreement,
    seen: tuple[np.ndarray, Projection],
) -> FusedDetections:  # fmt: skip
    """Give targets of the camera alone a place and a size, from a cluster or from the image."""
    camera_rows, projection = seen
    alone = np.flatnonzero(~fused.has_box)
    if not len(alone):
        return fused
    rows = camera_rows[alone]
    boxes = views.camera.boxes[rows]
    middles = (boxes[:, 0] + boxes[:, 2]) / 2
    depths, numbers = np.exp(agreement.log_depths[rows]), np.full(len(rows), -1)
    lent, best = (part[rows] for part in lenders(views, agreement))
    depths[lent], numbers[lent] = agreement.lidar_depths[best[lent]], best[lent]
    sizes = USUAL_M[fused.categories[alone]]
    places = places_at(
        np.column_stack([middles, (boxes[:, 1] + boxes[:, 3]) / 2]), depths, projection
    )
    centres = np.column_stack([places[:, :2], sizes[:, 2] / 2])
    away = np.arctan2(places[:, 1], places[:, 0])
    vehicle = fused.categories[alone] < Category.CYCLIST
    return replace(
        fused,
        has_box=_put(fused.has_box, alone, True),
        centres=_put(fused.centres, alone, centres),
        sizes=_put(fused.sizes, alone, sizes),
        yaws=_put(fused.yaws, alone, np.where(vehicle, 0.0, away)),
        numbers=_put(fused.numbers, alone, numbers),
        distances_m=_put(fused.distances_m, alone, np.hypot(places[:, 0], places[:, 1])),
    )


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


def _masses(
    views: Views, rows: np.ndarray, columns: np.ndarray, single: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    of_lidar, of_camera = lidar_masses(views.lidar), camera_masses(views.camera)
    joined = combine_or_keep(of_lidar[rows], of_camera[columns])
    return np.concatenate([joined, of_lidar[single[0]], of_camera[single[1]]])


def _put(values: np.ndarray, rows: np.ndarray, new: np.ndarray | bool) -> np.ndarray:
    changed = values.copy()
    changed[rows] = new
    return changed
