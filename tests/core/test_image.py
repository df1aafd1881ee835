"""When an image shows nothing."""

import numpy as np
import pytest

from roadscope.core import CameraImage


def image(linear: np.ndarray, noise: float = 0.0) -> CameraImage:
    """Return an image of (H, W) brightness from 0 to 1 with the noise of a sensor, sRGB."""
    rng = np.random.default_rng(0)
    light = np.clip(linear[..., None] + noise * rng.standard_normal((*linear.shape, 3)), 0.0, 1.0)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return CameraImage((255 * curve).round().astype(np.uint8), np.eye(3), 0.0, "front")


DARKNESS = np.zeros((480, 640))


@pytest.mark.parametrize("noise", [0.0, 0.0013, 0.01, 0.04])
def test_a_covered_lens_is_blank_however_much_its_noise_is_amplified(noise: float) -> None:
    assert image(DARKNESS, noise).blank


def test_a_blinded_lens_is_blank() -> None:
    assert image(DARKNESS + 1.0).blank


@pytest.mark.parametrize("noise", [0.0, 0.0013, 0.01])
def test_a_lamp_in_the_dark_is_not(noise: float) -> None:
    dark = DARKNESS.copy()
    dark[200:232, 300:332] = 0.3
    assert not image(dark, noise).blank


@pytest.mark.parametrize("noise", [0.0, 0.0013, 0.01])
def test_a_road_that_is_hardly_lit_is_not(noise: float) -> None:
    road = np.tile(np.linspace(0.0, 0.05, 480)[:, None], (1, 640))
    assert not image(road, noise).blank


def test_a_grey_wall_that_fills_the_image_is_not() -> None:
    assert not image(DARKNESS + 0.4).blank


def test_its_size_is_width_and_height() -> None:
    assert image(DARKNESS).size_px == (640, 480)


def test_the_smallest_images() -> None:
    assert image(np.zeros((0, 0))).blank
    assert image(np.zeros((3, 3))).blank
    assert not image(np.full((3, 3), 0.02)).blank
