"""Categories of road users, and the families that they belong to."""

from __future__ import annotations

from enum import IntEnum, StrEnum

import numpy as np
from numpy.typing import ArrayLike


class Family(StrEnum):
    """Coarse classes in which Li 2021 reports its rates."""

    VEHICLE = "vehicle"
    CYCLIST = "cyclist"
    PEDESTRIAN = "pedestrian"


class Category(IntEnum):
    """Fine classes; records store them as int8."""

    CAR = 0
    VAN = 1
    TRUCK = 2
    BUS = 3
    MOTORCYCLE = 4
    CYCLIST = 5
    PEDESTRIAN = 6

    @property
    def family(self) -> Family:
        """The coarse class."""
        if self is Category.PEDESTRIAN:
            return Family.PEDESTRIAN
        return Family.CYCLIST if self is Category.CYCLIST else Family.VEHICLE


CATEGORY_OF_FAMILY = np.array([Category.CAR, Category.CYCLIST, Category.PEDESTRIAN], np.int8)
"""The category that stands for each family, in their order, where no finer one is known."""
_FAMILIES = np.array([list(Family).index(category.family) for category in Category])


def families_of(categories: ArrayLike) -> np.ndarray:
    """Return (N,) int64 places in `Family` of the families of (N,) categories."""
    families: np.ndarray = _FAMILIES[np.asarray(categories, np.int64)]
    return families
