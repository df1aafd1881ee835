"""Examines this installation: versions, extras, folders, kernels and isolation."""

from __future__ import annotations

import os
import platform
import shutil
import sqlite3
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from roadscope.benchmarks.cache import cache_folder
from roadscope.benchmarks.cached_files import KindUsage, cache_usage, size_text
from roadscope.core.kernel_files import kernel_folders

DISTRIBUTION = "roadscope"
LITTLE_SPACE_BYTES = 1_000_000_000
"""Free disk space below which a warning is given: the traffic of all suites takes about 0.1 GB and
the database grows with every run. Chosen by hand."""
LITTLE_MEMORY_BYTES = 4_000_000_000
"""Memory below which a warning is given: two workers with the camera network take 2 GB. Chosen by
hand."""


@dataclass(frozen=True, slots=True)
class Extra:
    """One set of optional distributions.

    missing: requirements that are not installed here. command: what installs them.
    """

    name: str
    missing: tuple[str, ...]
    command: str


@dataclass(frozen=True, slots=True)
class Machine:
    """The machine.

    cores: that this process may use. memory_bytes: of the machine, or of the container if less.
    """

    platform: str
    cores: int
    memory_bytes: int


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder that roadscope writes files to."""

    path: str
    writable: bool
    free_bytes: int | None


@dataclass(frozen=True, slots=True)
class Kernels:
    """Machine code of compiled functions that later processes read.

    folder: that new code goes to. cached: functions and signatures that are compiled already.
    """

    folder: Folder
    cached: int
    size_bytes: int


@dataclass(frozen=True, slots=True)
class Isolation:
    """The means that isolate plug-ins that are not part of roadscope.

    parts: by name, whether each is available. sandbox: whether bubblewrap works here; only it
    keeps a plug-in from the cache, the results, recorded data and the network. sandbox_reason: why
    not.
    """

    parts: Mapping[str, bool]
    sandbox: bool
    sandbox_reason: str


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The result of the examination.

    versions: of distributions by name, None for one that is not installed.
    broken: texts on what does not work and must be repaired. warnings: on what works, but worse
        than it could.
    """

    versions: Mapping[str, str | None]
    extras: tuple[Extra, ...]
    machine: Machine
    cache: Folder
    usages: tuple[KindUsage, ...]
    kernels: Kernels
    isolation: Isolation
    broken: tuple[str, ...]
    warnings: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return a dictionary that JSON can hold."""
        content = asdict(self)
        content["isolation"]["complete"] = all(self.isolation.parts.values())
        return content


def doctor() -> Diagnosis:
    """Examine this installation; only test files are written, and removed again."""
    folder, kernels = _folder(cache_folder()), _kernels()
    isolation, machine = _isolation(), _machine()
    return Diagnosis(
        versions=_versions(),
        extras=_extras(),
        machine=machine,
        cache=folder,
        usages=cache_usage(),
        kernels=kernels,
        isolation=isolation,
        broken=tuple(_broken(folder)),
        warnings=tuple(_warnings(folder, kernels, isolation, machine)),
    )


def _broken(folder: Folder) -> Iterator[str]:
    """Yield a text for each thing that must be repaired."""
    for requirement in _requirements():
        if _needed(requirement) and not _satisfied(requirement):
            actual, wanted = _version(requirement.name) or "is not installed", _plain(requirement)
            yield f"{requirement.name} {actual}: {wanted} is needed: pip install '{wanted}'"
    if not folder.writable:
        yield (
            f"the cache folder {folder.path} cannot be written: set ROADSCOPE_CACHE to a folder "
            "that can"
        )
    if reason := _database_fault(cache_folder() / "results.sqlite"):
        yield reason


def _warnings(
    folder: Folder, kernels: Kernels, isolation: Isolation, machine: Machine
) -> Iterator[str]:
    """Yield a text for each thing that works, but worse than it could."""
    if not _requirements():
        yield "roadscope is not installed as a distribution: extras are not known"
    if not kernels.folder.writable:
        yield (
            f"{kernels.folder.path} cannot be written: every process compiles its kernels, which "
            "takes minutes: set NUMBA_CACHE_DIR to a folder that can"
        )
    elif not kernels.cached:
        yield "no kernels are cached: the first run compiles for a minute or two"
    if folder.free_bytes is not None and folder.free_bytes < LITTLE_SPACE_BYTES:
        yield f"only {size_text(folder.free_bytes)} are free in {folder.path}"
    if machine.memory_bytes < LITTLE_MEMORY_BYTES:
        yield f"only {size_text(machine.memory_bytes)} of memory: use --jobs 1"
    for name, available in isolation.parts.items():
        if not available:
            yield f"isolation of plug-ins is incomplete: no {name}"


@cache
def _requirements() -> tuple[Any, ...]:
    """Return the requirements in the distribution's metadata; none if it is not installed."""
    from packaging.requirements import Requirement

    try:
        return tuple(Requirement(text) for text in metadata.requires(DISTRIBUTION) or ())
    except metadata.PackageNotFoundError:
        return ()


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _needed(requirement: Any, extra: str = "") -> bool:
    """Return whether a requirement applies here. extra: with this extra; empty: without any."""
    marker = requirement.marker
    return bool(marker.evaluate({"extra": extra})) if marker is not None else not extra


