import json
import os
from importlib import metadata
from pathlib import Path

import pytest

import roadscope
from roadscope.benchmarks.doctor import doctor
from roadscope.benchmarks.isolation import sandbox_available


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_this_installation_is_sound(cache: Path) -> None:
    diagnosis = doctor()
    assert not diagnosis.broken
    assert diagnosis.versions["roadscope"] == roadscope.__version__
    assert diagnosis.versions["numpy"] == metadata.version("numpy")
    assert diagnosis.machine.cores >= 1
    assert diagnosis.cache.path == str(cache)
    assert not cache.exists()


def test_extras_are_those_of_the_metadata() -> None:
    extras = {extra.name: extra for extra in doctor().extras}
    assert set(extras) == set(metadata.metadata("roadscope").get_all("Provides-Extra") or [])
    for name, extra in extras.items():
        assert f"roadscope[{name}]" in extra.command
        for text in extra.missing:
            assert any(text.partition(">")[0] in each for each in metadata.requires("roadscope"))
    # The tests' own requirements are there, else they would not run.
    assert not any(text.startswith("pytest>") for text in extras["test"].missing)


def test_json(answer) -> None:
    status, out, _ = answer("doctor", "--json")
    assert status == 0
    table = json.loads(out)
    assert table["broken"] == []
    assert table["kernels"]["folder"]["path"]
    assert isinstance(table["isolation"]["complete"], bool)
    assert table["isolation"]["complete"] == all(table["isolation"]["parts"].values())


def test_text(answer) -> None:
    status, said, _ = answer("doctor")
    assert status == 0
    for words in ("numpy", "cores", "kernels", "bubblewrap"):
        assert words in said


def test_a_cache_that_cannot_be_written_is_broken(monkeypatch, answer) -> None:
    monkeypatch.setenv("ROADSCOPE_CACHE", "/proc/no/such/folder")
    status, out, _ = answer("doctor")
    assert status == 1
    assert "/proc/no/such/folder" in out
    assert not doctor().cache.writable


def test_a_damaged_database_is_broken(cache: Path) -> None:
    cache.mkdir()
    (cache / "results.sqlite").write_bytes(b"garbage" * 1000)
    (reason,) = doctor().broken
    assert "results.sqlite" in reason


def test_kernels_go_where_numba_is_told_to_put_them(tmp_path: Path, monkeypatch) -> None:
    place = tmp_path / "kernels"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(place))
    none = doctor()
    assert (none.kernels.cached, none.kernels.folder.path) == (0, str(place))
    assert any("compile" in text for text in none.warnings)
    (place / "sub").mkdir(parents=True)
    (place / "sub" / "a.nbc").write_bytes(b"12345")
    assert (doctor().kernels.cached, doctor().kernels.size_bytes) == (1, 5)


def test_a_missing_sandbox_is_named_and_breaks_nothing(monkeypatch) -> None:
    monkeypatch.setenv("PATH", os.devnull)
    sandbox_available.cache_clear()
    diagnosis = doctor()
    sandbox_available.cache_clear()
    assert not diagnosis.isolation.sandbox
    assert "bubblewrap" in diagnosis.isolation.sandbox_reason
    assert not diagnosis.broken
