"""Categories of road users, and the families that they belong to."""

from __future__ import annotations

from enum import IntEnum, StrEnum


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
