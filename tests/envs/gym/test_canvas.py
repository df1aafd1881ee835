import numpy as np
import pytest

from roadscope.envs.gym import Canvas, polygon_depth, text_px

WHITE = (255, 255, 255)


def _blank(size: int = 60) -> Canvas:
    return Canvas(np.zeros((size, size, 3), np.uint8))


def _turned(angle: float) -> np.ndarray:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.array([[-12, -5], [12, -5], [12, 5], [-12, 5]]) @ turn.T + (30.3, 29.6)


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.8, 2.0])
@pytest.mark.parametrize("turns", [1, -1])
def test_a_polygon_covers_its_area_either_way_round(angle, turns):
    canvas = _blank()
    canvas.polygon(_turned(angle)[::turns], WHITE)
    assert canvas.image()[..., 0].sum() / 255 == pytest.approx(24 * 10, rel=0.02)


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
    assert image.sum() / 255 == pytest.approx(2 * 2 * (24 + 10), rel=0.1)


def test_depth_is_the_distance_to_the_nearest_side():
    depth = polygon_depth(_turned(0.0), np.arange(60), np.arange(60))
    assert depth[30, 30] == pytest.approx(5 - 0.4)
    assert depth[10, 30] < 0


def test_polygons_are_clipped_at_the_border():
    canvas = _blank()
    canvas.polygon(_turned(0.3) - 35, WHITE)
    canvas.polygon(_turned(0.3) + 500, WHITE)
    canvas.line(np.array([-50.0, 20.0]), np.array([100.0, 20.0]), WHITE, 2.0)
    canvas.dots(
        np.array([[-3.0, 5.0], [59.0, 59.0], [1e9, -1e9]]), np.ones(3, np.uint8), np.ones((2, 3))
    )
    canvas.text("12", np.array([55.0, 57.0]), WHITE)
    image = canvas.image()
    assert image.shape == (60, 60, 3)
    assert (image[20] == 255).all()


def test_the_highest_level_lies_on_top_whatever_the_order():
    palette = np.array([[0, 0, 0], [10, 10, 10], [99, 99, 99]], np.float32)
    places = np.array([[20.0, 20.0], [20.0, 20.0]])
    for levels in ([1, 2], [2, 1]):
        canvas = _blank()
        canvas.dots(places, np.array(levels, np.uint8), palette)
        assert (canvas.image()[20:22, 20:22] == 99).all()


def test_characters_differ():
    drawn = []
    for character in "0123456789ABCDEFGHIJKLMNPQRSTUVWXYZm-, ":
        canvas = _blank(20)
        canvas.text(character, np.array([2.0, 2.0]), WHITE)
        drawn.append(canvas.image().tobytes())
    assert len(set(drawn)) == len(drawn)


def test_small_letters_are_written_as_capitals():
    images = []
    for text in ("Track", "TRACK"):
        canvas = _blank()
        canvas.text(text, np.array([2.0, 2.0]), WHITE)
        images.append(canvas.image())
    assert np.array_equal(*images)


@pytest.mark.parametrize("scale", [1, 2])
def test_the_size_of_a_text_is_known_before_it_is_written(scale):
    canvas = _blank()
    canvas.text("B8E", np.array([5.0, 7.0]), WHITE, scale)
    rows, columns = np.nonzero(canvas.image()[..., 0])
    assert (columns.min(), rows.min()) == (5, 7)
    assert (np.ptp(columns) + 1, np.ptp(rows) + 1) == tuple(text_px("B8E", scale))
