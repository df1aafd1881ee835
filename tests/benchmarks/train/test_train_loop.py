from dataclasses import replace
from pathlib import Path

import pytest
import torch
from toy_pictures import toy_pictures

from roadscope.benchmarks.train import Recipe, ShuffledPictures, Trainer, batch, train

RECIPE = Recipe(steps=6, pixels=2 * 96 * 128, learning_rate=2e-3)
CPU = torch.device("cpu")


def same(a: Trainer, b: Trainer) -> bool:
    pairs = [(a.network, b.network), (a.average, b.average)]
    return all(
        torch.equal(one, two)
        for x, y in pairs
        for one, two in zip(x.state_dict().values(), y.state_dict().values(), strict=True)
    )


class Killed(Exception):  # noqa: N818
    pass


@pytest.mark.slow
def test_killed_and_resumed_is_as_never_stopped(tmp_path: Path) -> None:
    pictures = [toy_pictures(0), toy_pictures(1)]
    whole = Trainer(RECIPE, "key", CPU)
    train(whole, pictures, tmp_path / "whole.pt")

    def kill(step: int, loss: float) -> None:
        if step == 5:
            raise Killed

    part = Trainer(RECIPE, "key", CPU)
    with pytest.raises(Killed):
        train(part, pictures, tmp_path / "part.pt", checkpoint_every=3, on_step=kill)
    again, steps = Trainer(RECIPE, "key", CPU), []
    train(again, pictures, tmp_path / "part.pt", on_step=lambda step, _: steps.append(step))
    assert steps == [4, 5, 6]
    assert same(whole, again)


@pytest.mark.slow
def test_checkpoints_of_other_data_or_damaged_are_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "c.pt"
    first = Trainer(RECIPE, "one", CPU)
    first.save(path)
    assert Trainer(RECIPE, "one", CPU).resume(path)
    assert not Trainer(RECIPE, "two", CPU).resume(path)
    path.write_bytes(path.read_bytes()[:1000])
    assert not Trainer(RECIPE, "one", CPU).resume(path)
    assert not Trainer(RECIPE, "one", CPU).resume(tmp_path / "none.pt")


@pytest.mark.slow
def test_the_loss_falls_on_toy_pictures(tmp_path: Path) -> None:
    recipe = replace(RECIPE, steps=40, pixels=4 * 96 * 128)
    step_losses: list[float] = []
    train(
        Trainer(recipe, "key", CPU),
        [toy_pictures(0)],
        tmp_path / "c.pt",
        on_step=lambda _, loss: step_losses.append(loss),
    )
    assert sum(step_losses[-8:]) < 0.6 * sum(step_losses[:8])


def test_batches_depend_on_their_number_alone() -> None:
    pictures = [toy_pictures(0)]
    first = batch(ShuffledPictures(pictures, 0), RECIPE, 3)
    later = batch(ShuffledPictures(pictures, 0), RECIPE, 3)
    other = batch(ShuffledPictures(pictures, 0), RECIPE, 4)
    assert torch.equal(first.pixels, later.pixels)
    assert not torch.equal(first.pixels, other.pixels)


def test_batches_have_the_pixels_of_the_recipe_in_crops_of_one_size_each() -> None:
    recipe, pictures = replace(RECIPE, pixels=4 * 256 * 320), ShuffledPictures([toy_pictures(0)], 0)
    sizes = set()
    for step in range(10):
        pixels, targets = batch(pictures, recipe, step)
        count, height, width, _ = pixels.shape
        sizes.add((height, width))
        assert count * height * width == pytest.approx(recipe.pixels, rel=0.25)
        assert targets.heat.shape == (count, 3, height // 2, width // 2)
    assert len(sizes) > 3
