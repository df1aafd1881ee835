"""Detections: boxes in space from a LiDAR, boxes in an image from a camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core.checks import (
    check_categories,
    check_image_boxes,
    check_scores,
    check_sizes,
    require,
    settle_arrays,
)
from roadscope.core.pose import Pose, wrap_angle
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class Detections(Record):
    """Boxes that a detector reports for one frame.

    centres: (N, 3) float64, metres, box centres.
    sizes: (N, 3) float64, metres, length width height, all positive.
    yaws: (N,) float64, radians, heading of the length axis.
    categories: (N,) int8, values of `Category`.
    scores: (N,) float64 in 0 to 1.
    frame: the coordinate frame of centres and yaws, `ego` or `world`.
    stamp_s: seconds since reset.
    masses: (N, K) float64 Dempster-Shafer masses, the last column for ignorance, or None.
    """

    centres: np.ndarray
    sizes: np.ndarray
    yaws: np.ndarray
    categories: np.ndarray
    scores: np.ndarray
    frame: str
    stamp_s: float
    masses: np.ndarray | None = None

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            centres=(np.float64, ("N", 3)),
            sizes=(np.float64, ("N", 3)),
            yaws=(np.float64, ("N",)),
            categories=(np.int8, ("N",)),
            scores=(np.float64, ("N",)),
            **({} if self.masses is None else {"masses": (np.float64, ("N", "K"))}),
        )
        check_boxes(self, self.sizes, self.categories, self.scores)

    def __len__(self) -> int:
        return len(self.centres)

    @staticmethod
    def empty(stamp_s: float, frame: str = "ego") -> Detections:
        """Return a record without detections."""
        return Detections(
            np.empty((0, 3)),
            np.empty((0, 3)),
            np.empty(0),
            np.empty(0, np.int8),
            np.empty(0),
            frame,
            stamp_s,
        )

    def select(self, index: np.ndarray) -> Detections:
        """Return the rows that a mask or an index array selects."""
        centres = self.centres[index]
        require(centres.ndim == 2, self, "select", "a mask or an index array", index)
        return self._trusted(
            centres=centres,
            sizes=self.sizes[index],
            yaws=self.yaws[index],
            categories=self.categories[index],
            scores=self.scores[index],
            masses=None if self.masses is None else self.masses[index],
        )

    def moved(self, a_from_b: Pose, frame: str) -> Detections:
        """Map the boxes from frame b into frame a; `frame` is the name of frame a."""
        return self._trusted(
            centres=a_from_b.apply(self.centres),
            yaws=wrap_angle(self.yaws + a_from_b.yaw),
            frame=frame,
        )


@dataclass(frozen=True, slots=True, eq=False)
class ImageDetections(Record):
    """Boxes that a detector reports for one image.

    boxes: (N, 4) float64, pixels: left, top, right, bottom; right >= left and bottom >= top.
    categories: (N,) int8, values of `Category`.
    scores: (N,) float64 in 0 to 1.
    stamp_s: seconds since reset.
    masses: (N, K) float64 Dempster-Shafer masses, the last column for ignorance, or None.
    size_px: width and height of the image, None if the detector does not report them.
    """

    boxes: np.ndarray
    categories: np.ndarray
    scores: np.ndarray
    stamp_s: float
    masses: np.ndarray | None = None
    size_px: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            boxes=(np.float64, ("N", 4)),
            categories=(np.int8, ("N",)),
            scores=(np.float64, ("N",)),
            **({} if self.masses is None else {"masses": (np.float64, ("N", "K"))}),
        )
        check_image_boxes(self, "boxes", self.boxes)
        check_categories(self, "categories", self.categories)
        check_scores(self, "scores", self.scores)

    def __len__(self) -> int:
        return len(self.boxes)

    @staticmethod
    def empty(stamp_s: float) -> ImageDetections:
        """Return a record without detections."""
        return ImageDetections(np.empty((0, 4)), np.empty(0, np.int8), np.empty(0), stamp_s)

    def select(self, index: np.ndarray) -> ImageDetections:
        """Return the rows that a mask or an index array selects."""
        boxes = self.boxes[index]
        require(boxes.ndim == 2, self, "select", "a mask or an index array", index)
        return replace(
            self,
            boxes=boxes,
            categories=self.categories[index],
            scores=self.scores[index],
            masses=None if self.masses is None else self.masses[index],
        )


def check_boxes(
    record: Record, sizes: np.ndarray, categories: np.ndarray, scores: np.ndarray
) -> None:
    """Raise `RecordError` for sizes of 0 or less, unknown categories, and scores outside 0 to 1."""
    check_sizes(record, "sizes", sizes)
    check_categories(record, "categories", categories)
    check_scores(record, "scores", scores)
