"""Patterns on vehicles: places of lamps, plates, wheels and windows."""

import numpy as np
import pytest

from roadscope.core import Category
from roadscope.envs.imaging import axles, bodywork, glass

PAINT = (0.1, 0.2, 0.6)
LENGTH, WIDTH, HEIGHT = 4.6, 1.85, 1.5
CAR = np.array([0.0, 0.0, 1.0, 0.0, LENGTH / 2, WIDTH / 2, HEIGHT, Category.CAR], float)
BUS = np.array([0.0, 0.0, 1.0, 0.0, 6.0, 1.27, 3.1, Category.BUS], float)


def painted(
    frame: np.ndarray,
    place: tuple[float, float, float],
    facing: tuple[float, float],
    *,
    lamps: bool = False,
) -> np.ndarray:
    """Colour (3,), gloss and own light (3,) at a place along, across and up, facing a direction."""
    out = np.array([*PAINT, 0.0, 0.0, 0.0, 0.0])
    along, across, z = place
    bodywork(frame, 0.0, along, across, z, *facing, lamps, out)
    return out


FRONT, REAR, FLANK = (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0)


def rear(across: float, level: float, **options: bool) -> np.ndarray:
    return painted(CAR, (-LENGTH / 2, across * WIDTH / 2, level * HEIGHT), REAR, **options)


def front(across: float, level: float, **options: bool) -> np.ndarray:
    return painted(CAR, (LENGTH / 2, across * WIDTH / 2, level * HEIGHT), FRONT, **options)


@pytest.mark.parametrize("side", [-0.9, 0.9])
def test_rear_lamps_are_red_at_both_sides_and_shine_when_lit(side: float) -> None:
    off, lit = rear(side, 0.45), rear(side, 0.45, lamps=True)
    assert off[0] > 5 * off[1:3].max()
    assert off[4:].max() == 0.0
    assert lit[4] > 10 * lit[5:].max()
    assert rear(0.0, 0.6)[:3].tolist() == list(PAINT)


@pytest.mark.parametrize("side", [-0.8, 0.8])
def test_headlamps_are_white_at_both_sides_and_shine_when_lit(side: float) -> None:
    off, lit = front(side, 0.44), front(side, 0.44, lamps=True)
    assert np.ptp(off[:3]) < 0.1
    assert off[:3].min() > 0.5
    assert lit[4:].min() > 5.0


@pytest.mark.parametrize(
    ("category", "height"),
    [
        (Category.CAR, 1.5),
        (Category.VAN, 2.0),
        (Category.VAN, 2.52),
        (Category.VAN, 2.64),
        (Category.BUS, 3.1),
        (Category.TRUCK, 3.6),
        (Category.TRUCK, 4.0),
    ],
)
def test_headlamps_have_the_height_of_those_of_cars(category, height: float) -> None:
    """Road law asks for 0.5 to 1.2 m of every vehicle."""
    frame = np.array([0.0, 0.0, 1.0, 0.0, 2.6, 1.0, height, category], float)
    heights = np.arange(0.01, height, 0.02)
    lit = [painted(frame, (2.6, 0.75, z), FRONT, lamps=True)[4:].min() > 5.0 for z in heights]
    assert 0.5 < heights[lit].min() < heights[lit].max() < 1.3


@pytest.mark.parametrize(("end", "level"), [(rear, 0.36), (front, 0.31)])
def test_plates_are_bright_with_dark_letters(end, level: float) -> None:
    row = np.array([end(a, level)[1] for a in np.linspace(-0.22, 0.22, 200) / (WIDTH / 2)])
    assert row.max() > 0.5
    assert row.min() < 0.15
    letters = (np.diff((row < 0.3).astype(int)) == 1).sum()
    assert 4 <= letters <= 9
    assert end(0.5, level)[1] != pytest.approx(row.max())


def test_wheels_are_dark_rings_around_rims_at_both_axles() -> None:
    ahead, behind, radius = axles(LENGTH / 2, HEIGHT)
    assert behind < 0 < ahead
    for axle in (ahead, behind):
        at = [
            painted(CAR, (axle, WIDTH / 2, radius + share * radius), FLANK)[:3]
            for share in (0.8, 0.63, 0.0)
        ]
        tyre, rim, hub = (float(np.mean(colour)) for colour in at)
        assert tyre < 0.02
        assert rim > 10 * tyre
        assert hub > 5 * tyre
    between = painted(CAR, (0.2, WIDTH / 2, 0.4 * HEIGHT), FLANK)
    assert between[:3] == pytest.approx(PAINT, rel=0.2)


def test_lorries_and_vans_have_windows_in_their_cabs_alone() -> None:
    for category, along, level in ((Category.TRUCK, 2.2, 0.63), (Category.VAN, 1.4, 0.7)):
        frame = np.array([0.0, 0.0, 1.0, 0.0, 3.0, 1.1, 2.6, category], float)
        cab, load = (painted(frame, (x, 1.1, level * 2.6), FLANK)[:3] for x in (along, -2.0))
        assert cab.max() < 0.03
        assert load == pytest.approx(PAINT)


@pytest.mark.parametrize(("frame", "pillars"), [(CAR, 1), (BUS, 7)])
def test_pillars_in_the_body_colour_separate_the_windows(frame: np.ndarray, pillars: int) -> None:
    length = 2 * frame[4]
    shown = []
    for along in np.linspace(-frame[4] + 0.2, frame[4] - 0.2, 800):
        out = np.array([0.015, 0.018, 0.02, 0.1, 0.0, 0.0, 0.0])
        glass(
            np.array(PAINT), frame, along + frame[4], length, along, 0.6 * frame[6], 0.0, 1.0, out
        )
        shown.append(out[2] > 0.05)
    runs = (np.diff(np.array(shown).astype(int), prepend=0) == 1).sum()
    assert pillars <= runs <= pillars + 2
    assert np.mean(shown) < 0.2
