"""Our own fusion: detections of a pair must agree in bearing, size and depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Category, Detections, ImageDetections
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.fusion.assembly import Views, assemble
from roadscope.fusion.candidates import (
    Agreement,
    Candidates,
    camera_alone_features,
    candidate_features,
    lenders,
    lidar_features,
    places_at,
)
from roadscope.fusion.evidence import camera_masses, combine_or_keep, lidar_masses
from roadscope.fusion.sizes import USUAL_M
from roadscope.fusion.weights import odds_model, ranking_model


class ConsistentFusion:
    """One-to-one pairs, learned scores, a box in space for every target.

    Scores are probabilities, computed from features of the detections and of their agreement with
    weights that were fitted on train seeds. There are separate weights for pairs, for targets that
    one sensor detects and the other misses, and for a sensor when the other has no measurement.
    """

    def reset(self) -> None:
        """Do nothing: a fusion keeps no state."""

    def fuse(
        self, lidar: Detections | None, camera: ImageDetections | None, projection: Projection
    ) -> FusedDetections:
        """Join both sensors' targets."""
        views = Views.of(lidar, camera, projection)
        agreement = Agreement.of(views, projection)
        candidates = Candidates.of(views, agreement)
        if lidar is None:
            odds = ranking_model().values(camera_alone_features(views.camera))[:, 0]
        elif camera is None:
            odds = odds_model("lidar_alone").odds(lidar_features(views))
        else:
            odds = odds_of(views, agreement, projection, candidates)
        rows, columns = candidates.lidar_rows, candidates.camera_rows
        masses, scores = _masses(views, candidates), 1 / (1 + np.exp(-odds))
        fused = assemble(views, rows, columns, masses, scores)
        return with_places(fused, views, agreement, columns, projection)


def odds_of(
    views: Views, agreement: Agreement, projection: Projection, candidates: Candidates
) -> np.ndarray:
    """Return the (P + L + C,) log odds of candidates if both sensors have a measurement."""
    features = candidate_features(views, agreement, projection, candidates)
    names = ("pair", "lidar_only", "camera_only")
    return np.concatenate(
        [odds_model(name).odds(part) for name, part in zip(names, features, strict=True)]
    )


def with_places(
    fused: FusedDetections,
    views: Views,
    agreement: Agreement,
    camera_rows: np.ndarray,
    projection: Projection,
) -> FusedDetections:
    """Return the targets, where those of the camera alone have a box in space, too.

    Its distance is that of a cluster, see `lenders`, or that of the camera box, see `depths_of`.
    Its size is the usual one of its category. Vehicles are assumed to head along the ego's x axis,
    others away from the ego.

    camera_rows: (T,) row of the camera's detection of each target.
    """
    alone = np.flatnonzero(~fused.has_box)
    if not len(alone):
        return fused
    rows = camera_rows[alone]
    boxes = views.camera.boxes[rows]
    middles = (boxes[:, 0] + boxes[:, 2]) / 2
    depths, lidar_rows = np.exp(agreement.log_depths[rows]), np.full(len(rows), -1)
    has_lender, best = (part[rows] for part in lenders(views, agreement))
    cluster_rows = best[has_lender]
    depths[has_lender] = agreement.lidar_depths[cluster_rows]
    lidar_rows[has_lender] = cluster_rows
    sizes = USUAL_M[fused.categories[alone]]
    places = places_at(
        np.column_stack([middles, (boxes[:, 1] + boxes[:, 3]) / 2]), depths, projection
    )
    centres = np.column_stack([places[:, :2], sizes[:, 2] / 2])
    bearings = np.arctan2(places[:, 1], places[:, 0])
    vehicle = fused.categories[alone] < Category.CYCLIST
    return replace(
        fused,
        has_box=_put(fused.has_box, alone, True),
        centres=_put(fused.centres, alone, centres),
        sizes=_put(fused.sizes, alone, sizes),
        yaws=_put(fused.yaws, alone, np.where(vehicle, 0.0, bearings)),
        lidar_rows=_put(fused.lidar_rows, alone, lidar_rows),
        distances_m=_put(fused.distances_m, alone, np.hypot(places[:, 0], places[:, 1])),
    )


def _masses(views: Views, candidates: Candidates) -> np.ndarray:
    """Return the (P + L + C, 4) masses of candidates; those of pairs are combined."""
    of_lidar, of_camera = lidar_masses(views.lidar), camera_masses(views.camera)
    joined = combine_or_keep(of_lidar[candidates.rows], of_camera[candidates.columns])
    alone = of_lidar[candidates.lidar_only], of_camera[candidates.camera_only]
    return np.concatenate([joined, *alone])


def _put(values: np.ndarray, rows: np.ndarray, new: np.ndarray | bool) -> np.ndarray:
    """Return values with new ones in some rows."""
    changed = values.copy()
    changed[rows] = new
    return changed
