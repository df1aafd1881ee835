import numpy as np
import pytest

from roadscope.envs.drawing import Canvas, text_px

WHITE = (255, 255, 255)


def _blank(size: int = 60) -> Canvas:
    return Canvas(size, size, (0, 0, 0))


def _turned(angle: float) -> np.ndarray:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.array([[-12, -5], [12, -5], [12, 5], [-12, 5]]) @ turn.T + (30.3, 29.6)


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.8, 2.0])
@pytest.mark.parametrize("turns", [1, -1])
def test_a_polygon_covers_its_area_either_way_round(angle, turns):
    canvas = _blank()
    canvas.polygon(_turned(angle)[::turns], WHITE)
    assert canvas.image()[..., 0].sum() / 255 == pytest.approx(24 * 10, rel=0.08)


def test_edges_are_smooth():
    canvas = _blank()
    canvas.polygon(_turned(0.3), WHITE)
    values = canvas.image()[..., 0]
    assert ((values > 20) & (values < 235)).sum() > 30


def test_an_outline_leaves_the_inside():
    canvas = _blank()
    canvas.polygon(_turned(0.0), WHITE, fill=0.0, line_px=2.0)
    image = canvas.image()[..., 0]
    assert image[30, 30] == 0
    assert image.sum() / 255 == pytest.approx(2 * 2 * (24 + 10), rel=0.15)


def test_polygons_are_clipped_at_the_border():
    canvas = _blank()
    canvas.polygon(_turned(0.3) - 35, WHITE)
    canvas.polygon(_turned(0.3) + 500, WHITE)
    canvas.line(np.array([[-50.0, 20.5], [100.0, 20.5]]), WHITE, 3.0)
    canvas.dots(
        np.array([[-3.0, 5.0], [59.9, 59.9], [1e9, -1e9]]), np.ones(3, np.uint8), np.ones((2, 3))
    )
    canvas.text("12", np.array([55.0, 57.0]), WHITE, 12)
    image = canvas.image()
    assert image.shape == (60, 60, 3)
    assert (image[20] == 255).all()


def test_the_highest_level_lies_on_top_whatever_the_order():
    palette = np.array([[0, 0, 0], [10, 10, 10], [99, 99, 99]])
    places = np.array([[20.0, 20.0], [20.0, 20.0]])
    for levels in ([1, 2], [2, 1]):
        canvas = _blank()
        canvas.dots(places, np.array(levels, np.uint8), palette)
        image = canvas.image()
        assert image.max() == 99
        assert not ((image > 0) & (image <= 10)).any()


def test_dashes_cover_half_of_a_line():
    canvas = _blank()
    canvas.dashes(np.array([[4.0, 30.0], [30.0, 30.0], [56.0, 30.0]]), WHITE, 2.0, 4.0)
    assert canvas.image()[..., 0].sum() / 255 == pytest.approx(2 * 28, rel=0.2)


def test_an_image_is_shown_at_its_place_and_size():
    canvas = _blank()
    canvas.paste(np.full((10, 20, 3), 200, np.uint8), np.array([5.0, 7.0]), width=40, height=20)
    rows, columns = np.nonzero(canvas.image()[..., 0] == 200)
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (5, 44, 7, 26)


def test_letters_are_smooth_and_lie_above_shapes():
    canvas = _blank()
    canvas.text("S8", np.array([10.0, 10.0]), WHITE, 20)
    canvas.polygon(_turned(0.0), (90, 0, 0))
    green = canvas.image()[..., 1]
    assert (green == 255).any()
    assert ((green > 20) & (green < 235)).sum() > 20


@pytest.mark.parametrize("size", [12, 20])
def test_a_text_stays_within_the_size_measured_before(size):
    canvas = _blank(80)
    canvas.text("B8g", np.array([5.0, 7.0]), WHITE, size)
    rows, columns = np.nonzero(canvas.image()[..., 0] > 40)
    width, height = text_px("B8g", size)
    assert 5 <= columns.min() < columns.max() <= 5 + width
    assert 7 <= rows.min() < rows.max() <= 7 + height
