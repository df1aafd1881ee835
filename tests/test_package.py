"""What imports load and cost."""

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import roadscope

HEAVY = {"torch", "scipy.stats", "highway_env", "matplotlib", "numba", "sklearn"}
BY_COMMANDS_ONLY = {"gymnasium", "numpy", "scipy", "joblib", "roadscope.core"} | HEAVY
ROOMS = ("core", "detectors", "trackers", "odometry", "fusion", "envs", "benchmarks")
MODULES = (*ROOMS, "metrics", "formats")
SCRIPT = """
import sys
from roadscope.__main__ import main
if __name__ == "__main__":
    sys.exit(main())
"""
"""What pip writes as the command `roadscope`."""
STANDARD = sys.stdlib_module_names | {"nt", "__main__"}
"""Packages of Python itself, of other systems too."""


def loaded_by(*arguments: str) -> set[str]:
    """Return the modules that Python imports when started so."""
    listed = {**os.environ, "PYTHONPROFILEIMPORTTIME": "1"}
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=True, env=listed
    )
    lines = done.stderr.splitlines()
    return {line.rpartition("|")[2].strip() for line in lines if line.startswith("import time:")}


def loaded_beyond(one: list[str], other: list[str]) -> tuple[set[str], set[str]]:
    """Return what one Python process imports and another does not: our modules, those of others.

    The standard library's modules are not counted, as most of them cost little.
    """
    beyond = loaded_by(*one) - loaded_by(*other)
    ours = {name for name in beyond if name.split(".")[0] == "roadscope"}
    others = {name for name in beyond - ours if name.split(".")[0] not in STANDARD}
    return ours, others


@pytest.fixture(params=["module", "script"])
def start(request: pytest.FixtureRequest, tmp_path: Path) -> list[str]:
    """Both ways to start the command line."""
    if request.param == "module":
        return ["-m", "roadscope"]
    script = tmp_path / "roadscope"
    script.write_text(SCRIPT)
    return [str(script)]


def test_importing_the_package_is_light() -> None:
    loaded = loaded_by("-c", "import roadscope")
    assert "gymnasium" in loaded
    assert loaded.isdisjoint(HEAVY)


def test_importing_the_package_loads_nothing_beyond_gymnasium() -> None:
    # Modules are counted, as times vary too much on a busy machine: 1.04 times on a quiet one.
    ours, others = loaded_beyond(["-c", "import roadscope"], ["-c", "import gymnasium"])
    assert 0 < len(ours) < 10
    assert {name.split(".")[0] for name in others} <= {"gymnasium"}


def test_importing_the_rooms_loads_nothing_heavy() -> None:
    rooms = "; ".join(f"import roadscope.{module}" for module in MODULES)
    assert loaded_by("-c", rooms).isdisjoint(HEAVY)


def test_boards_load_no_library_of_traffic_before_traffic_is_made() -> None:
    """highway-env brings Matplotlib and pandas: half of the time in which a worker starts."""
    loaded = loaded_by("-c", "from roadscope.benchmarks.boards import BOARDS; len(BOARDS)")
    assert "roadscope.benchmarks.boards.driving" in loaded
    assert loaded.isdisjoint({"highway_env", "matplotlib", "pandas"})


@pytest.mark.parametrize("arguments", [["--help"], ["leaderboard", "--help"], ["--version"]])
def test_help_loads_neither_gymnasium_nor_numpy(start: list[str], arguments: list[str]) -> None:
    loaded = loaded_by(*start, *arguments)
    assert "typer" in loaded
    assert loaded.isdisjoint(BY_COMMANDS_ONLY)


def test_options_of_python_before_the_module_change_nothing() -> None:
    for options in (["-W", "error", "-m", "roadscope"], ["-X", "utf8", "-mroadscope"]):
        assert loaded_by(*options, "--help").isdisjoint(BY_COMMANDS_ONLY)
    assert "gymnasium" in loaded_by("-m", "roadscope._lazy")


def test_help_loads_nothing_beyond_typer(start: list[str]) -> None:
    # On a quiet machine 1.3 times as long, where typer takes 0.05 s; help that rich draws 2.7.
    ours, others = loaded_beyond([*start, "--help"], ["-c", "import typer"])
    assert 0 < len(ours) < 10
    assert {name.split(".")[0] for name in others} <= {"typer"}


def test_the_version_is_the_installed_one() -> None:
    assert version("roadscope") == roadscope.__version__


def test_the_package_is_typed_and_states_its_licence() -> None:
    root = Path(roadscope.__file__).parent
    assert (root / "py.typed").exists()
    assert "MIT License" in (root.parent / "LICENSE").read_text()
