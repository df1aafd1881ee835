from itertools import combinations, pairwise

import numpy as np
import pytest

from roadscope.core import (
    ASPHALT_COLOUR,
    COLOUR_SCALE,
    DETECTION_COLOURS,
    GROUND_COLOUR,
    HIDDEN_COLOUR,
    ODOMETRY_COLOUR,
    PAGE_DARK,
    PAGE_LIGHT,
    PANEL_COLOUR,
    TRACK_COLOURS,
    TRUTH_COLOUR,
    hex_colour,
    track_colour,
)

# Machado, Oliveira and Fernandes 2009, severity 1.
VISION = {
    "usual": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
MEANINGS = {
    "truth": TRUTH_COLOUR,
    "hidden": HIDDEN_COLOUR,
    "odometry": ODOMETRY_COLOUR,
    **{f"detected {family}": colour for family, colour in DETECTION_COLOURS.items()},
    **{f"track {number}": colour for number, colour in enumerate(TRACK_COLOURS)},
}


def lab(colour: tuple[int, ...], vision: str) -> np.ndarray:
    """Return CIELAB of a colour as readers of that vision see it."""
    share = np.array(colour) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    perceived = np.clip(VISION[vision] @ linear, 0, 1)
    xyz = (
        np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
        @ perceived
        / (0.9505, 1.0, 1.089)
    )
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def rgb(text: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(text.removeprefix("#")))


@pytest.mark.parametrize("vision", VISION)
def test_colours_of_different_meanings_are_distinct_with_every_colour_vision(vision):
    for (first, a), (second, b) in combinations(MEANINGS.items(), 2):
        assert np.linalg.norm(lab(a, vision) - lab(b, vision)) > 11, (first, second)


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("ground", [GROUND_COLOUR, ASPHALT_COLOUR, PANEL_COLOUR])
def test_everything_stands_out_from_the_ground(vision, ground):
    for name, colour in MEANINGS.items():
        assert lab(colour, vision)[0] - lab(ground, vision)[0] > 25, name


@pytest.mark.parametrize("page", [PAGE_LIGHT, PAGE_DARK])
@pytest.mark.parametrize("vision", VISION)
def test_the_page_has_different_colours_for_right_and_wrong(page, vision):
    names = ("right", "missed", "false", "switch", "truth")
    for first, second in combinations(names, 2):
        lab_difference = lab(rgb(page[first]), vision) - lab(rgb(page[second]), vision)
        assert np.linalg.norm(lab_difference) > 11, (first, second)


def test_the_scale_of_measured_values_gets_lighter_all_along():
    lightness = [lab(colour, vision)[0] for vision in VISION for colour in COLOUR_SCALE]
    steps = np.diff(np.reshape(lightness, (len(VISION), -1)), axis=1)
    assert (steps > 8).all()


def test_consecutive_tracks_have_different_colours():
    colours = [track_colour(number) for number in range(20)]
    assert all(a != b for a, b in pairwise(colours))
    assert set(colours) == set(TRACK_COLOURS)


def test_colours_of_figures_are_written_in_hexadecimal():
    assert hex_colour((86, 180, 3)) == "#56b403"
