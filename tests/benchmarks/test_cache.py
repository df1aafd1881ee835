import warnings
from pathlib import Path

import pytest

from roadscope.benchmarks import cache
from roadscope.core import RecordError


def test_the_variable_names_the_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv(cache.ENVIRONMENT_VARIABLE, str(tmp_path / "a" / "b"))
    assert cache.cache_dir() == tmp_path / "a" / "b"
    assert cache.cache_dir().is_dir()


def test_without_it_the_users_cache_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.delenv(cache.ENVIRONMENT_VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    assert tmp_path in cache.cache_dir().parents


def test_where_nothing_can_be_written_a_temporary_folder_serves(tmp_path, monkeypatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    monkeypatch.setenv(cache.ENVIRONMENT_VARIABLE, str(blocked / "cache"))
    with pytest.warns(UserWarning, match="cannot write to"):
        spare = cache.cache_dir()
    assert spare.is_dir()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cache.cache_dir() == spare


class Text(str):
    def save(self, path: Path) -> None:
        path.write_text(self)

    @staticmethod
    def load(path: Path) -> "Text":
        if "half" in path.read_text():
            raise RecordError("half a file")
        return Text(path.read_text())


def test_what_is_kept_is_made_once_and_again_where_it_is_damaged(tmp_path) -> None:
    path, made = tmp_path / "sub" / "file.txt", iter(map(Text, ("one", "two", "three")))
    assert cache.kept(path, Text.load, lambda: next(made)) == "one"
    assert cache.kept(path, Text.load, lambda: next(made)) == "one"
    path.write_text("half")
    assert cache.kept(path, Text.load, lambda: next(made)) == "two"
    assert cache.kept(path, Text.load, lambda: next(made), anew=True) == "three"
    assert path.read_text() == "three"


def test_a_write_that_fails_leaves_the_old_file(tmp_path) -> None:
    path = tmp_path / "sub" / "file.txt"
    cache.write_atomically(path, lambda p: _write(p, "old"))

    def fail(part: Path) -> None:
        _write(part, "half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        cache.write_atomically(path, fail)
    assert path.read_text() == "old"
    assert list(path.parent.iterdir()) == [path]


def _write(path: Path, text: str) -> None:
    path.write_text(text)


def test_what_is_written_can_be_read_by_whoever_may_read_other_files(tmp_path: Path) -> None:
    usual = tmp_path / "usual"
    usual.write_text("x")
    cache.write_atomically(tmp_path / "kept", lambda p: _write(p, "x"))
    assert (tmp_path / "kept").stat().st_mode == usual.stat().st_mode
