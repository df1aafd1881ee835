"""Whether this installation works: versions, extras, folders, kernels and isolation."""

from __future__ import annotations

import os
import platform
import shutil
import sqlite3
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from roadscope.benchmarks.cache import cache_folder
from roadscope.benchmarks.cached_files import KindUsage, cache_usage, size_text

DISTRIBUTION = "roadscope"
LITTLE_SPACE_BYTES = 1_000_000_000
"""Free disk space below which a warning is given: the traffic of all suites takes about 0.1 GB and
the database grows with every run. Chosen by hand."""
LITTLE_MEMORY_BYTES = 4_000_000_000
"""Memory below which a warning is given: two workers with the camera network take 2 GB. Chosen by
hand."""
_SUBREAPER = 37
"""PR_GET_CHILD_SUBREAPER of prctl(2)."""


@dataclass(frozen=True, slots=True)
class Extra:
    """One set of optional distributions.

    missing: requirements that are not installed here. command: what installs them.
    """

    name: str
    missing: tuple[str, ...]
    command: str

    @property
    def installed(self) -> bool:
        """Whether all of it is there."""
        return not self.missing


@dataclass(frozen=True, slots=True)
class Machine:
    """Where this runs.

    cores: that this process may use. memory_bytes: of the machine or of the container's limit, None
    where it cannot be read.
    """

    platform: str
    cores: int
    memory_bytes: int | None


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder that files of ours go to."""

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
    """What keeps a plug-in that is not ours apart from the run.

    parts: what is needed and whether it is there. sandbox: whether bubblewrap works here, which
    alone keeps a plug-in from reading files.
    """

    parts: Mapping[str, bool]
    sandbox: bool
    sandbox_reason: str

    @property
    def complete(self) -> bool:
        """Whether all parts are there."""
        return all(self.parts.values())


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What was found out.

    versions: of distributions by name, None for one that is not installed.
    broken: what does not work and must be put right. warnings: what works, but worse than it could.
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
        isolation = {**asdict(self.isolation), "complete": self.isolation.complete}
        return {**asdict(self), "isolation": isolation}


def doctor() -> Diagnosis:
    """Look at this installation; nothing is changed but for test files that are removed again."""
    versions, folder = _versions(), _folder(cache_folder())
    kernels, isolation, machine = _kernels(), _isolation(), _machine()
    broken = [
        f"{name} {version or 'is not installed'}: {required} is needed: pip install '{required}'"
        for name, version, required in _unmet()
    ]
    if not folder.writable:
        broken.append(
            f"the cache folder {folder.path} cannot be written: set ROADSCOPE_CACHE to a folder "
            "that can"
        )
    if reason := _database_fault(cache_folder() / "results.sqlite"):
        broken.append(reason)
    warnings = []
    if not _requirements():
        warnings.append("roadscope is not installed as a distribution: extras are not known")
    if not kernels.folder.writable:
        warnings.append(
            f"{kernels.folder.path} cannot be written: every process compiles its kernels, which "
            "takes minutes: set NUMBA_CACHE_DIR to a folder that can"
        )
    elif not kernels.cached:
        warnings.append("no kernels are cached: the first run compiles for a minute or two")
    if folder.free_bytes is not None and folder.free_bytes < LITTLE_SPACE_BYTES:
        warnings.append(f"only {size_text(folder.free_bytes)} are free in {folder.path}")
    if machine.memory_bytes is not None and machine.memory_bytes < LITTLE_MEMORY_BYTES:
        warnings.append(f"only {size_text(machine.memory_bytes)} of memory: use --jobs 1")
    warnings += [
        f"isolation of plug-ins is incomplete: no {name}"
        for name, there in isolation.parts.items()
        if not there
    ]
    return Diagnosis(
        versions=versions,
        extras=_extras(),
        machine=machine,
        cache=folder,
        usages=cache_usage(),
        kernels=kernels,
        isolation=isolation,
        broken=tuple(broken),
        warnings=tuple(warnings),
    )


@cache
def _requirements() -> tuple[Any, ...]:
    """Return what the distribution's metadata requires, none where it is not installed."""
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
    """Return whether a requirement applies here; extra: the one asked for, none by default."""
    marker = requirement.marker
    return bool(marker.evaluate({"extra": extra})) if marker is not None else not extra


