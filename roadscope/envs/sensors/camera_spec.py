"""Specifications of cameras: optics, timing, noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from roadscope.core.checks import require
from roadscope.core.record import Record
from roadscope.envs.imaging.pinhole import Pinhole

METERED_S = 0.004
"""Exposure to which the light's ISO belongs."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraSpec(Record):
    """A colour camera with a global shutter.

    pinhole: size of the image, focal lengths and principal point.
    period_s: time from image to image. exposure_s: time for which the shutter is open: a longer
        one blurs motion more and makes longer streaks of rain. Gain keeps the brightness of
        images the same, so a shorter one means fewer electrons and more noise.
    full_well: electrons that make a pixel white; the root of the count is its shot noise.
    read_noise: standard deviation in electrons of a dark pixel.
    vignetting: share of the light that is lost in the corners.
    motion_blur: whether motion during the exposure blurs the image; it costs a tenth more time.
    plain: whether images show one colour a face, without shadows, textures, weather or noise.
    """

    name: str
    pinhole: Pinhole
    period_s: float
    exposure_s: float = METERED_S
    full_well: float = 9000.0
    read_noise: float = 12.0
    vignetting: float = 0.25
    motion_blur: bool = False
    plain: bool = False

    def __post_init__(self) -> None:
        require(
            0 < self.exposure_s <= self.period_s,
            self,
            "exposure_s",
            "above 0, up to period_s",
            self.exposure_s,
        )
        require(self.full_well > 0, self, "full_well", "a positive number", self.full_well)
        require(self.read_noise >= 0, self, "read_noise", "a number from 0 up", self.read_noise)
        require(0 <= self.vignetting < 1, self, "vignetting", "a share below 1", self.vignetting)


CAMERAS: Mapping[str, CameraSpec] = MappingProxyType(
    {
        "bumblebee-xb3": CameraSpec(
            "bumblebee-xb3", Pinhole.centred(1280, 960, 1600.0), period_s=1 / 16
        ),
        "wide": CameraSpec("wide", Pinhole.centred(640, 480, 420.0), period_s=1 / 20),
    }
)
"""One eye of a Bumblebee XB3 with 6 mm lenses (Sony ICX445: pixels of 3.75 um, 16 images/s), and
a light camera of 75 degrees."""
