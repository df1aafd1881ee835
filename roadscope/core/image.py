"""What one exposure of a camera brings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

DARK = 8
"""Brightest byte of an image that shows nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage(Record):
    """One colour image.

    pixels: (H, W, 3) uint8, RGB.
    intrinsics: (3, 3) float64, pinhole matrix in pixels.
    stamp_s: middle of the exposure, seconds since reset.
    sensor: name of the sensor in its rig.
    """

    pixels: np.ndarray
    intrinsics: np.ndarray
    stamp_s: float
    sensor: str

    def __post_init__(self) -> None:
        settle_arrays(self, pixels=(np.uint8, ("H", "W", 3)), intrinsics=(np.float64, (3, 3)))

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.pixels.shape[1], self.pixels.shape[0]

    @property
    def black(self) -> bool:
        """Whether nothing can be seen: the lens is covered, or no light came in."""
        return int(self.pixels.max(initial=0)) <= DARK
