"""Mutants are drawn, found again in another checkout, and judged by real test runs."""

from pathlib import Path

import pytest

from research.mutation import AREAS, Mutant, drawn, located, verdict

CODE = """
class Pair:
    def size(self) -> int:
        return 1 + 1


def size() -> int:
    return 1 + 1
"""
TEST = """
from roadscope.core.sizes import size

def test_size() -> None:
    assert size() == 2
"""
OF_FUNCTION = Mutant("core", "plus", "size", "    return 1 + 1", "    return 1 - 1", 0)
OF_METHOD = Mutant("core", "plus", "Pair.size", "        return 1 + 1", "        return 1 - 1", 0)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    for path, text in (("roadscope/core/sizes.py", CODE), ("tests/core/test_sizes.py", TEST)):
        (tmp_path / path).parent.mkdir(parents=True)
        (tmp_path / path).write_text(text)
    for package in ("roadscope", "roadscope/core"):
        (tmp_path / package / "__init__.py").touch()
    return tmp_path


def test_a_line_is_found_in_its_function_wherever_the_file_is(checkout: Path) -> None:
    assert located(checkout, OF_FUNCTION) == (checkout / "roadscope/core/sizes.py", 7)
    (checkout / "roadscope/core/sizes.py").rename(checkout / "roadscope/merged.py")
    assert located(checkout, OF_METHOD) == (checkout / "roadscope/merged.py", 3)
    assert located(checkout, OF_METHOD._replace(function="Pair.length")) is None


@pytest.mark.slow
def test_tests_decide_and_the_file_stays_as_it_was(checkout: Path) -> None:
    verdicts = [verdict(checkout, mutant) for mutant in (OF_FUNCTION, OF_METHOD)]
    assert verdicts == ["killed", "survived"]
    assert (checkout / "roadscope/core/sizes.py").read_text() == CODE


def test_the_same_seed_draws_the_same_lines(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("cosmic_ray")
    monkeypatch.setattr("research.mutation.AREAS", {"core": AREAS["core"]})
    mutants = drawn(checkout, 2, 1)
    assert len({mutant.function for mutant in mutants}) == 2
    assert mutants == drawn(checkout, 2, 1)
    assert all(located(checkout, mutant) for mutant in mutants)
