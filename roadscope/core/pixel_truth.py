"""The truth for every pixel of an image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

SKY = -(2**31)
"""Instance of a pixel that shows nothing but the sky."""
GROUND_CLASS, SCENERY_CLASS, SKY_CLASS = -1, -2, -3
"""Categories of pixels that show no road user."""


@dataclass(frozen=True, slots=True, eq=False)
class PixelTruth(Record):
    """Depth, instance and category of every pixel, at the middle of the exposure.

    They are those of the first surface on the ray through the middle of the pixel, without motion
    blur. Bodies, ground and scenery are surfaces, foliage as far as it is drawn solid; fog, rain
    and the light of lamps are not.

    depth: (H, W) float32, metres along the optical axis, 0 in the sky.
    instances: (H, W) int64, ids as in `Truth.ids`, `GROUND`, `SKY`, or -2 and below for
        scenery, parked vehicles included. The number of a piece of scenery may be another one in
        another image.
    categories: (H, W) int8, values of `Category`, or `GROUND_CLASS`, `SCENERY_CLASS`,
        `SKY_CLASS`.
    stamp_s: middle of the exposure, seconds since reset, whatever the image's own stamp says.
    """

    depth: np.ndarray
    instances: np.ndarray
    categories: np.ndarray
    stamp_s: float

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            depth=(np.float32, ("H", "W")),
            instances=(np.int64, ("H", "W")),
            categories=(np.int8, ("H", "W")),
        )
