"""What LeGO-LOAM keeps of a scan: its ground, and objects that are not small."""

from __future__ import annotations

import numpy as np

from roadscope.core import LidarScan
from roadscope.odometry.lego.range_image import ground_of, objects_of, range_image
from roadscope.odometry.loam.features import Features, Limits, extract
from roadscope.odometry.loam.returns import Returns

BOUNDS_M = (1.0, 120.0)
LEAST = 30
"""Objects of fewer returns, leaves and the like, come back no better in the next scan."""
GROUND, OBJECT = 0, 1
"""Labels: features are matched with such of their own kind."""
LIMITS = Limits(sharp=2, edges=40, flat=4, planes=80, edge_above=5e-3, plane_below=5e-3, thin_m=0.0)
"""Of each sixth of a ring, as published. Reading: the roughness' bound is printed as 0.1, by the
formula beside it a tenth of the range: more than any edge has that hides nothing."""


def kept_of(scan: LidarScan, *, least: int = LEAST) -> Returns:
    """Segment a scan in its range image and keep ground and objects of so many returns."""
    image = range_image(scan.points, scan.ring, scan.column, BOUNDS_M)
    ground = ground_of(image)
    rows = np.flatnonzero(ground | (objects_of(image, ground, least) >= 0))
    return Returns(
        scan.points[rows].astype(float), scan.ring[rows].astype(np.int64),
        scan.column[rows].astype(np.int64), scan.time_offset_s[rows].astype(float), rows,
        np.where(ground[rows], GROUND, OBJECT),
    )  # fmt: skip


def features_of(kept: Returns, points: np.ndarray) -> Features:
    """Return edges, of objects only, and planes; those that are matched are of the ground.

    points: (N, 3) metres, as seen at the scan's stamp.
    """
    ground = kept.labels == GROUND
    return extract(
        points, kept.ring, kept.column, kept.labels, limits=LIMITS, edge_rows=~ground,
        flat_rows=ground,
    )  # fmt: skip
