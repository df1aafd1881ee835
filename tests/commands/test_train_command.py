"""`roadscope train`."""

import re

from roadscope.benchmarks.train import DriverRecipe


def test_the_defaults_of_a_driver_are_those_of_its_recipe(answer) -> None:
    text = " ".join(answer("train", "driver", "--help")[1].split())
    recipe = DriverRecipe()
    for option in ("steps", "teacher", "duration_s", "rig", "seed"):
        shown = "seconds" if option == "duration_s" else option
        assert re.search(rf"--{shown} [^\[]*\[default: {getattr(recipe, option)}\]", text)


def test_wrong_names_are_answered_before_anything_is_trained(answer, tmp_path) -> None:
    out = tmp_path / "mine"
    for option, name in (
        ("--scenario", "mergge"),
        ("--perception", "lidar"),
        ("--start", "me"),
        ("--teacher", "nobody"),
        ("--rig", "lxu"),
    ):
        status, _, errors = answer("train", "driver", option, name, "--out", str(out))
        assert status == 1
        assert name in errors
    status, _, errors = answer("train", "driver", "--teacher", "", "--out", str(out))
    assert (status, "without a teacher" in errors) == (1, True)
    assert not list(tmp_path.iterdir())
    assert answer("train", "nothing")[0] == 2
