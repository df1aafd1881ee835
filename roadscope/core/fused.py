"""What fusion says: targets that LiDAR, camera or both found."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.detections import Detections
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class FusedDetections(Record):
    """Targets of one moment.

    categories: (N,) int8, values of `Category`. scores: (N,) float64 in 0 to 1.
    by_lidar, by_camera: (N,) bool, which sensors found the target.
    has_box: (N,) bool, whether centre, size and yaw are known.
    centres, sizes: (N, 3) float64, metres, yaws: (N,) radians, frame `ego`; 0, 1 and 0 where
        unknown.
    distances_m: (N,) float64, from the ego over ground, -1 where unknown.
    numbers: (N,) int64, row of the LiDAR detection the target rests on, -1 without one; several
        targets in a crowd may share one.
    has_image_box: (N,) bool. image_boxes: (N, 4) float64, pixels, left top right bottom; 0
        where unknown.
    masses: (N, K) float64 Dempster-Shafer masses, the last column for ignorance.
    stamp_s: seconds since reset.
    """

    categories: np.ndarray
    scores: np.ndarray
    by_lidar: np.ndarray
    by_camera: np.ndarray
    has_box: np.ndarray
    centres: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    distances_m: np.ndarray
    numbers: np.ndarray
    has_image_box: np.ndarray
    image_boxes: np.ndarray
    masses: np.ndarray
    stamp_s: float

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            categories=(np.int8, ("N",)),
            scores=(np.float64, ("N",)),
            by_lidar=(np.bool_, ("N",)),
            by_camera=(np.bool_, ("N",)),
            has_box=(np.bool_, ("N",)),
            centres=(np.float64, ("N", 3)),
            sizes=(np.float64, ("N", 3)),
            yaws=(np.float64, ("N",)),
            distances_m=(np.float64, ("N",)),
            numbers=(np.int64, ("N",)),
            has_image_box=(np.bool_, ("N",)),
            image_boxes=(np.float64, ("N", 4)),
            masses=(np.float64, ("N", "K")),
        )
        proper = (self.scores >= 0) & (self.scores <= 1)
        require(bool(proper.all()), self, "scores", "values in 0 to 1", self.scores[~proper][:1])
        found = self.by_lidar | self.by_camera
        require(bool(found.all()), self, "by_lidar", "a sensor for every target", "none")

    def __len__(self) -> int:
        return len(self.scores)

    def select(self, index: np.ndarray) -> FusedDetections:
        """Keep the rows that a mask or an index array names."""
        names = [name for name in FusedDetections.__slots__ if name != "stamp_s"]
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def detections(self) -> Detections:
        """Return the targets with a box in space, as a tracker takes them."""
        kept = self.select(self.has_box)
        return Detections(
            kept.centres, kept.sizes, kept.yaws, kept.categories, kept.scores, "ego", kept.stamp_s
        )
