import numpy as np
from toy_pictures import toy_pictures

from roadscope.benchmarks.metrics import Labels
from roadscope.benchmarks.train import (
    PixelSize,
    Window,
    cut_out,
    draw_window,
    objects_in,
    relight,
    relit,
)

CROP = PixelSize(256, 320)


def test_boxes_stay_on_their_objects() -> None:
    pictures = toy_pictures(1)
    rng = np.random.default_rng(0)
    compared = 0
    for k in range(16):
        pixels, labels = pictures.pixels[k % 4], pictures.labels[k % 4]
        window = draw_window(labels, PixelSize(*pixels.shape[:2]), CROP, rng)
        image = cut_out(pixels, window, CROP)
        objects = objects_in(labels, window, CROP)
        for box, category in zip(objects.boxes, objects.categories, strict=True):
            left, top, right, bottom = np.rint(box).astype(int)
            inside = image[top + 1 : bottom - 1, left + 1 : right - 1]
            if inside.size:
                channel = 2 if category == 6 else 0
                assert inside[..., channel].min() > 150
                compared += 1
    assert compared > 16


def test_objects_cut_off_or_too_small_are_not_eligible() -> None:
    labels = Labels(
        np.array([[90.0, 100, 190, 150], [200, 100, 230, 108], [300, 300, 320, 340]]),
        np.array([0, 0, 6]),
        np.full(3, 100),
        np.zeros(3),
        np.full(3, 9.0),
    )
    window = Window(170, 50, 320, 256)
    assert objects_in(labels, window, CROP).eligible.tolist() == [False, True, False]
    smaller = objects_in(labels, window, PixelSize(128, 160))
    assert smaller.eligible.tolist() == [False, False, False]


def test_mirrored_twice_is_as_before() -> None:
    pictures = toy_pictures(2, 1)
    window = Window(0, 0, 320, 256, mirrored=True)
    image = cut_out(pictures.pixels[0], window, CROP)
    plain = cut_out(pictures.pixels[0], Window(0, 0, 320, 256), CROP)
    np.testing.assert_array_equal(image[:, ::-1], plain)


def test_light_changes_but_stays_in_bounds() -> None:
    image = cut_out(toy_pictures(3, 1).pixels[0], Window(0, 0, 320, 256), CROP)
    for seed in range(12):
        lit = relit(image, np.random.default_rng(seed))
        assert lit.shape == (3, 256, 320)
        assert 0 <= float(lit.min()) <= float(lit.max()) <= 1
        assert not np.allclose(lit.permute(1, 2, 0).numpy() * 255, image, atol=1)


def test_relight_equals_its_formula_in_numpy() -> None:
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, 256, (9, 14, 3), np.uint8)
    tables = rng.normal(0.5, 0.4, (3, 256)).astype(np.float32)
    normals = rng.standard_normal(3 * 50).astype(np.float32)
    for noise in (0.0, 0.2):
        output = np.empty(pixels.shape, np.float32)
        relight(pixels, tables, np.float32(1.4), np.float32(noise), normals, 30, output)
        lit = np.stack([tables[c][pixels[..., c]] for c in range(3)], axis=-1)
        grey = lit.mean(axis=-1, keepdims=True)
        drawn = normals[(30 + np.arange(pixels.size)) % len(normals)].reshape(pixels.shape)
        expected = np.clip(grey + (lit - grey) * 1.4 + noise * drawn, 0, 1)
        np.testing.assert_allclose(output, expected, atol=1e-5)
