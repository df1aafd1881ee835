"""Compilation of kernels, remembered between processes wherever a folder can be written."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])
HOUSE = Path(__file__).parents[1]
IMPORT = re.compile(r"^\s*(?:from\s+(\S+)\s+import\s+(\([^)]*\)|.*)|import\s+(.+))$", re.MULTILINE)


def compiled(*, borrowing: bool = False, **options: Any) -> Callable[[F], F]:
    """Compile a function with numba on its first call and keep the machine code on disk.

    Numba writes beside the source or, where it may not, to the user's cache folder. Where
    neither can be written it refuses to decorate; then the code is compiled in every process.
    Division follows NumPy: by zero gives inf or nan. A `borrowing` function makes no arrays
    and does not count references to those it is given: that counting took four fifths of the
    ray caster's time.
    """
    settings = {"error_model": "numpy", "nogil": True, **options}
    if borrowing and _may_borrow():
        settings["_nrt"] = False

    def decorate(function: F) -> F:
        try:
            kernel = njit(cache=True, **settings)(function)
        except RuntimeError as error:
            if "locator" not in str(error):
                raise
            return cast(F, njit(**settings)(function))
        _tie_to_sources(kernel, Path(function.__code__.co_filename))
        _compile_once(kernel)
        return cast(F, kernel)

    return decorate


@cache
def _may_borrow() -> bool:
    """Whether this numba can leave out reference counting; the setting is not public."""
    try:
        njit(_nrt=False)(_may_borrow.__wrapped__)
    except (KeyError, TypeError):
        return False
    return True


def _tie_to_sources(kernel: Any, file: Path) -> None:
    """Give the cached machine code a name that changes with any source that the file builds on.

    Numba compares the time stamp of the function's own file only, but kernels call one another
    and read constants and record types across files: after an update stale code would run, or
    fail to load. Numba has no public setting for this; without these inner names it works as
    always.
    """
    try:
        from numba.core.caching import IndexDataCacheFile

        store, base = kernel._cache, kernel._cache._impl.filename_base
        stamp = kernel._cache._impl.locator.get_source_stamp()
        store._cache_file = IndexDataCacheFile(
            cache_path=store._cache_path,
            filename_base=f"{base}-{_digest(file)}",
            source_stamp=stamp,
        )
    except (AttributeError, ImportError, TypeError, OSError):
        return


def _compile_once(kernel: Any) -> None:
    """Let one process compile what several need, and the others wait for its machine code.

    Two workers that start together would otherwise spend half of their first minutes on the
    same kernels. Numba has no public hook for this; without these inner names each compiles.
    """
    try:
        import fcntl  # noqa: F401

        from numba.core.compiler_lock import global_compiler_lock

        compile_now, cache_file = kernel.compile, kernel._cache._cache_file
        lock = Path(kernel._cache._cache_path) / f"{Path(cache_file._index_name).stem}.lock"
    except (AttributeError, ImportError):
        return

    def compile_alone(signature: Any) -> Any:
        # Threads in the same order everywhere: first numba's lock, which can be taken again.
        with global_compiler_lock, _held(lock):
            return compile_now(signature)

    kernel.compile = compile_alone


@contextmanager
def _held(lock: Path) -> Iterator[None]:
    """Hold a file's lock, which the system takes back from a process that dies; if it can."""
    import fcntl

    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        file = lock.open("a")
    except OSError:
        yield
        return
    with file:
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


@cache
def _digest(file: Path) -> str:
    files = sorted(sources_of(file))
    return hashlib.sha256(b"".join(each.read_bytes() for each in files)).hexdigest()[:12]


def sources_of(file: Path) -> set[Path]:
    """Return the file, this one, and those of the package that they import, one after the other.

    Of a file elsewhere it is all of its folder too, for what it imports from there is not known.
    """
    found: set[Path] = set()
    ahead = [Path(__file__), file] if file.is_relative_to(HOUSE) else [*file.parent.glob("*.py")]
    while ahead:
        here = ahead.pop()
        if here not in found:
            found.add(here)
            ahead += _imported_by(here)
    return found


@cache
def _imported_by(file: Path) -> tuple[Path, ...]:
    """Return the package's modules that a file imports, and modules that it takes names from."""
    modules = set()
    for package, names, plain in IMPORT.findall(file.read_text("utf-8")):
        if package:
            modules |= {package, *(f"{package}.{name}" for name in re.findall(r"\w+", names))}
        modules |= set(re.findall(r"[\w.]+", plain))
    paths = (_file_of(name) for name in modules if name.split(".")[0] == HOUSE.name)
    return tuple(path for path in paths if path is not None)


def _file_of(module: str) -> Path | None:
    path = HOUSE.parent.joinpath(*module.split("."))
    for each in (path.with_suffix(".py"), path / "__init__.py"):
        if each.is_file():
            return each
    return None
