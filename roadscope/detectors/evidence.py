"""What a scan says of a box, whoever proposed it: the features that scores are made of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roadscope.core import Category
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.evidence_kernels import (
    CEILING_M,
    COUNTS,
    count_returns,
    look_along,
    sort_to_cells,
)
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.recognition import Vehicle

FEATURES = (
    "log_returns", "log_columns", "levels", "range_m", "passing", "top_m", "bottom_m",
    "deep", "depth_m", "ground", "ends", "sides", "above", "overhang", "log_residual", "fit",
    "length_m", "width_m", "view", "top_level", "top_share", "fill", "small", "weighed",
)  # fmt: skip
"""Names of the columns of `features`."""


def boxes_of(vehicles: Sequence[Vehicle]) -> np.ndarray:
    """Return (B, 5) centre x and y, length, width in metres, yaw in radians."""
    return np.array([(*v.centre, v.size[0], v.size[1], v.yaw) for v in vehicles]).reshape(-1, 5)


def features(
    vehicles: Sequence[Vehicle], cloud: Cloud, horizon: Horizon, height_m: float
) -> np.ndarray:
    """Return (B, F) `FEATURES` of the boxes of vehicles.

    cloud: the whole scan with its ground; height_m: of the sensor above the ground. What is
    counted is compared to what the box itself returned, so that beams and range fall out as far
    as they can; logarithms are natural.
    """
    boxes = boxes_of(vehicles)
    if not len(boxes) or not len(cloud):
        return np.zeros((len(boxes), len(FEATURES)))
    cloud = _without_copies(cloud)
    order = np.argsort(horizon.azimuths, kind="stable")
    azimuths, ranges = horizon.azimuths[order], horizon.ranges[order]
    sight = look_along(boxes, azimuths, ranges, horizon.origin, horizon.step)
    counted = count_returns(boxes, cloud.points, cloud.ring, sort_to_cells(cloud.points))
    count = dict(zip(COUNTS, counted.T, strict=True))
    body = np.maximum(count["body"], 1.0)
    apart = boxes[:, :2] - cloud.origin
    slope = _steepest(cloud, height_m)
    away = np.hypot(apart[:, 0], apart[:, 1])
    bearing = np.arctan2(apart[:, 1], apart[:, 0])
    named = {
        "log_returns": np.log(body),
        "log_columns": np.log1p(sight[:, 3]),
        "levels": count["levels"],
        "range_m": away,
        "passing": sight[:, 2],
        "top_m": count["top"],
        "bottom_m": count["bottom"],
        "deep": count["deep"] / np.maximum(count["low"], 1.0),
        "depth_m": count["depth"],
        "ground": np.log1p(10 * count["ground"] / body),
        "ends": np.log1p(10 * count["ends"] / body),
        "sides": np.log1p(10 * count["sides"] / body),
        "above": np.log1p(10 * count["above"] / body),
        "overhang": np.log1p(10 * count["overhang"] / body),
        "log_residual": np.log([max(v.residual_m, 0.005) for v in vehicles]),
        "fit": np.array([v.fit for v in vehicles]),
        "length_m": boxes[:, 2],
        "width_m": boxes[:, 3],
        "view": np.abs(np.sin(boxes[:, 4] - bearing)),
        "top_level": (count["top_level"] >= int(cloud.ring.max())).astype(float),
        "top_share": count["top"] / np.clip(height_m + slope * away, 0.3, CEILING_M),
        "fill": body / np.maximum(count["levels"] * sight[:, 3], 1.0),
        "small": np.array([v.category >= Category.MOTORCYCLE for v in vehicles], float),
        "weighed": np.array([v.fit != 0 for v in vehicles], float),
    }  # fmt: skip
    return np.column_stack([named[name] for name in FEATURES])


def _steepest(cloud: Cloud, height_m: float) -> float:
    """Slope of the highest beam that returned anything."""
    top = cloud.ring == cloud.ring.max()
    return float(np.median((cloud.points[top, 2] - height_m) / np.maximum(cloud.ranges[top], 0.1)))


def _without_copies(cloud: Cloud) -> Cloud:
    """Keep one of equal returns: clouds are sorted, so copies are neighbours."""
    same = (np.diff(cloud.column) == 0) & (np.diff(cloud.ring) == 0)
    rows = np.flatnonzero(same)
    again = rows[(cloud.points[rows + 1] == cloud.points[rows]).all(axis=1)] + 1
    return cloud.select(np.delete(np.arange(len(cloud)), again)) if len(again) else cloud
