"""Every block of Python in the README and on the pages of the site, run as it is printed."""

import ast
import re
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCKS = {
    block: f"{page.stem}: {block.splitlines()[0]} {number}"
    for page in PAGES
    for number, block in enumerate(
        re.findall(r"^```python\n(.*?)^```", page.read_text(), re.S | re.M)
    )
}
"""Block: its name; one that is printed on several pages runs once."""


@cache
def values(block: str) -> list[Any]:
    """Run a block in a module of its own; return what its bare expressions are worth."""
    names: dict[str, Any] = {"__name__": "printed"}
    found = []
    for statement in ast.parse(block).body:
        if isinstance(statement, ast.Expr):
            code = compile(ast.Expression(statement.value), "printed", "eval")
            found.append(eval(code, names))
        else:
            exec(compile(ast.Module([statement], []), "printed", "exec"), names)
    for made in names.values():
        if isinstance(made, gym.Env):
            made.close()
    return found


def block(word: str) -> str:
    (found,) = [each for each in BLOCKS if word in each]
    return found


def test_all_blocks_are_found() -> None:
    printed = sum(page.read_text().count("```python") for page in PAGES)
    assert 10 <= len(BLOCKS) <= printed


@pytest.mark.sampled(1)
@pytest.mark.parametrize("printed", BLOCKS, ids=BLOCKS.get)
def test_it_runs(printed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
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
