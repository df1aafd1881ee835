import numpy as np
import pytest

from roadscope.envs.world import ellipse, padded, placed, rectangle, rounded


def _area(outline: np.ndarray) -> float:
    after = np.roll(outline, -1, axis=0)
    return float((outline[:, 0] * after[:, 1] - outline[:, 1] * after[:, 0]).sum() / 2)


@pytest.mark.parametrize("radius", [0.0, 0.3, 5.0])
def test_a_rounded_rectangle_keeps_its_extents(radius):
    outline = rounded(4.5, 1.8, radius, centre_x_m=0.7)
    assert np.allclose(outline.max(0) - outline.min(0), (4.5, 1.8))
    assert np.allclose((outline.max(0) + outline.min(0)) / 2, (0.7, 0.0))
    assert 0.0 < _area(outline) <= 4.5 * 1.8 + 1e-9


def test_rounding_takes_area_from_the_corners():
    lost = 4.5 * 1.8 - _area(rounded(4.5, 1.8, 0.3))
    # An arc of two chords in a square of 0.3 m leaves r^2 (1 - sin 45 deg) a corner.
    assert lost == pytest.approx(4 * 0.3**2 * (1 - np.sqrt(0.5)))


@pytest.mark.parametrize("corners", [4, 8, 12])
def test_an_ellipse_touches_its_box_and_turns_left(corners):
    outline = ellipse(2.0, 1.0, corners)
    assert np.allclose(outline.max(0), (1.0, 0.5))
    assert np.allclose(outline.min(0), (-1.0, -0.5))
    assert _area(outline) > 0


def test_placing_turns_counter_clockwise():
    moved = placed(rectangle(4.0, 2.0), np.array([[10.0, 5.0]]), np.array([np.pi / 2]))
    assert np.allclose(moved[0, 1], (10.0 + 1.0, 5.0 + 2.0))
    assert _area(moved[0]) == pytest.approx(8.0)


def test_padding_repeats_the_last_corner():
    outline = rectangle(1.0, 1.0)[None]
    full = padded(outline)
    assert full.shape == (1, 12, 2)
    assert np.array_equal(full[0, 4:], np.tile(outline[0, 3], (8, 1)))
