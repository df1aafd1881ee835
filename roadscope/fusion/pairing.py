"""The image that belongs to a scan, and the ego's motion between both (Li 2021, 2.1)."""

from __future__ import annotations

import numpy as np

from roadscope.core import Pose, RecordError
from roadscope.core.projection import Projection

LIMIT_S = 0.05
"""Half the period of a camera of 10 images/s: with a gap above this an image is missing."""
LONGEST_S = 1.0
"""Greatest time between a scan and an image that are fused: then the scene has changed. Chosen by
hand."""
ALONE = -1
"""In place of the row of an image: no image belongs to the scan."""


class ClocksApartError(RecordError):
    """No scan and image were measured at about the same time: their clocks differ."""


def nearest_images(
    scan_stamps_s: np.ndarray, image_stamps_s: np.ndarray, *, limit_s: float = LIMIT_S
) -> np.ndarray:
    """Return for each scan the row (S,) of the image nearest in time, `ALONE` beyond the limit.

    scan_stamps_s, image_stamps_s: (S,) and (I,) seconds of one clock, in any order; of two images
        equally near the earlier row is taken.
    limit_s: greatest time between a scan and its image.

    If there are scans and images but no scan has an image, the clocks differ, and
    `ClocksApartError` states the shortest time between a scan and an image.
    """
    scans, images = _stamps("scan", scan_stamps_s), _stamps("image", image_stamps_s)
    if not 0 < limit_s < np.inf:
        raise ValueError(f"limit_s must be a positive time in seconds, got {limit_s!r}")
    if not len(images) or not len(scans):
        return np.full(len(scans), ALONE)
    gaps = np.abs(scans[:, None] - images[None])
    rows = gaps.argmin(axis=1)
    least = gaps[np.arange(len(scans)), rows]
    if least.min() > limit_s:
        raise ClocksApartError(
            f"no scan has an image within {limit_s:g} s; the nearest two are {least.min():g} s "
            "apart: do both clocks count from the same moment?"
        )
    return np.where(least <= limit_s, rows, ALONE)


def check_moment(scan_stamp_s: float, image_stamp_s: float) -> None:
    """Raise `ClocksApartError` if scan and image were not measured at about the same time."""
    if not abs(image_stamp_s - scan_stamp_s) <= LONGEST_S:
        raise ClocksApartError(
            f"the scan is stamped {scan_stamp_s:g} s, the image {image_stamp_s:g} s: at most "
            f"{LONGEST_S:g} s may be between them"
        )


def moved_projection(
    projection: Projection, previous_from_ego: Pose | None, period_s: float, gap_s: float
) -> Projection:
    """Return the projection from the ego frame at a scan's stamp to an image `gap_s` later.

    projection: from the ego frame at the image's stamp.
    previous_from_ego: the ego's motion in the `period_s` before the scan, which is assumed to
        continue; None if it is unknown: then the projection is returned unchanged.
    gap_s: seconds, negative for an image before the scan.
    """
    if previous_from_ego is None or gap_s == 0.0:
        return projection
    if not 0 < period_s < np.inf:
        raise ValueError(f"period_s must be a positive time in seconds, got {period_s!r}")
    scan_from_image = Pose.identity().interpolate(previous_from_ego, gap_s / period_s)
    image_from_scan = scan_from_image.inverse().matrix
    return Projection(projection.matrix @ image_from_scan, projection.width, projection.height)


def _stamps(name: str, stamps_s: np.ndarray) -> np.ndarray:
    stamps = np.asarray(stamps_s, np.float64)
    if stamps.ndim != 1 or not np.isfinite(stamps).all():
        raise RecordError(f"{name} stamps: expected finite seconds, (N,), got {stamps_s!r}")
    return stamps
