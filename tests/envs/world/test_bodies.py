import numpy as np
import pytest

from roadscope.core import Category
from roadscope.envs.traffic import UNSEEN
from roadscope.envs.world import Prisms, body_prisms

SIZES = {
    Category.CAR: [(3.6, 1.6, 1.5), (4.87, 1.85, 1.48), (5.2, 2.0, 1.8)],
    Category.VAN: [(4.4, 1.8, 1.9), (6.9, 2.05, 2.7)],
    Category.TRUCK: [(5.9, 2.3, 2.8), (8.5, 2.5, 3.6), (16.5, 2.55, 4.0)],
    Category.BUS: [(12.0, 2.55, 3.1), (18.0, 2.55, 3.1)],
    Category.MOTORCYCLE: [(2.1, 0.8, 1.5)],
    Category.CYCLIST: [(1.75, 0.6, 1.75)],
    Category.PEDESTRIAN: [(0.3, 0.5, 1.6), (0.8, 0.6, 1.9)],
}
CASES = [(category, size) for category, sizes in SIZES.items() for size in sizes]
STRANGE = [(category, size) for category, models in UNSEEN.items() for size in models.values()]


def _body(category: Category, size: tuple[float, float, float], seed: int = 0) -> Prisms:
    return body_prisms(category, np.array(size), np.random.default_rng(seed))


@pytest.mark.parametrize(("category", "size"), CASES + STRANGE)
@pytest.mark.parametrize("seed", range(3))
def test_a_body_fits_its_box_exactly(category, size, seed):
    body = _body(category, size, seed)
    corners = body.footprints.reshape(-1, 2)
    assert np.allclose(corners.max(0), np.array(size[:2]) / 2, atol=1e-9)
    assert np.allclose(corners.min(0), -np.array(size[:2]) / 2, atol=1e-9)
    assert body.tops.max() == pytest.approx(size[2])
    assert 0.0 <= body.bottoms.min() < 0.3 * size[2]
    assert (body.bottoms < body.tops).all()
    assert ((body.reflectivities > 0) & (body.reflectivities <= 1)).all()


@pytest.mark.parametrize(("category", "size"), CASES)
def test_a_body_is_a_short_stack_of_convex_solid_prisms(category, size):
    body = _body(category, size)
    on_two_wheels = category in (Category.MOTORCYCLE, Category.CYCLIST)
    assert 3 <= len(body) <= (15 if on_two_wheels else 6)
    assert (body.owners == 0).all()
    assert (body.extinctions == 0).all()
    for outline, count in zip(body.footprints, body.corners, strict=True):
        sides = np.diff(outline[:count], axis=0, append=outline[:1])
        after = np.roll(sides, -1, axis=0)
        assert (sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0] > -1e-9).all()


@pytest.mark.parametrize(("category", "size"), CASES)
def test_no_gap_opens_between_bottom_and_top(category, size):
    body = _body(category, size)
    for height in np.linspace(0.35 * size[2], 0.999 * size[2], 50):
        assert ((body.bottoms <= height) & (height <= body.tops)).any()


def _outline(body: Prisms, axis: int, pixels: int = 60) -> np.ndarray:
    """Return the silhouette from the side (0) or from behind (1), as tall as the picture."""
    scale = pixels / body.tops.max()
    picture = np.zeros((pixels, 2 * pixels), bool)
    for outline, low, high in zip(body.footprints[..., axis], body.bottoms, body.tops, strict=True):
        left, right = (
            np.clip(pixels + np.array([outline.min(), outline.max()]) * scale, 0, 2 * pixels)
            .round()
            .astype(int)
        )
        picture[round(low * scale) : round(high * scale), left:right] = True
    return picture


@pytest.mark.parametrize(
    ("one", "other", "axis", "most"),
    [
        (Category.MOTORCYCLE, Category.CYCLIST, 0, 0.65),
        (Category.MOTORCYCLE, Category.PEDESTRIAN, 0, 0.4),
        (Category.CYCLIST, Category.PEDESTRIAN, 0, 0.5),
        (Category.CAR, Category.VAN, 0, 0.9),
        (Category.VAN, Category.TRUCK, 0, 0.9),
        (Category.TRUCK, Category.BUS, 0, 0.9),
        (Category.CAR, Category.MOTORCYCLE, 1, 0.65),
    ],
)
def test_silhouettes_of_categories_differ(one, other, axis, most):
    first, second = (_outline(_body(c, SIZES[c][-1]), axis) for c in (one, other))
    assert (first & second).sum() / (first | second).sum() < most


def test_two_wheels_stand_apart_with_air_between():
    for category in (Category.MOTORCYCLE, Category.CYCLIST):
        low = _outline(_body(category, SIZES[category][0]), 0)[2]
        runs = np.flatnonzero(np.diff(low.astype(int), prepend=0) == 1)
        assert len(runs) == 2


def test_a_car_is_narrower_and_shorter_at_the_roof():
    body = _body(Category.CAR, (4.5, 1.8, 1.5))
    roof = body.footprints[body.tops.argmax()]
    assert np.ptp(roof[:, 0]) < 0.6 * 4.5
    assert np.ptp(roof[:, 1]) < 0.9 * 1.8


def test_a_long_truck_has_a_gap_behind_its_cab():
    body = _body(Category.TRUCK, (16.5, 2.55, 4.0))
    tall = body.select((body.bottoms < 2.5) & (body.tops > 2.5))
    front = tall.footprints[..., 0].min(axis=1).max()
    rear = tall.footprints[..., 0].max(axis=1).min()
    assert 0.5 < front - rear < 1.5


def test_only_paint_depends_on_the_random_numbers():
    same = _body(Category.CAR, (4.5, 1.8, 1.5), 3) == _body(Category.CAR, (4.5, 1.8, 1.5), 3)
    assert same
    paints = {float(_body(Category.CAR, (4.5, 1.8, 1.5), s).reflectivities[0]) for s in range(60)}
    assert min(paints) == pytest.approx(0.1)
    assert max(paints) == pytest.approx(0.8)
