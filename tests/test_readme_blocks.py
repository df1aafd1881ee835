"""Every block of Python in the README, run as it is printed."""

import ast
import re
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

README = Path(__file__).parents[1] / "README.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```", README.read_text(), re.DOTALL | re.MULTILINE)


@cache
def values(block: str) -> list[Any]:
    """Run a block in a module of its own; return what its bare expressions are worth."""
    names: dict[str, Any] = {"__name__": "printed"}
    found = []
    for statement in ast.parse(block).body:
        if isinstance(statement, ast.Expr):
            code = compile(ast.Expression(statement.value), str(README), "eval")
            found.append(eval(code, names))
        else:
            exec(compile(ast.Module([statement], []), str(README), "exec"), names)
    for made in names.values():
        if isinstance(made, gym.Env):
            made.close()
    return found


def block(word: str) -> str:
    (found,) = [each for each in BLOCKS if word in each]
    return found


def test_all_blocks_are_found() -> None:
    assert len(BLOCKS) == README.read_text().count("```python")
    assert len(BLOCKS) >= 5


@pytest.mark.sampled(1)
@pytest.mark.parametrize("printed", BLOCKS, ids=[each.splitlines()[0] for each in BLOCKS])
def test_it_runs(printed: str) -> None:
    values(printed)


def test_the_environment_tells_what_is_said() -> None:
    ranges, (frames, truths), truth = values(block("lidar_range"))
    assert ranges.dtype == "float32"
    assert ranges.shape[0] == 16
    assert len(frames) == len(truths)
    assert truth


def test_the_pose_is_the_one_that_is_said() -> None:
    (pose,) = values(block("fit_single"))
    said = re.search(r"# x ([\d.]+), y ([\d.]+), yaw ([\d.]+)$", block("fit_single"), re.MULTILINE)
    assert said is not None
    assert (*pose.centre, pose.yaw) == pytest.approx(tuple(map(float, said.groups())), abs=0.05)


def test_the_curve_has_the_length_that_is_said() -> None:
    (curve,) = values(block("hota(sequence)"))
    assert curve.shape == (19,)
