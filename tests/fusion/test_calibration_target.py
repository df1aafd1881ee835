"""A target's corners from returns and from pixels whose answer is known."""

import numpy as np
import pytest

from roadscope.fusion import CalibrationError, TriangularTarget, corners_in_image, corners_in_scans

TARGET = TriangularTarget()


def placed(yaw: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners, the target's left direction and middle of its base, LiDAR frame."""
    left = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    foot = np.array([6.0, 0.7, -0.4])
    flat = TARGET.corners
    return foot - flat[:, :1] * left + flat[:, 1:] * np.array([0.0, 0.0, 1.0]), left, foot


def returns(yaw: float, step: float, noise_m: float) -> tuple[np.ndarray, ...]:
    """Ten scans of 16 rings of a flat target that nothing else stands beside."""
    _, left, foot = placed(yaw)
    normal = np.cross(left, [0.0, 0.0, 1.0])
    rng = np.random.default_rng(0)
    rings, columns = np.meshgrid(np.arange(16), np.arange(-200, 200), indexing="ij")
    azimuth, elevation = (columns + 0.3) * step, np.radians(-5 + 0.7 * rings)
    rays = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        -1,
    )
    ranges = (foot @ normal) / (rays @ normal)
    off = rays * ranges[..., None] - foot
    height, aside = off[..., 2], off @ left
    half = TARGET.base_m / 2 * (1 - height / TARGET.height_m)
    hit = (height > 0) & (height < TARGET.height_m) & (np.abs(aside) < half)
    parts = []
    for _ in range(10):
        far = ranges[hit] + noise_m * rng.standard_normal(int(hit.sum()))
        parts.append(rays[hit] * far[:, None])
    return np.concatenate(parts), np.tile(rings[hit], 10), np.tile(columns[hit], 10)


@pytest.mark.parametrize("yaw", [0.0, 0.5, -0.4])
@pytest.mark.parametrize("noise_m", [0.0, 0.03])
def test_corners_from_returns(yaw: float, noise_m: float) -> None:
    points, ring, column = returns(yaw, np.radians(0.1), noise_m)
    corners = corners_in_scans(points, ring, column, TARGET, np.radians(0.1))
    truth, _, _ = placed(yaw)
    assert np.linalg.norm(corners - truth, axis=1).max() < (0.01 if noise_m == 0 else 0.02)


@pytest.mark.parametrize("turn_deg", [90.0, 173.0, 180.0])
def test_corners_turn_with_the_target(turn_deg: float) -> None:
    points, ring, column = returns(0.5, np.radians(0.1), 0.0)
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    corners = corners_in_scans(points @ turned.T, ring, column, TARGET, np.radians(0.1))
    truth, _, _ = placed(0.5)
    assert np.linalg.norm(corners - truth @ turned.T, axis=1).max() < 0.01


def test_too_few_rings_are_refused() -> None:
    points, ring, column = returns(0.0, np.radians(0.1), 0.0)
    low = ring <= ring.min() + 1
    with pytest.raises(CalibrationError, match="2 rings"):
        corners_in_scans(points[low], ring[low], column[low], TARGET, np.radians(0.1))


def picture(corners: np.ndarray, noise: float = 3.0) -> np.ndarray:
    """A bright triangle before a dark road and a lighter sky."""
    rows, columns = np.mgrid[0:240, 0:320] + 0.5
    inside = np.ones((240, 320), bool)
    turned = np.roll(corners, -1, axis=0)
    centre = corners.mean(axis=0)
    for (x, y), (u, v) in zip(corners, turned, strict=True):
        side = (u - x) * (rows - y) - (v - y) * (columns - x)
        inside &= side * ((u - x) * (centre[1] - y) - (v - y) * (centre[0] - x)) > 0
    grey = np.where(inside, 230.0, np.where(rows < 130, 120.0, 70.0))
    return grey + noise * np.random.default_rng(1).standard_normal(grey.shape)


@pytest.mark.parametrize(
    "corners",
    [[[60.3, 200.2], [220.7, 190.4], [140.1, 60.6]], [[100.0, 170.5], [190.0, 181.5], [150, 90]]],
)
def test_corners_from_pixels(corners: list[list[float]]) -> None:
    truth = np.array(corners)
    assert np.abs(corners_in_image(picture(truth)) - truth).max() < 0.4


def test_a_picture_without_the_whole_target_is_refused() -> None:
    with pytest.raises(CalibrationError, match="cuts the target"):
        corners_in_image(picture(np.array([[-40.0, 200], [150, 200], [60, 60]])))
    with pytest.raises(CalibrationError, match="pixels high"):
        corners_in_image(picture(np.array([[100.0, 110], [160, 110], [130, 100]])))
    with pytest.raises(CalibrationError, match=r"no bright target|pixels high|cuts"):
        corners_in_image(np.full((240, 320), 90.0))
