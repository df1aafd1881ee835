"""The colours of all pictures, figures and pages: one colour, one meaning.

Readers with any common colour blindness can tell them apart (Okabe and Ito 2008, some colours
lightened for dark ground). White is what is true, warm colours are what a detector reports, cool
colours are tracks; greys and dull blues are measurements and the road.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from roadscope.core.category import Family

Rgb = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

# --------------------------------------------------------------------------------------------------
# On dark ground: frames of videos, bird's-eye views and camera images.

TRUTH_COLOUR: Rgb = (245, 245, 245)
HIDDEN_COLOUR: Rgb = (112, 116, 122)
"""True boxes, the ego and its true path; true boxes without any return."""
DETECTION_COLOURS: Mapping[Family, Rgb] = MappingProxyType(
    {Family.VEHICLE: (230, 159, 0), Family.CYCLIST: (213, 94, 0), Family.PEDESTRIAN: (240, 228, 66)}
)
TRACK_COLOURS: tuple[Rgb, ...] = ((86, 180, 233), (0, 178, 126), (150, 110, 255), (183, 236, 125))
"""In turn by id, as `track_colour` says."""
ODOMETRY_COLOUR: Rgb = (235, 85, 160)
GROUND_COLOUR: Rgb = (16, 19, 24)
PANEL_COLOUR: Rgb = (27, 31, 38)
ASPHALT_COLOUR: Rgb = (44, 49, 57)
VERGE_COLOUR: Rgb = (31, 35, 42)
PAVEMENT_COLOUR: Rgb = (35, 36, 45)
MARKING_COLOUR: Rgb = (92, 99, 110)
RING_COLOUR: Rgb = (52, 59, 70)
LABEL_COLOUR: Rgb = (196, 203, 212)
RETURN_COLOURS: Mapping[str, Rgb] = MappingProxyType(
    {
        "ground": (70, 78, 92),
        "scenery": (112, 124, 138),
        "rain, fog": (104, 84, 112),
        "road user": (206, 220, 232),
    }
)
"""By what a return came from."""
COLOUR_SCALE: tuple[Rgb, ...] = ((38, 52, 84), (62, 96, 140), (112, 150, 182), (198, 220, 234))
"""Of measured values, low to high: intensities, ranges, heights."""


def hex_colour(colour: Rgb) -> str:
    """Return a colour as figures and pages write it, such as `#56b4e9`."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def track_colour(number: int) -> Rgb:
    """Return the colour of a track by its id; ids that are a few apart differ."""
    return TRACK_COLOURS[number % len(TRACK_COLOURS)]


# --------------------------------------------------------------------------------------------------
# On white paper: figures of papers, curves of boards.

PAPER_TRUTH, PAPER_FAINT = "#000000", "#B0B0B0"
"""The truth, and what is only there for orientation."""
PAPER_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
"""Of Okabe and Ito, for lines and clusters in this order."""
FIGURE_STYLE: Mapping[str, object] = MappingProxyType(
    {
        "font.size": 9,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.alpha": 0.3,
        "legend.frameon": False,
        "legend.fontsize": 8,
        "figure.dpi": 120,
    }
)
"""Settings of Matplotlib for all figures."""

# --------------------------------------------------------------------------------------------------
# The page of boards, on white and on dark ground; names are those of its style sheet.

PAGE_LIGHT: Mapping[str, str] = MappingProxyType(
    {
        "paper": "#ffffff",
        "ink": "#1b1f24",
        "soft": "#59636e",
        "line": "#d4dae1",
        "raised": "#f3f5f8",
        "road": "#e6e9ee",
        "edge": "#c6ccd4",
        "right": "#0072b2",
        "missed": "#c26a00",
        "false": "#c3372f",
        "switch": "#8b1ae0",
        "truth": "#333a42",
        "other": "#8a939d",
    }
)
PAGE_DARK: Mapping[str, str] = MappingProxyType(
    {
        "paper": "#14181d",
        "ink": "#e7ebf0",
        "soft": "#a3adb8",
        "line": "#333b45",
        "raised": "#1e242b",
        "road": "#262d36",
        "edge": "#3c4652",
        "right": "#56b4e9",
        "missed": "#f0a63a",
        "false": "#ff7f73",
        "switch": "#b375ff",
        "truth": "#e7ebf0",
        "other": "#7d8894",
    }
)
