"""What detectors say."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core.category import Category
from roadscope.core.checks import require, settle_arrays
from roadscope.core.pose import Pose, wrap_angle
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class Detections(Record):
    """Boxes found in one frame.

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
        """Return detections of nothing."""
        return Detections(
            np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0, np.int8), np.empty(0),
            frame, stamp_s,
        )  # fmt: skip

    def select(self, index: np.ndarray) -> Detections:
        """Keep the rows that a mask or an index array names."""
        centres = self.centres[index]
        require(centres.ndim == 2, self, "select", "a mask or an index array", index)
        return self._trusted(
            centres=centres, sizes=self.sizes[index], yaws=self.yaws[index],
            categories=self.categories[index], scores=self.scores[index],
            masses=None if self.masses is None else self.masses[index],
        )  # fmt: skip

    def moved(self, a_from_b: Pose, frame: str) -> Detections:
        """Express boxes of frame b in frame a, named `frame`."""
        return self._trusted(
            centres=a_from_b.apply(self.centres),
            yaws=wrap_angle(self.yaws + a_from_b.yaw),
            frame=frame,
        )


@dataclass(frozen=True, slots=True, eq=False)
class ImageDetections(Record):
    """Boxes found in one image.

    boxes: (N, 4) float64, pixels, left top right bottom.
    categories: (N,) int8, values of `Category`.
    scores: (N,) float64 in 0 to 1.
    stamp_s: seconds since reset.
    masses: (N, K) float64 Dempster-Shafer masses, the last column for ignorance, or None.
    size_px: width and height of the image, None where they are not known.
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

    def __len__(self) -> int:
        return len(self.boxes)

    def select(self, index: np.ndarray) -> ImageDetections:
        """Keep the rows that a mask or an index array names."""
        boxes = self.boxes[index]
        require(boxes.ndim == 2, self, "select", "a mask or an index array", index)
        return replace(
            self, boxes=boxes, categories=self.categories[index], scores=self.scores[index],
            masses=None if self.masses is None else self.masses[index],
        )  # fmt: skip


def check_boxes(
    record: Record, sizes: np.ndarray, categories: np.ndarray, scores: np.ndarray
) -> None:
    """Refuse boxes without extent, categories that do not exist and scores beyond 0 to 1."""
    positive = (sizes > 0).all(axis=1)
    require(
        bool(positive.all()), record, "sizes", "positive lengths", sizes[~positive][:1].tolist()
    )
    known = (categories >= 0) & (categories < len(Category))
    require(
        bool(known.all()), record, "categories", f"values of Category, 0 to {len(Category) - 1}",
        categories[~known][:1].tolist(),
    )  # fmt: skip
    proper = (scores >= 0) & (scores <= 1)
    require(bool(proper.all()), record, "scores", "values in 0 to 1", scores[~proper][:1].tolist())
