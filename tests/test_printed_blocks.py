"""Every block of Python in the README and on the pages of the site, run as it is printed."""

import ast
import re
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
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
    results = []
    for statement in ast.parse(block).body:
        if isinstance(statement, ast.Expr):
            code = compile(ast.Expression(statement.value), "printed", "eval")
            results.append(eval(code, names))
        else:
            exec(compile(ast.Module([statement], []), "printed", "exec"), names)
    for made in names.values():
        if isinstance(made, gym.Env):
            made.close()
    return results


def block(word: str) -> str:
    (matching_block,) = [each for each in BLOCKS if word in each]
    return matching_block


def test_all_blocks_are_found() -> None:
    printed = sum(page.read_text().count("```python") for page in PAGES)
    assert 10 <= len(BLOCKS) <= printed


@pytest.mark.sampled(1)
@pytest.mark.parametrize("printed", BLOCKS, ids=BLOCKS.get)
def test_it_runs(printed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if "stable_baselines3" in printed:
        pytest.importorskip("stable_baselines3")
    monkeypatch.chdir(ROOT)
    values(printed)


def test_the_environment_shows_what_is_printed() -> None:
    ranges, (frames, truths), truth = values(block('observation["lidar_range"]'))
    assert ranges.dtype == "float32"
    assert ranges.shape[0] == 16
    assert len(frames) == len(truths)
    assert truth


def test_a_batch_has_the_shape_that_is_said() -> None:
    ranges, _ = values(block("make_vec"))
    assert ranges.shape[:2] == (8, 16)


def test_the_pose_is_the_one_that_is_said() -> None:
    (pose,) = values(block("fit_single"))
    match = re.search(r"# x ([\d.]+), y ([\d.]+), yaw ([\d.]+)$", block("fit_single"), re.MULTILINE)
    assert match is not None
    assert (*pose.centre, pose.yaw) == pytest.approx(tuple(map(float, match.groups())), abs=0.05)


@pytest.mark.slow
def test_scans_of_a_folder_get_tracks(tmp_path: Path) -> None:
    env = gym.make("roadscope:roadscope/Roundabout-v0", rig="vlp16", ego="idm")
    env.reset(seed=10000)
    frames = [frame for _ in range(16) for frame in env.step(0)[4]["frames"]][:15]
    env.close()
    for number, frame in enumerate(frames):
        scan = np.column_stack([frame.lidar.points, frame.lidar.intensity])
        scan.tofile(tmp_path / f"{number:06d}.bin")
    names: dict[str, Any] = {}
    exec(block("def tracks_of"), names)
    tracks = list(names["tracks_of"](tmp_path, 1.9))
    assert len(tracks) == 15
    assert {each.frame for each in tracks} == {"world"}
    assert len(set(tracks[-1].ids) & set(tracks[-3].ids)) >= 3


def test_the_curve_has_the_length_that_is_said() -> None:
    (curve,) = values(block("hota(sequence)"))
    assert curve.shape == (19,)
