"""Runs that many tests look at."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from roadscope.benchmarks import code_hash, package
from tests.torture.acts import pairs
from tests.torture.boards import SUITE, TortureRun, Workshop, workshop
from tests.torture.entries import Tortured, tortured


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that names acts for each of them and each board that its class does it on."""
    acts = getattr(metafunc.function, "acts", None)
    if acts is not None:
        cases = pairs(acts, metafunc.cls.jobs)
        ids = [f"{board}-{act.name}" for board, act in cases]
        metafunc.parametrize(("board", "act"), cases, ids=ids)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let all tests of this folder be slow; the hook gets those of other folders too."""
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def honest_run(
    tmp_path_factory: pytest.TempPathFactory, own_cache: Path
) -> tuple[Workshop, TortureRun]:
    """Run the suite without strangers.

    The index of sources is read or made anew, whatever other tests did in this process, so that it
    is kept in this run's cache, where other workshops take it from.
    """
    package.cache_clear()
    code_hash.cache_clear()
    made = workshop(tmp_path_factory.mktemp("honest") / "run")
    parsed = own_cache / "sources"
    if parsed.exists():
        shutil.copytree(parsed, made.cache / parsed.name)
    return made, made.run([], jobs=1)


@pytest.fixture(scope="class")
def torture(
    request: pytest.FixtureRequest,
    tmp_path_factory: pytest.TempPathFactory,
    honest_run: tuple[Workshop, TortureRun],
) -> Tortured:
    """Run the hostile acts of a class of tests."""
    folder = tmp_path_factory.mktemp("torture") / "run"
    return tortured(folder, honest_run[0].cache, jobs=request.cls.jobs)


@pytest.fixture
def new_workshop(
    tmp_path: Path, honest_run: tuple[Workshop, TortureRun]
) -> Callable[..., Workshop]:
    """Return a function that makes the folders of a run, with its traffic."""
    return lambda suite=SUITE: workshop(tmp_path / "run", honest_run[0].cache, suite)
