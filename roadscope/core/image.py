"""Camera images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

DARK = 8
"""Brightest value (of 255) in a black image. A white image may be darker than 255 by as much, and
the blocks of an evenly dark image may differ by as much besides noise."""
DIM = 64
"""Greatest mean (of 255) of an image behind a covered lens, whose noise the camera amplifies."""
BLOCK = 16
"""Side of the blocks over which noise is averaged, pixels."""
NOISE_SIGMAS = 8.0
"""Noise alone may make the means of blocks differ by so many of their standard deviations."""


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
    def blank(self) -> bool:
        """Whether nothing can be seen: the lens is covered or blinded, or no light came in.

        An image is blank where it is all black or all white, or dark and even but for noise.
        """
        if self.pixels.max(initial=0) <= DARK or self.pixels.min(initial=255) >= 255 - DARK:
            return True
        green = self.pixels[..., 1]
        # One pixel in sixteen is enough to tell that nearly any image is not blank.
        return _evenly_dark(green[::4, ::4], BLOCK // 4) and _evenly_dark(green, BLOCK)


def _evenly_dark(values: np.ndarray, side: int) -> bool:
    """Return whether an (H, W) channel is dark, and its blocks differ by no more than noise.

    side: side of a block, pixels.
    """
    rows, columns = (length - length % side for length in values.shape)
    if values.mean() > DIM or not rows or not columns:
        return False
    shape = rows // side, side, columns // side, side
    blocks = values[:rows, :columns].astype(np.float32).reshape(shape)
    noise = np.median(blocks.std(axis=(1, 3))) / side
    return bool(np.ptp(blocks.mean(axis=(1, 3))) <= DARK + NOISE_SIGMAS * noise)
