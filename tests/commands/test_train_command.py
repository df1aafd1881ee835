"""`roadscope train`."""

import re

import pytest

from roadscope.benchmarks.train import DriverRecipe


def test_the_defaults_of_a_driver_are_those_of_its_recipe(answer) -> None:
    text = " ".join(answer("train", "driver", "--help")[1].split())
    recipe = DriverRecipe()
    for option in ("steps", "teacher", "duration_s", "rig", "seed"):
        shown = "seconds" if option == "duration_s" else option
        assert re.search(rf"--{shown} [^\[]*\[default: {getattr(recipe, option)}\]", text)


def test_wrong_names_are_answered_before_anything_is_trained(answer, tmp_path) -> None:
    out = tmp_path / "mine"
    for option, name in (("--scenario", "mergge"), ("--perception", "lidar"), ("--start", "me")):
        status, _, errors = answer("train", "driver", option, name, "--out", str(out))
        assert status == 1
        assert name in errors
    assert not list(tmp_path.iterdir())
    assert answer("train", "nothing")[0] == 2


@pytest.mark.slow
def test_a_driver_is_trained_on_several_perceptions(answer, tmp_path) -> None:
    pytest.importorskip("stable_baselines3")
    options = "--perception truth --perception blind --scenario merge --steps 1024 --seconds 3"
    out = tmp_path / "mine.safetensors"
    status, text, _ = answer(
        "train", "driver", *options.split(), "--teacher", "", "--rig", "lux", "--out", str(out)
    )
    assert status == 0
    assert "on truth: reward" in text
    assert "on blind: reward" in text
    assert f"learned?weights={out}" in text
    assert out.is_file()
