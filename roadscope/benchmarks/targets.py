"""What a scan and an image together are asked for, decided from truth alone."""

from __future__ import annotations

import numpy as np

from roadscope.benchmarks.metrics.fusion import FARTHEST_M, Targets
from roadscope.benchmarks.noisy_camera import FAMILY
from roadscope.core import Detections, Truth
from roadscope.core.projection import Projection
from roadscope.fusion.overlap import projected_boxes

NEAREST_M = 3.0
LEAST_RETURNS, LEAST_PIXELS, LEAST_HEIGHT_PX = 5, 60, 12.0
MOST_HIDDEN = 0.9


def targets_of(truth: Truth, seen: Truth, parked: np.ndarray, projection: Projection) -> Targets:
    """Join truth of a scan and of its image; (P, 2) parked cars come last, not eligible.

    To be found is who is in the image, 3 to 60 m away, and gave 5 returns or shows 60 pixels, 12
    high, and less than nine tenths hidden.
    """
    assert seen.image_boxes is not None
    rows = {int(k): i for i, k in enumerate(seen.ids)}
    both = np.array([k for k, i in enumerate(truth.ids.tolist()) if i in rows], np.int64)
    other = np.array([rows[int(truth.ids[k])] for k in both], np.int64)
    centres = truth.world_from_ego.inverse().apply(truth.centres[both])
    boxes = seen.image_boxes[other]
    sides = boxes[:, 2:] - boxes[:, :2]
    in_image = (sides > 3.0).all(axis=1)
    in_image &= seen.occluded_fraction[other] < MOST_HIDDEN
    shows = (seen.visible_pixels[other] >= LEAST_PIXELS) & (sides[:, 1] >= LEAST_HEIGHT_PX)
    returns = truth.lidar_returns[both] >= LEAST_RETURNS
    far = np.hypot(centres[:, 0], centres[:, 1])
    eligible = in_image & (shows | returns) & (far >= NEAREST_M) & (far <= FARTHEST_M)
    cars = truth.world_from_ego.inverse().apply(
        np.column_stack([parked, np.full(len(parked), 0.75)])
    )
    n = len(cars)
    car_boxes, _ = projected_boxes(
        Detections(
            cars,
            np.tile((4.4, 1.8, 1.5), (n, 1)),
            np.zeros(n),
            np.zeros(n, np.int8),
            np.ones(n),
            "ego",
            truth.stamp_s,
        ),
        projection,
    )
    return Targets(
        np.concatenate([FAMILY[truth.categories[both]], np.zeros(n, np.int64)]),
        np.concatenate([centres, cars]),
        np.concatenate([boxes, car_boxes]),
        np.concatenate([eligible, np.zeros(n, bool)]),
        np.concatenate([seen.occluded_fraction[other], np.zeros(n)]),
    )
