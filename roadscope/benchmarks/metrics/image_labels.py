"""What is to be found in a picture, and what is neither right nor wrong to find."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from roadscope.core import Category, Family, Truth
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

LEAST_PIXELS = 40
MOST_OCCLUDED = 0.75
LEAST_HEIGHT_PX = 8.0
LEAST_CONTRAST = 0.05
"""Share of the contrast to the air behind it that something must keep (Koschmieder)."""
PARKED = -1
"""Category of parked cars, which are scenery."""

FAMILIES = tuple(Family)
FAMILY_OF = np.array([FAMILIES.index(c.family) for c in Category])
"""By category, the place of its family among `FAMILIES`."""


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
    """Everything in one picture that could be taken for a road user.

    boxes: (N, 4) float64, left top right bottom, pixels.
    categories: (N,) int64, values of `Category` or `PARKED`.
    pixels: (N,) int64, how many show it; -1 of parked cars. occluded: (N,) float64, share hidden.
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
        """Return the labels with all hidden that rain or fog leaves too little contrast."""
        faint = np.exp(-extinction_per_m * self.ranges_m) < LEAST_CONTRAST
        return replace(self, occluded=np.where(faint, 1.0, self.occluded))

    @staticmethod
    def names() -> list[str]:
        """Names of the columns."""
        return [field.name for field in fields(Labels)]

    @property
    def heights_px(self) -> np.ndarray:
        """(N,) heights of the boxes."""
        heights: np.ndarray = self.boxes[:, 3] - self.boxes[:, 1]
        return heights

    @property
    def asked(self) -> np.ndarray:
        """(N,) bool: road users of whom enough is seen to be found."""
        asked: np.ndarray = (
            (self.categories != PARKED)
            & (self.pixels >= LEAST_PIXELS)
            & (self.occluded <= MOST_OCCLUDED)
            & (self.heights_px >= LEAST_HEIGHT_PX)
        )
        return asked

    @property
    def families(self) -> np.ndarray:
        """(N,) int64, places among `FAMILIES`; parked cars are vehicles."""
        return np.where(self.categories == PARKED, 0, FAMILY_OF[self.categories])


def labels_of(truth: Truth, parked: ParkedBoxes | None = None) -> Labels:
    """Return labels of all road users that are at least partly visible, and of parked cars."""
    if truth.image_boxes is None:
        raise ValueError("the truth is not of an image: it has no boxes in one")
    boxes = truth.image_boxes
    inside = ((boxes[:, 2:] - boxes[:, :2]) > 0).all(axis=1) & (truth.visible_pixels > 0)
    away = np.hypot(*(truth.centres[:, :2] - truth.world_from_ego.translation[:2]).T)
    if parked is None:
        parked = ParkedBoxes(np.empty((0, 4)), np.empty(0))
    none = np.ones(len(parked), np.int64)
    return Labels(
        np.concatenate([boxes[inside], parked.boxes]),
        np.concatenate([truth.categories[inside].astype(np.int64), PARKED * none]),
        np.concatenate([truth.visible_pixels[inside], -none]),
        np.concatenate([truth.occluded_fraction[inside], np.zeros(len(parked))]),
        np.concatenate([away[inside], parked.ranges_m]),
    )
