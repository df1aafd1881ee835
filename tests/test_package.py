import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import roadscope

HEAVY = ("torch", "scipy.stats", "highway_env", "matplotlib", "numba", "sklearn", "gymnasium")


def loaded_by(statement: str) -> set[str]:
    code = f"{statement}\nimport sys\nprint(*sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return set(result.stdout.split())


def test_importing_the_package_is_light() -> None:
    assert loaded_by("import roadscope").isdisjoint(HEAVY)


@pytest.mark.parametrize("room", ["core", "detectors", "trackers", "envs", "benchmarks"])
def test_importing_a_room_loads_nothing_heavy(room: str) -> None:
    heavy = set(HEAVY) - {"gymnasium"}
    assert loaded_by(f"import roadscope.{room}").isdisjoint(heavy)


def test_the_version_is_the_installed_one() -> None:
    assert version("roadscope") == roadscope.__version__


def test_the_package_is_typed_and_states_its_licence() -> None:
    root = Path(roadscope.__file__).parent
    assert (root / "py.typed").exists()
    assert "MIT License" in (root.parent / "LICENSE").read_text()
