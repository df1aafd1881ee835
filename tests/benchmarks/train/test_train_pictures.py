from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from roadscope.benchmarks.metrics import PARKED
from roadscope.benchmarks.train import (
    CALIBRATION_SEEDS,
    FAULTS,
    GREATEST_SEVERITY,
    HELD_OUT_BODIES,
    HELD_OUT_FAULTS,
    RECIPES,
    TEST_SEEDS,
    TRAIN_SEEDS,
    PictureEpisode,
    Recipe,
    draw_episodes,
    held_out_episodes,
    read_pictures,
    render,
    split_episodes,
    store_pictures,
)
from roadscope.core import RecordError
from roadscope.envs.sensors import faults_of, weather


def test_rendered_pictures_are_stored(tmp_path: Path) -> None:
    episode = PictureEpisode("two-way", 3, "fog-2", images=2, focal_px=500.0, height_m=1.7)
    made = render(episode)
    first = store_pictures(episode, tmp_path)
    written = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert store_pictures(episode, tmp_path) == first
    assert written == {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    again = read_pictures(episode, tmp_path)
    np.testing.assert_array_equal(again.pixels, made.pixels)
    air = weather("fog-2").extinction_per_m
    assert again.labels == tuple(label.in_air(air) for label in made.labels)
    assert made.pixels.shape == (2, 480, 640, 3)
    assert any(label.eligible.any() for label in made.labels)
    # The style of this road has parked cars.
    assert any((label.categories == PARKED).any() for label in made.labels)


def test_views_have_names_of_their_own() -> None:
    episode = PictureEpisode("street", 1)
    other = [
        replace(episode, seed=2),
        replace(episode, weather="fog-1"),
        replace(episode, focal_px=500.0),
    ]
    other += [replace(episode, light="dusk"), replace(episode, faults="night:2")]
    assert len({v.name for v in [episode, *other]}) == 6


def test_drawn_views_stay_within_their_seeds_and_repeat() -> None:
    recipe = RECIPES["full"]
    drawn = draw_episodes(recipe, 60, TRAIN_SEEDS)
    assert drawn == draw_episodes(recipe, 60, TRAIN_SEEDS)
    assert all(v.seed in TRAIN_SEEDS for v in drawn)
    assert {v.scenario for v in drawn} == set(recipe.scenarios)
    assert not {v.seed for v in drawn} & set(CALIBRATION_SEEDS)
    plain = draw_episodes(recipe, 20, TRAIN_SEEDS, varied=False)
    assert {v.focal_px for v in plain} == {None}


def test_recipes_without_steps_are_refused() -> None:
    with pytest.raises(RecordError, match=r"Recipe\.steps: expected at least 1, got 0"):
        Recipe(steps=0)


def test_views_meet_faults_of_any_severity_but_the_worst_and_any_light() -> None:
    recipe = RECIPES["full"]
    drawn = draw_episodes(recipe, 400, TRAIN_SEEDS)
    faults = [faults_of(episode.faults) for episode in drawn]
    assert np.mean([bool(each) for each in faults]) == pytest.approx(recipe.faulty, abs=0.08)
    drawn_faults = {(fault.kind, fault.severity) for each in faults for fault in each}
    assert drawn_faults == {(kind, n) for kind in FAULTS for n in range(1, GREATEST_SEVERITY + 1)}
    assert {episode.light for episode in drawn} == set(recipe.lights)
    # Darkness comes with other faults too, never with a light of another name.
    assert any(len(each) == 2 for each in faults)
    assert all(episode.light == "day" for episode, each in zip(drawn, faults, strict=True) if each)
    for episode in drawn[:40]:
        episode.sensing()


def test_without_faults_views_are_drawn_as_ever() -> None:
    clear = replace(RECIPES["full"], faulty=0.0, lights=("day",))
    plain = draw_episodes(clear, 60, TRAIN_SEEDS)
    assert {(episode.light, episode.faults) for episode in plain} == {("day", "clear")}
    faulty = draw_episodes(replace(clear, faulty=1.0), 60, TRAIN_SEEDS)
    same = [replace(episode, weather="clear", faults="clear") for episode in faulty]
    assert same == [replace(episode, weather="clear") for episode in plain]


@pytest.mark.parametrize("name", RECIPES)
def test_what_is_held_out_is_scored_and_never_learned(name: str) -> None:
    recipe = RECIPES[name]
    learned = [episode for part in split_episodes(recipe) for episode in part]
    assert not {episode.scenario for episode in learned} & set(HELD_OUT_BODIES)
    assert not {episode.faults for episode in learned} & set(HELD_OUT_FAULTS)
    held_out = held_out_episodes(recipe)
    assert {episode.scenario for episode in held_out["held_out_looks"]} <= set(HELD_OUT_BODIES)
    assert {episode.faults for episode in held_out["held_out_faults"]} <= set(HELD_OUT_FAULTS)
    for section in ("test", "test_clear_days"):
        assert {episode.seed for episode in held_out[section]} <= set(TEST_SEEDS)
    assert not {episode.seed for episode in learned} & set(TEST_SEEDS)
    # A fault of severity 4 brings the weather of that severity.
    weathers = {episode.weather for episode in learned}
    weathers |= {part.strip().replace(":", "-") for v in learned for part in v.faults.split("+")}
    assert not weathers & {episode.weather for episode in held_out["held_out_weathers"]}
    with pytest.raises(ValueError, match="scenarios unseen-street are held out"):
        split_episodes(replace(recipe, scenarios=("street", "unseen-street")))


@pytest.mark.slow
def test_a_view_is_rendered_with_its_light_and_faults() -> None:
    episode = PictureEpisode("two-way", 3, images=1, faults="night:4 + rain:2")
    dark = render(episode).pixels.mean()
    assert dark < 0.6 * render(replace(episode, faults="clear")).pixels.mean()
    assert episode.sensing().weather.name == "rain-2"
