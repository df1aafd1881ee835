"""Runs that many tests look at."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.torture.boards import Run, Workshop, workshop


@pytest.fixture(scope="session")
def honest_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Workshop, Run]:
    """Run the suite without strangers."""
    made = workshop(tmp_path_factory.mktemp("honest") / "run")
    return made, made.run([], jobs=1)


@pytest.fixture
def new_workshop(tmp_path: Path, honest_run: tuple[Workshop, Run]) -> Callable[[str], Workshop]:
    """Return a function that makes the folders of a run, with its traffic."""
    return lambda name="run": workshop(tmp_path / name, honest_run[0].cache)
