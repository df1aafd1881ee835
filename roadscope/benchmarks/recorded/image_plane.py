"""Boxes in the image as boxes over a plane, for trackers that follow boxes in space.

Of an image sequence nobody knows where boxes are in space. They are laid flat, up in the image is
ahead, so overlaps seen from above and in space are those in the image, and who stands lower in the
image is nearer and hides who stands behind. Pixels become metres by one factor for a sequence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.core import Category, Detections, Family, ImageDetections, Tracks

PERSON_M = 1.7
"""Usual height of a person."""
NEAREST_M = 10.0
"""Where the lower edge of the image lies: as near as whole people are seen."""
PEOPLE = [category for category in Category if category.family is Family.PEDESTRIAN]


@dataclass(frozen=True, slots=True)
class ImagePlane:
    """Where pixels lie on the plane.

    scale_m: metres per pixel. foot: pixel row of the lower edge. middle: pixel column ahead.
    """

    scale_m: float
    foot: float
    middle: float

    @staticmethod
    def of(frames: Sequence[ImageDetections], image_size: tuple[int, int] | None) -> ImagePlane:
        """Take the first frame that shows anybody, as one who tracks online can.

        Half of those in it are taken to be higher than `PERSON_M`, half lower.
        """
        first = next((f.boxes for f in frames if len(f)), np.array([[0.0, 0.0, 1.0, 1.0]]))
        height = float(np.median(first[:, 3] - first[:, 1]))
        width_px, height_px = image_size or (2 * first[:, [0, 2]].mean(), first[:, 3].max())
        return ImagePlane(PERSON_M / height, float(height_px), float(width_px) / 2)

    def laid_flat(self, detections: ImageDetections) -> Detections:
        """Return people in an image as boxes on the plane, frame `ego`."""
        people = np.flatnonzero(np.isin(detections.categories, PEOPLE))
        boxes, n = detections.boxes[people], len(people)
        ahead = NEAREST_M + self.scale_m * (self.foot - (boxes[:, 1] + boxes[:, 3]) / 2)
        aside = self.scale_m * (self.middle - (boxes[:, 0] + boxes[:, 2]) / 2)
        sizes = self.scale_m * np.column_stack(
            [boxes[:, 3] - boxes[:, 1], boxes[:, 2] - boxes[:, 0]]
        )
        centres = np.column_stack([ahead, aside, np.full(n, PERSON_M / 2)])
        sizes = np.column_stack([sizes, np.full(n, PERSON_M)])
        categories, scores = detections.categories[people], detections.scores[people]
        return Detections(
            centres, sizes, np.zeros(n), categories, scores, "ego", detections.stamp_s
        )

    def boxes(self, tracks: Tracks) -> np.ndarray:
        """Return (N, 4) left top right bottom, pixels, of tracks on the plane."""
        middle = self.middle - tracks.centres[:, 1] / self.scale_m
        level = self.foot - (tracks.centres[:, 0] - NEAREST_M) / self.scale_m
        half = tracks.sizes[:, :2] / self.scale_m / 2
        return np.column_stack(
            [middle - half[:, 1], level - half[:, 0], middle + half[:, 1], level + half[:, 0]]
        )
