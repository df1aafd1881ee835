"""The objects in an image that a camera detector is to find, and those that do not count."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from roadscope.core import Family, Truth
from roadscope.core.category import families_of
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

LEAST_PIXELS = 40
MOST_OCCLUDED = 0.75
LEAST_HEIGHT_PX = 8.0
"""Limits of what is to be found, chosen by hand; boards name them in their explanation."""
LEAST_CONTRAST = 0.05
"""Share of its contrast that an object keeps at the limit of visibility in rain or fog
(Koschmieder 1924; 0.05 is the threshold of the meteorological optical range)."""
PARKED = -1
"""Category of parked cars, which are scenery."""

FAMILIES = tuple(Family)


@dataclass(frozen=True, slots=True, eq=False)
class ParkedBoxes(Record):
    """Parked cars in an image, which are scenery.

    boxes: (P, 4) float64, pixels, left top right bottom. ranges_m: (P,) float64.
    """

    boxes: np.ndarray
    ranges_m: np.ndarray

    def __len__(self) -> int:
        return len(self.ranges_m)


@dataclass(frozen=True, slots=True, eq=False)
class Labels(Record):
    """All road users and parked cars in one image.

    boxes: (N, 4) float64, left top right bottom, pixels.
    categories: (N,) int64, values of `Category` or `PARKED`.
    pixels: (N,) int64, how many show the object; -1 of parked cars.
    occluded: (N,) float64, share of the object that is hidden.
    ranges_m: (N,) float64, distance of its centre from the ego, seen from above.
    """

    boxes: np.ndarray
    categories: np.ndarray
    pixels: np.ndarray
    occluded: np.ndarray
    ranges_m: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            boxes=(np.float64, ("N", 4)),
            categories=(np.int64, ("N",)),
            pixels=(np.int64, ("N",)),
            occluded=(np.float64, ("N",)),
            ranges_m=(np.float64, ("N",)),
        )

    def __len__(self) -> int:
        return len(self.boxes)

    def in_air(self, extinction_per_m: float) -> Labels:
        """Return the labels with all objects hidden that keep too little contrast in rain or fog.

        An object at range r keeps the share exp(-extinction r) of its contrast (Koschmieder 1924).
        """
        too_faint = np.exp(-extinction_per_m * self.ranges_m) < LEAST_CONTRAST
        return replace(self, occluded=np.where(too_faint, 1.0, self.occluded))

    @staticmethod
    def names() -> list[str]:
        """Return the names of the columns."""
        return [field.name for field in fields(Labels)]

    @property
    def heights_px(self) -> np.ndarray:
        """(N,) heights of the boxes."""
        heights: np.ndarray = self.boxes[:, 3] - self.boxes[:, 1]
        return heights

    @property
    def eligible(self) -> np.ndarray:
        """(N,) bool: road users of which enough is visible; the others do not count."""
        eligible: np.ndarray = (
            (self.categories != PARKED)
            & (self.pixels >= LEAST_PIXELS)
            & (self.occluded <= MOST_OCCLUDED)
            & (self.heights_px >= LEAST_HEIGHT_PX)
        )
        return eligible

    @property
    def families(self) -> np.ndarray:
        """(N,) int64, indices in `FAMILIES`; parked cars are vehicles."""
        return np.where(self.categories == PARKED, 0, families_of(self.categories))


def labels_of(truth: Truth, parked: ParkedBoxes | None = None) -> Labels:
    """Return labels of all road users that are at least partly visible, and of parked cars."""
    if truth.image_boxes is None:
        raise ValueError("the truth is not of an image: it has no boxes in one")
    boxes = truth.image_boxes
    visible = ((boxes[:, 2:] - boxes[:, :2]) > 0).all(axis=1) & (truth.visible_pixels > 0)
    ranges_m = np.hypot(*(truth.centres[:, :2] - truth.world_from_ego.translation[:2]).T)
    if parked is None:
        parked = ParkedBoxes(np.empty((0, 4)), np.empty(0))
    count = len(parked)
    return Labels(
        boxes=np.concatenate([boxes[visible], parked.boxes]),
        categories=np.concatenate(
            [truth.categories[visible].astype(np.int64), np.full(count, PARKED)]
        ),
        pixels=np.concatenate([truth.visible_pixels[visible], np.full(count, -1)]),
        occluded=np.concatenate([truth.occluded_fraction[visible], np.zeros(count)]),
        ranges_m=np.concatenate([ranges_m[visible], parked.ranges_m]),
    )
