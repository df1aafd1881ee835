from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from roadscope.benchmarks.metrics.image_labels import PARKED
from roadscope.benchmarks.train import views
from roadscope.benchmarks.train.recipe import CALIBRATION_SEEDS, RECIPES, TRAIN_SEEDS, Recipe
from roadscope.benchmarks.train.views import View, drawn_views, keep, read, render
from roadscope.core import RecordError
from roadscope.envs.sensors.weather import weather


def test_what_is_rendered_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view = View("two-way", 3, "fog-2", images=2, focal_px=500.0, height_m=1.7)
    made = render(view)
    monkeypatch.setattr(views, "render", lambda _: made)
    first = keep(view, tmp_path)
    monkeypatch.setattr(views, "render", None)
    assert keep(view, tmp_path) == first
    again = read(view, tmp_path)
    np.testing.assert_array_equal(again.pixels, made.pixels)
    air = weather("fog-2").extinction_per_m
    assert again.labels == tuple(label.in_air(air) for label in made.labels)
    assert made.pixels.shape == (2, 480, 640, 3)
    assert any(label.asked.any() for label in made.labels)
    # The style of this road has parked cars.
    assert any((label.categories == PARKED).any() for label in made.labels)


def test_views_have_names_of_their_own() -> None:
    view = View("street", 1)
    other = [replace(view, seed=2), replace(view, weather="fog-1"), replace(view, focal_px=500.0)]
    assert len({v.name for v in [view, *other]}) == 4


def test_drawn_views_stay_within_their_seeds_and_repeat() -> None:
    recipe = RECIPES["full"]
    drawn = drawn_views(recipe, 60, TRAIN_SEEDS)
    assert drawn == drawn_views(recipe, 60, TRAIN_SEEDS)
    assert all(v.seed in TRAIN_SEEDS for v in drawn)
    assert {v.scenario for v in drawn} == set(recipe.scenarios)
    assert not {v.seed for v in drawn} & set(CALIBRATION_SEEDS)
    plain = drawn_views(recipe, 20, TRAIN_SEEDS, varied=False)
    assert {v.focal_px for v in plain} == {None}


def test_recipes_without_steps_are_refused() -> None:
    with pytest.raises(RecordError, match=r"Recipe\.steps: expected at least 1, got 0"):
        Recipe(steps=0)
