"""Compilation of kernels, remembered between processes wherever a folder can be written."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])
BUILT_ON = {
    "benchmarks/fit": ("trackers",),
    "detectors": ("detectors/moving",),
    "detectors/clustering": ("detectors",),
    "detectors/moving": ("detectors/shape",),
    "detectors/shape": ("detectors/pose",),
    "envs/imaging": ("envs/world",),
    "envs/raycast": ("envs/world",),
    "envs/sensors": ("envs/imaging", "envs/raycast"),
}
"""By folder, the others whose kernels and constants its kernels use, beside this one's."""


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
        _tie_to_sources(kernel, Path(function.__code__.co_filename).parent)
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


def _tie_to_sources(kernel: Any, folder: Path) -> None:
    """Give the cached machine code a name that changes with any source in the folder.

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
            filename_base=f"{base}-{_digest(folder)}",
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
def _digest(folder: Path) -> str:
    files = sorted({file for each in _sources_of(folder) for file in each.glob("*.py")})
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def _sources_of(folder: Path) -> set[Path]:
    """Return the folder, this one, and those that they are built on, one after the other."""
    house = Path(__file__).parents[1]
    found, ahead = {Path(__file__).parent}, [folder]
    while ahead:
        here = ahead.pop()
        if here not in found:
            found.add(here)
            inside = here.relative_to(house).as_posix() if here.is_relative_to(house) else ""
            ahead += [house / other for other in BUILT_ON.get(inside, ())]
    return found
