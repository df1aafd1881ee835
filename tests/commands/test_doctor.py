import json
import os
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

import roadscope
from roadscope.benchmarks.isolation import sandbox_available


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def diagnose(answer: Callable[..., tuple[int, str, str]]) -> Callable[[], dict[str, Any]]:
    """Return what the command says as JSON."""

    def run() -> dict[str, Any]:
        status, out, _ = answer("doctor", "--json")
        table: dict[str, Any] = json.loads(out)
        assert status == bool(table["broken"])
        return table

    return run


def test_this_installation_is_sound(cache: Path, diagnose) -> None:
    table = diagnose()
    assert not table["broken"]
    assert table["versions"]["roadscope"] == roadscope.__version__
    assert table["versions"]["numpy"] == metadata.version("numpy")
    assert table["machine"]["cores"] >= 1
    assert table["cache"]["path"] == str(cache)
    assert not cache.exists()


def test_extras_are_those_of_the_metadata(diagnose) -> None:
    extras = {extra["name"]: extra for extra in diagnose()["extras"]}
    assert set(extras) == set(metadata.metadata("roadscope").get_all("Provides-Extra") or [])
    for name, extra in extras.items():
        assert f"roadscope[{name}]" in extra["command"]
        for text in extra["missing"]:
            assert any(text.partition(">")[0] in each for each in metadata.requires("roadscope"))
    # The tests' own requirements are there, else they would not run.
    assert not any(text.startswith("pytest>") for text in extras["test"]["missing"])


def test_json(diagnose) -> None:
    table = diagnose()
    assert table["kernels"]["folder"]["path"]
    assert isinstance(table["isolation"]["complete"], bool)
    assert table["isolation"]["complete"] == all(table["isolation"]["parts"].values())


def test_text(answer) -> None:
    status, output, _ = answer("doctor")
    assert status == 0
    for words in ("numpy", "cores", "kernels", "bubblewrap"):
        assert words in output
    assert answer("doctor", "--quiet") == (0, "", "")


def test_a_cache_that_cannot_be_written_is_broken(monkeypatch, answer, diagnose) -> None:
    monkeypatch.setenv("ROADSCOPE_CACHE", "/proc/no/such/folder")
    status, out, _ = answer("doctor")
    assert status == 1
    assert "/proc/no/such/folder" in out
    status, out, errors = answer("doctor", "--quiet")
    assert (status, out, errors.count("\n")) == (1, "", 1)
    assert "/proc/no/such/folder" in errors
    assert not diagnose()["cache"]["writable"]


def test_a_damaged_database_is_broken(cache: Path, diagnose) -> None:
    cache.mkdir()
    (cache / "results.sqlite").write_bytes(b"garbage" * 1000)
    (reason,) = diagnose()["broken"]
    assert "results.sqlite" in reason


def test_kernels_are_stored_in_the_folder_set_for_numba(
    tmp_path: Path, monkeypatch, diagnose
) -> None:
    place = tmp_path / "kernels"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(place))
    none = diagnose()
    assert (none["kernels"]["cached"], none["kernels"]["folder"]["path"]) == (0, str(place))
    assert any("compile" in text for text in none["warnings"])
    (place / "sub").mkdir(parents=True)
    (place / "sub" / "a.nbc").write_bytes(b"12345")
    kernels = diagnose()["kernels"]
    assert (kernels["cached"], kernels["size_bytes"]) == (1, 5)


def test_a_missing_sandbox_is_named_and_breaks_nothing(monkeypatch, diagnose) -> None:
    monkeypatch.setenv("PATH", os.devnull)
    sandbox_available.cache_clear()
    table = diagnose()
    sandbox_available.cache_clear()
    assert not table["isolation"]["sandbox"]
    assert "bubblewrap" in table["isolation"]["sandbox_reason"]
    assert not table["broken"]
