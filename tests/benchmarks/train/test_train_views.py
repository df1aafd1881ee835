from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from roadscope.benchmarks.metrics.image_labels import PARKED
from roadscope.benchmarks.train import views
from roadscope.benchmarks.train.camera import _split, held_out
from roadscope.benchmarks.train.recipe import (
    CALIBRATION_SEEDS,
    FAULTS,
    HELD_OUT_FAULTS,
    LOOKS,
    RECIPES,
    TEST_SEEDS,
    TRAIN_SEEDS,
    WORST,
    Recipe,
)
from roadscope.benchmarks.train.views import View, drawn_views, keep, read, render
from roadscope.core import RecordError
from roadscope.envs.sensors.faults import faults_of
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
    assert any(label.eligible.any() for label in made.labels)
    # The style of this road has parked cars.
    assert any((label.categories == PARKED).any() for label in made.labels)


def test_views_have_names_of_their_own() -> None:
    view = View("street", 1)
    other = [replace(view, seed=2), replace(view, weather="fog-1"), replace(view, focal_px=500.0)]
    other += [replace(view, light="dusk"), replace(view, faults="night:2")]
    assert len({v.name for v in [view, *other]}) == 6


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


def test_views_meet_faults_of_any_severity_but_the_worst_and_any_light() -> None:
    recipe = RECIPES["full"]
    drawn = drawn_views(recipe, 400, TRAIN_SEEDS)
    faults = [faults_of(view.faults) for view in drawn]
    assert np.mean([bool(each) for each in faults]) == pytest.approx(recipe.faulty, abs=0.08)
    met = {(fault.kind, fault.severity) for each in faults for fault in each}
    assert met == {(kind, n) for kind in FAULTS for n in range(1, WORST + 1)}
    assert {view.light for view in drawn} == set(recipe.lights)
    # Darkness comes with other faults too, never with a light of another name.
    assert any(len(each) == 2 for each in faults)
    assert all(view.light == "day" for view, each in zip(drawn, faults, strict=True) if each)
    for view in drawn[:40]:
        view.sensing()


def test_without_faults_views_are_drawn_as_ever() -> None:
    clear = replace(RECIPES["full"], faulty=0.0, lights=("day",))
    plain = drawn_views(clear, 60, TRAIN_SEEDS)
    assert {(view.light, view.faults) for view in plain} == {("day", "clear")}
    faulty = drawn_views(replace(clear, faulty=1.0), 60, TRAIN_SEEDS)
    same = [replace(view, weather="clear", faults="clear") for view in faulty]
    assert same == [replace(view, weather="clear") for view in plain]


@pytest.mark.parametrize("name", RECIPES)
def test_what_is_held_out_is_scored_and_never_learned(name: str) -> None:
    recipe = RECIPES[name]
    learned = [view for part in _split(recipe) for view in part]
    assert not {view.scenario for view in learned} & set(LOOKS)
    assert not {view.faults for view in learned} & set(HELD_OUT_FAULTS)
    apart = held_out(recipe)
    assert {view.scenario for view in apart["held_out_looks"]} <= set(LOOKS)
    assert {view.faults for view in apart["held_out_faults"]} <= set(HELD_OUT_FAULTS)
    for section in ("test", "test_clear_days"):
        assert {view.seed for view in apart[section]} <= set(TEST_SEEDS)
    assert not {view.seed for view in learned} & set(TEST_SEEDS)
    # A fault of severity 4 brings the weather of that severity.
    met = {view.weather for view in learned}
    met |= {part.strip().replace(":", "-") for v in learned for part in v.faults.split("+")}
    assert not met & {view.weather for view in apart["held_out_weathers"]}
    with pytest.raises(ValueError, match="scenarios unseen-street are held out"):
        _split(replace(recipe, scenarios=("street", "unseen-street")))


def test_a_view_is_rendered_with_its_light_and_faults() -> None:
    view = View("two-way", 3, images=1, faults="night:4 + rain:2")
    dark = render(view).pixels.mean()
    assert dark < 0.6 * render(replace(view, faults="clear")).pixels.mean()
    assert view.sensing().weather.name == "rain-2"