def _met(requirement: Any) -> bool:
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


def _unmet() -> list[tuple[str, str | None, str]]:
    """Return name, installed version and requirement of what must be there and is not."""
    needed = [r for r in _requirements() if _needed(r)]
    return [(r.name, _version(r.name), _plain(r)) for r in needed if not _met(r)]


def _extras() -> tuple[Extra, ...]:
    try:
        names = metadata.metadata(DISTRIBUTION).get_all("Provides-Extra") or []
    except metadata.PackageNotFoundError:
        names = []
    return tuple(_extra(name) for name in sorted(names))


def _extra(name: str) -> Extra:
    required = [r for r in _requirements() if not _needed(r) and _needed(r, name)]
    missing = tuple(_plain(r) for r in required if not _met(r))
    return Extra(name, missing, f'pip install "{DISTRIBUTION}[{name}]"')


def _machine() -> Machine:
    from joblib import cpu_count

    return Machine(platform.platform(), int(cpu_count()), _memory_bytes())


def _memory_bytes() -> int | None:
    """Return the machine's memory or, if that is less, the limit of the container."""
    try:
        size = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None
    limits = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")
    for path in map(Path, limits):
        try:
            size = min(size, int(path.read_text()))
        except (OSError, ValueError):  # Not there, or `max`.
            continue
    return size


def _folder(path: Path) -> Folder:
    """Look at a folder, or at the place where it would be made."""
    there = path
    while not there.exists() and there != there.parent:
        there = there.parent
    try:
        with tempfile.TemporaryFile(dir=there):
            writable = True
    except OSError:
        writable = False
    try:
        free_bytes = shutil.disk_usage(there).free
    except OSError:
        free_bytes = None
    return Folder(str(path), writable, free_bytes)


def _kernels() -> Kernels:
    """Look where Numba puts machine code: its own folder if named, else beside our sources."""
    package = Path(__file__).resolve().parents[1]
    folder, files = _folder(package), list(package.rglob("__pycache__/*.nbc"))
    named = os.environ.get("NUMBA_CACHE_DIR")
    if named or not folder.writable:
        from platformdirs import user_cache_path

        place = Path(named) if named else user_cache_path("numba", appauthor=False)
        folder = _folder(place)
        files = [*([] if named else files), *place.rglob("*.nbc")]
    return Kernels(folder, len(files), sum(file.stat().st_size for file in files))


def _isolation() -> Isolation:
    parts = {
        "process group of its own (os.setsid)": hasattr(os, "setsid"),
        "adoption of orphaned children (subreaper of Linux)": _has_subreaper(),
        "limit of resident memory (/proc)": Path("/proc/self/statm").exists(),
        "limit of core dumps (resource)": _has_resource(),
    }
    reason = _sandbox_fault()
    return Isolation(parts, not reason, reason)


def _has_subreaper() -> bool:
    if sys.platform != "linux":
        return False
    import ctypes

    answer = ctypes.c_int()
    try:
        prctl = ctypes.CDLL(None, use_errno=True).prctl
    except (OSError, AttributeError):
        return False
    return bool(prctl(_SUBREAPER, ctypes.byref(answer), 0, 0, 0) == 0)


def _has_resource() -> bool:
    from importlib.util import find_spec

    return find_spec("resource") is not None


def _sandbox_fault() -> str:
    """Return why bubblewrap cannot be used here; empty if it can."""
    import subprocess

    program = shutil.which("bwrap")
    if program is None:
        return "bubblewrap (bwrap) is not installed"
    command = [program, "--ro-bind", "/", "/", "--unshare-net", "--dev", "/dev", "true"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"bubblewrap does not start: {error}"
    words = " ".join(done.stderr.split()) or f"exit status {done.returncode}"
    return "" if done.returncode == 0 else f"bubblewrap does not work here: {words}"


def _database_fault(path: Path) -> str:
    """Return what is wrong with the results database; empty if it is sound or not there."""
    if not path.is_file():
        return ""
    try:
        connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
        try:
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
        finally:
            connection.close()
    except sqlite3.Error as error:
        return f"the results database {path} cannot be read: {error}; move or remove it"
    return ""
