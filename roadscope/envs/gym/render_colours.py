"""Colours of what the bird's-eye picture and its legend show."""

from __future__ import annotations

from roadscope.core import Family
from roadscope.envs.gym.canvas import Colour

EGO: Colour = (245, 245, 245)
DETECTION: Colour = (255, 150, 50)
FAMILIES: dict[Family, Colour] = {
    Family.VEHICLE: (76, 190, 255),
    Family.CYCLIST: (255, 110, 220),
    Family.PEDESTRIAN: (255, 225, 80),
}
TRACKS: tuple[Colour, ...] = (
    (255, 99, 99), (255, 186, 73), (240, 240, 90), (140, 230, 100), (80, 225, 190),
    (110, 170, 255), (180, 140, 255), (255, 130, 200),
)  # fmt: skip
TRACK_LINE_PX = 2.0
COASTING_LINE_PX = 0.8


def track_colour(number: int) -> Colour:
    """Return the colour of a track by its id; ids that are a few apart differ."""
    return TRACKS[number % len(TRACKS)]