def _satisfied(requirement: Any) -> bool:
    version = _version(requirement.name)
    # Builds such as 2.13.0+cpu and pre-releases count.
    return version is not None and requirement.specifier.contains(version, prereleases=True)


def _plain(requirement: Any) -> str:
    return f"{requirement.name}{requirement.specifier}"


def _versions() -> dict[str, str | None]:
    from roadscope import __version__

    names = [r.name for r in _requirements() if _needed(r)] or ["numpy", "numba", "torch"]
    versions = {name: _version(name) for name in sorted(names)}
    return {DISTRIBUTION: __version__, "python": platform.python_version(), **versions}


def _extras() -> tuple[Extra, ...]:
    try:
        names = metadata.metadata(DISTRIBUTION).get_all("Provides-Extra") or []
    except metadata.PackageNotFoundError:
        return ()
    extras = []
    for name in sorted(names):
        required = [r for r in _requirements() if not _needed(r) and _needed(r, name)]
        missing = tuple(_plain(r) for r in required if not _satisfied(r))
        extras.append(Extra(name, missing, f'pip install "{DISTRIBUTION}[{name}]"'))
    return tuple(extras)


def _machine() -> Machine:
    """Return the machine; memory is its own or, if less, the container's limit."""
    from joblib import cpu_count
    from psutil import virtual_memory

    memory_bytes = int(virtual_memory().total)
    for name in ("memory.max", "memory/memory.limit_in_bytes"):
        with suppress(OSError, ValueError):  # No such file, or `max`.
            memory_bytes = min(memory_bytes, int(Path("/sys/fs/cgroup", name).read_text()))
    return Machine(platform.platform(), int(cpu_count()), memory_bytes)


def _folder(path: Path) -> Folder:
    """Examine a folder or, if it does not exist, the nearest folder above it."""
    existing = next(place for place in (path, *path.absolute().parents) if place.exists())
    writable, free_bytes = False, None
    with suppress(OSError):
        free_bytes = shutil.disk_usage(existing).free
        with tempfile.TemporaryFile(dir=existing):
            writable = True
    return Folder(str(path), writable, free_bytes)


def _kernels() -> Kernels:
    """Examine the folder in which `core.jit` keeps machine code."""
    folders = [_folder(path) for path in kernel_folders()]
    folder = next((each for each in folders if each.writable), folders[0])
    files = list(Path(folder.path).rglob("*.nbc"))
    return Kernels(folder, len(files), sum(file.stat().st_size for file in files))


def _isolation() -> Isolation:
    from roadscope.benchmarks.isolation import sandbox_available

    parts = {
        "process group of its own (os.setsid)": hasattr(os, "setsid"),
        "adoption of orphaned children (subreaper of Linux)": sys.platform == "linux",
        "limit of core dumps (resource)": find_spec("resource") is not None,
    }
    reason = sandbox_available()
    return Isolation(parts, not reason, reason)


def _database_fault(path: Path) -> str:
    """Return what is wrong with the results database; empty if it is sound or does not exist."""
    if not path.is_file():
        return ""
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as connection:
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.Error as error:
        return f"the results database {path} cannot be read: {error}; move or remove it"
    return ""
