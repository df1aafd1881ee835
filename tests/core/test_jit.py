"""Machine code is kept between processes, and nothing breaks where it cannot be."""

from __future__ import annotations

import ast
import inspect
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import pytest

import roadscope
from roadscope.core import compiled, sources_of
from roadscope.envs.raycast import cast_all
from roadscope.envs.sensors import sweep
from roadscope.envs.traffic import record

HOUSE = Path(roadscope.__file__).parent

KERNELS = """
from roadscope.core import compiled

@compiled()
def double(x):
    return 2 * x + {constant}

if __name__ == "__main__":
    value = double(4)
    stats = double.entry().stats
    print(value, sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""


def run(script: Path, **environment: str) -> list[int]:
    """Run the script in a process of its own; its result, cache hits and cache misses."""
    result = subprocess.run(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return [int(word) for word in result.stdout.split()]


CAST = """
import numpy as np
from roadscope.core import Pose
from roadscope.envs.raycast import Scene, cast_all
from roadscope.envs.sensors import SPECS, sweep
from roadscope.envs.world import Prisms

scene = Scene.still(Prisms.empty(), Prisms.empty(), np.empty((0, 3)))
scan, _ = sweep(scene, SPECS["vlp16"], [Pose.planar(0, 0, 0, 1)], 0.0, rng=np.random.default_rng(0))
stats = cast_all.entry().stats
print(len(scan), sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""


@pytest.mark.slow
def test_second_process_does_not_compile_the_caster(tmp_path: Path) -> None:
    path = tmp_path / "cast.py"
    path.write_text(CAST)
    run(path)
    returns, hits, misses = run(path)
    assert returns > 0
    assert (hits, misses) == (1, 0)


@pytest.fixture
def script(tmp_path: Path) -> Path:
    path = tmp_path / "some_kernels.py"
    path.write_text(KERNELS.format(constant=0))
    return path


def test_second_process_does_not_compile(script: Path) -> None:
    assert run(script) == [8, 0, 1]
    assert run(script) == [8, 1, 0]


@pytest.mark.slow
def test_any_source_of_the_folder_makes_the_code_stale(script: Path) -> None:
    assert run(script) == [8, 0, 1]
    (script.parent / "other.py").write_text("WIDTH = 16\\n")
    assert run(script) == [8, 0, 1]
    assert run(script) == [8, 1, 0]


PARTS = """
from roadscope.core import compiled

OFFSET = {offset}

@compiled(borrowing=True)
def scaled(x):
    return {factor} * x
"""
USER = """
from roadscope.core import compiled
from parts import OFFSET, scaled

@compiled()
def twice(x):
    return scaled(x) + scaled(x) + OFFSET

if __name__ == "__main__":
    value = twice(4)
    stats = twice.entry().stats
    print(value, sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""


@pytest.mark.slow
def test_an_edited_part_or_constant_of_another_file_is_compiled_anew(tmp_path: Path) -> None:
    parts, user = tmp_path / "parts.py", tmp_path / "user.py"
    user.write_text(USER)
    for offset, factor, expected in ((0, 1, 8), (0, 3, 24), (5, 3, 29)):
        parts.write_text(PARTS.format(offset=offset, factor=factor))
        # Time stamps tell nothing; Python itself would go by them.
        os.utime(parts, (1e9, 1e9))
        assert run(user, PYTHONDONTWRITEBYTECODE="1") == [expected, 0, 1]
        assert run(user, PYTHONDONTWRITEBYTECODE="1") == [expected, 1, 0]


@pytest.mark.slow
def test_a_part_has_no_machine_code_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(PARTS.format(offset=0, factor=1))
    (tmp_path / "user.py").write_text(USER)
    assert run(tmp_path / "user.py") == [8, 0, 1]
    assert [path.name.split("-")[0] for path in tmp_path.rglob("*.nbi")] == ["user.twice"]


def test_a_part_can_be_called_from_python_too() -> None:
    assert compiled(borrowing=True)(_plus_one)(2.0) == 3.0


@pytest.mark.slow
def test_folders_that_cannot_be_written_cost_only_time(script: Path, tmp_path: Path) -> None:
    # A plain file where a folder should be stops even the superuser.
    shutil.rmtree(tmp_path / "__pycache__", ignore_errors=True)
    (tmp_path / "__pycache__").write_text("in the way")
    blocked = str(tmp_path / "__pycache__" / "deeper")
    for _ in range(2):
        result = run(
            script,
            HOME=blocked,
            XDG_CACHE_HOME=blocked,
            IPYTHONDIR=blocked,
            PYTHONDONTWRITEBYTECODE="1",
        )
        assert result[0] == 8
        assert result[1] == 0


@pytest.mark.slow
def test_processes_that_start_together_all_get_the_result(script: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(run, [script] * 4))
    # One of them compiles, and the others wait for it.
    assert sorted(results) == [[8, 0, 1], [8, 1, 0], [8, 1, 0], [8, 1, 0]]


@pytest.mark.slow
def test_a_folder_that_the_user_names_is_used(script: Path, tmp_path: Path) -> None:
    named = tmp_path / "machine code"
    assert run(script, NUMBA_CACHE_DIR=str(named)) == [8, 0, 1]
    assert list(named.rglob("*.nbi"))
    assert run(script, NUMBA_CACHE_DIR=str(named)) == [8, 1, 0]
    assert run(script) == [8, 0, 1]


@pytest.mark.slow
def test_a_source_that_cannot_be_written_beside_uses_the_users_folder(
    script: Path, tmp_path: Path
) -> None:
    shutil.rmtree(tmp_path / "__pycache__", ignore_errors=True)
    (tmp_path / "__pycache__").write_text("in the way")
    home = {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "home")}
    assert run(script, PYTHONDONTWRITEBYTECODE="1", **home) == [8, 0, 1]
    assert run(script, PYTHONDONTWRITEBYTECODE="1", **home) == [8, 1, 0]


def test_others_kernels_are_cached_where_they_were_before() -> None:
    before = numba.config.CACHE_DIR
    assert compiled()(_plus_one)(1.0) == 2.0
    assert before == numba.config.CACHE_DIR


def _plus_one(x: float) -> float:
    return x + 1


HANG = """
import os, time
from numba.extending import overload

def dawdle():
    pass

@overload(dawdle)
def _dawdle():
    if os.environ.get("HANG"):
        print("compiling", flush=True)
        time.sleep(60)
    return lambda: None
"""


@pytest.mark.slow
def test_a_process_killed_while_it_compiles_delays_no_other(script: Path) -> None:
    source = KERNELS.format(constant=0).replace("    return", "    dawdle()\n    return", 1)
    script.write_text(HANG + source)
    first = subprocess.Popen(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "HANG": "yes"},
        stdout=subprocess.PIPE,
    )
    with first:
        assert first.stdout is not None
        assert first.stdout.readline() == b"compiling\n"
        first.kill()
    assert run(script) == [8, 0, 1]


def _kernels() -> dict[str, set[str]]:
    """By module that compiles anything, what others can use of it in their kernels."""
    kernels_of_modules = {}
    for path in HOUSE.rglob("*.py"):
        text = path.read_text("utf-8")
        tree = ast.parse(text if "@compiled(" in text else "")
        made = {
            node.name
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef)
            and any("compiled(" in ast.unparse(d) for d in node.decorator_list)
        }
        if made:
            kernels_of_modules[".".join(path.relative_to(HOUSE.parent).with_suffix("").parts)] = (
                made
            )
    return kernels_of_modules


def test_kernels_are_tied_to_the_files_of_all_kernels_and_constants_they_use() -> None:
    kernels, used, loose = _kernels(), 0, []
    for module in kernels:
        path = _path_of(module)
        tied = sources_of(path)
        assert {path, Path(inspect.getfile(compiled))} <= tied
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("roadscope"):
                used += 1
                if _path_of(node.module or "") not in tied:
                    loose.append(f"{module}: {node.module}")
    assert not loose
    assert used > 50


def test_what_is_imported_is_followed_from_file_to_file() -> None:
    lidar, kernels, traffic = (
        Path(inspect.getfile(inspect.unwrap(each))) for each in (sweep, cast_all, record)
    )
    assert kernels in sources_of(lidar)
    assert traffic not in sources_of(lidar)


def _path_of(module: str) -> Path:
    path = HOUSE.parent.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
