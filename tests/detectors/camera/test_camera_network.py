import numpy as np
import pytest
import torch

from roadscope.detectors.camera import CentreNetwork, decode, finer, squared, squares


def used_network(seed: int = 0) -> CentreNetwork:
    """A network whose norms have seen something."""
    torch.manual_seed(seed)
    network = CentreNetwork().train()
    with torch.no_grad():
        for _ in range(3):
            network(torch.rand(2, 64, 96, 3) * 2 - 1)
    return network.eval()


def test_it_is_small_and_keeps_its_shapes() -> None:
    network = CentreNetwork().eval()
    assert sum(p.numel() for p in network.parameters()) < 1_000_000
    with torch.inference_mode():
        maps = network(torch.zeros(2, 64, 96, 3))
    assert maps.heat.shape == (2, 3, 32, 48)
    assert maps.distances.shape == (2, 4, 32, 48)
    assert maps.vehicles.shape == (2, 5, 32, 48)
    assert bool((maps.distances > 0).all())


@pytest.mark.slow
def test_a_folded_network_has_the_same_outputs() -> None:
    network = used_network()
    pixels = torch.rand(1, 64, 96, 3) * 2 - 1
    with torch.inference_mode():
        expected, folded = network(pixels), network.folded()(pixels)
        rough = network.folded(torch.bfloat16)(pixels.bfloat16())
    for a, b, c in zip(expected, folded, rough, strict=True):
        torch.testing.assert_close(b, a, rtol=1e-4, atol=1e-5)
        assert c.dtype == torch.float32
        torch.testing.assert_close(c, a, rtol=0.1, atol=0.1)


def test_squares_are_those_of_the_image() -> None:
    pixels = torch.arange(8 * 12 * 3).reshape(1, 8, 12, 3)
    made = squares(pixels)
    assert made.shape == (1, 12, 4, 6)
    assert torch.equal(made[0, :, 2, 4].reshape(2, 2, 3), pixels[0, 4:6, 8:10])


def test_bytes_are_laid_out_as_colours_are() -> None:
    image = np.random.default_rng(0).integers(0, 256, (8, 12, 3), np.uint8)
    made = squares(torch.from_numpy(image[None]))
    np.testing.assert_array_equal(squared(image), made[0].permute(1, 2, 0).numpy())


@pytest.mark.slow
def test_answers_become_the_same_boxes_as_maps_do() -> None:
    network = used_network().folded()
    image = np.random.default_rng(1).integers(0, 256, (64, 96, 3), np.uint8)
    pixels = torch.from_numpy(image[None]).float() / 127.5 - 1
    with torch.inference_mode():
        maps = [m[0].numpy() for m in network(pixels)]
        answers = network.answers(squares(pixels))[0].numpy().reshape(16, 24, 4, 12)
    # The surest answer alone, or others would have a say in its box.
    boxes = decode(answers, height_px=64, width_px=96, least_log_odds=float(maps[0].max()))
    rows = np.argsort(-maps[0].ravel(), kind="stable")[:1]
    family, row, column = (int(k) for k in np.unravel_index(rows[0], maps[0].shape))
    middle = 2 * (np.array([column, row]) + 0.5)
    expected = np.tile(middle, 2) + maps[1][:, row, column] * (-1, -1, 1, 1)
    expected = np.clip(expected, 0, [96, 64, 96, 64])
    np.testing.assert_allclose(boxes.boxes, [expected], rtol=1e-5)
    assert boxes.families[0] == family


def test_parts_of_a_place_lie_row_by_row() -> None:
    logits = torch.arange(2 * 3 * 4 * 5).reshape(1, 2, 3, 20)
    made = finer(logits)
    assert made.shape == (1, 5, 4, 6)
    for row, column in ((0, 0), (1, 0), (2, 5), (3, 4)):
        k = 2 * (row % 2) + column % 2
        expected = logits[0, row // 2, column // 2, 5 * k : 5 * k + 5]
        assert torch.equal(made[0, :, row, column], expected)
