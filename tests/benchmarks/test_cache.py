import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from roadscope.benchmarks import (
    cache_dir,
    digest_of,
    read_kept,
    read_or_make,
    write_atomically,
    write_kept,
)
from roadscope.core import RecordError


def test_the_variable_names_the_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "a" / "b"))
    assert cache_dir() == tmp_path / "a" / "b"
    assert cache_dir().is_dir()


def test_without_it_the_users_cache_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.delenv("ROADSCOPE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    assert tmp_path in cache_dir().parents


def test_where_nothing_can_be_written_a_temporary_folder_serves(tmp_path, monkeypatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    monkeypatch.setenv("ROADSCOPE_CACHE", str(blocked / "cache"))
    with pytest.warns(UserWarning, match="cannot write to"):
        spare = cache_dir()
    assert spare.is_dir()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cache_dir() == spare


class Text(str):
    def save(self, file: BinaryIO) -> None:
        file.write(self.encode())

    @staticmethod
    def load(file: BinaryIO) -> "Text":
        return Text(file.read().decode())


def test_cached_files_are_made_once_and_again_on_request(tmp_path: Path) -> None:
    path, made = tmp_path / "sub" / "file.cache", iter(map(Text, ("one", "two", "three")))
    assert read_or_make(path, Text.load, lambda: next(made)) == "one"
    first = digest_of(path)
    assert read_or_make(path, Text.load, lambda: next(made)) == "one"
    assert digest_of(path) == first
    assert read_or_make(path, Text.load, lambda: next(made), recompute=True) == "two"
    assert digest_of(path) != first
    assert read_kept(path, Text.load) == "two"


class Arrays(dict[str, np.ndarray]):
    """Content as most of ours is: a compressed archive of arrays."""

    def save(self, file: BinaryIO) -> None:
        np.savez_compressed(file, allow_pickle=False, **self)

    @staticmethod
    def load(file: BinaryIO) -> "Arrays":
        with np.load(file, allow_pickle=False) as data:
            return Arrays(data)


def _arrays() -> Arrays:
    rng = np.random.default_rng(3)
    return Arrays(points=rng.normal(size=(200, 3)), ids=np.arange(500), empty=np.empty((0, 4)))


def _flipped(whole: bytes, place: int, bit: int) -> bytes:
    at = place % len(whole)
    return whole[:at] + bytes([whole[at] ^ 1 << bit]) + whole[at + 1 :]


def _swapped(whole: bytes, place: int, size: int) -> bytes:
    at = place % (len(whole) - 2 * size)
    middle = at + size
    return whole[:at] + whole[middle : middle + size] + whole[at:middle] + whole[middle + size :]


PLACES = st.integers(0, 1_000_000)
DAMAGES = st.one_of(
    st.builds(lambda p, b: lambda w: _flipped(w, p, b), PLACES, st.integers(0, 7)),
    st.builds(lambda p: lambda w: w[: p % len(w)], PLACES),
    st.builds(lambda p: lambda w: w[p % len(w) + 1 :], PLACES),
    st.builds(lambda p, n: lambda w: _swapped(w, p, n), PLACES, st.integers(1, 300)),
    st.builds(lambda more: lambda w: w + more, st.binary(min_size=1, max_size=40)),
    st.builds(lambda other: lambda w: other, st.binary(max_size=200)),
)
"""What may happen to the bytes of a file."""


@pytest.mark.slow
@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(damage=DAMAGES)
def test_every_damaged_file_is_named_and_made_again(
    tmp_path: Path, damage: Callable[[bytes], bytes]
) -> None:
    path = tmp_path / "arrays.cache"
    write_kept(path, _arrays())
    whole = path.read_bytes()
    damaged = damage(whole)
    assume(damaged != whole)
    path.write_bytes(damaged)
    made = []
    with pytest.warns(UserWarning, match="arrays.cache is damaged"):
        read_or_make(path, Arrays.load, lambda: made.append(1) or _arrays())
    assert made == [1]
    assert path.read_bytes() == whole


@pytest.mark.parametrize(
    "error", [MemoryError("absurd shape"), zlib.error("incorrect data check"), KeyError("ids")]
)
def test_content_that_cannot_be_read_is_made_again(tmp_path: Path, error: Exception) -> None:
    path = tmp_path / "file.cache"
    write_kept(path, Text("old"))

    def load(file: BinaryIO) -> Text:
        if file.read() == b"old":
            raise error
        return Text("read")

    with pytest.warns(UserWarning, match=r"file\.cache .*" + type(error).__name__):
        assert read_or_make(path, load, lambda: Text("new")) == "new"
    assert read_or_make(path, load, lambda: Text("newest")) == "read"


def test_a_folder_in_the_place_of_a_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="cannot read"):
        read_kept(tmp_path, Text.load)


def test_files_of_others_have_no_digest(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    assert digest_of(tmp_path / "other.npz") is None
    assert digest_of(tmp_path / "missing") is None


def test_a_write_that_fails_leaves_the_old_file(tmp_path) -> None:
    path = tmp_path / "sub" / "file.txt"
    write_atomically(path, lambda p: _write(p, "old"))

    def fail(part: Path) -> None:
        _write(part, "half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_atomically(path, fail)
    assert path.read_text() == "old"
    assert list(path.parent.iterdir()) == [path]


def _write(path: Path, text: str) -> None:
    path.write_text(text)


def test_written_files_have_the_usual_read_permissions(tmp_path: Path) -> None:
    usual = tmp_path / "usual"
    usual.write_text("x")
    write_atomically(tmp_path / "kept", lambda p: _write(p, "x"))
    assert (tmp_path / "kept").stat().st_mode == usual.stat().st_mode
