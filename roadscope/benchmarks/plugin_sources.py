"""Hashes of plug-ins: their sources, what these import and read, and their arguments.

Files of others are read; nothing is imported.
"""

from __future__ import annotations

import ast
import os
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache, lru_cache
from hashlib import file_digest, sha256
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from roadscope.benchmarks.fingerprints import (
    code_hash,
    counted_nodes,
    fingerprint,
    imported_packages,
)
from roadscope.core.loading import PARSE_ERRORS, SpecError, file_of
from roadscope.core.spec import ORACLE, Spec

REMEMBERED_SOURCES = 1024
"""Most contents of plug-ins' files whose digests and imports a process remembers."""
CODE_ENDINGS = (".py", *EXTENSION_SUFFIXES)
"""Endings of sources and of compiled modules."""
LOGS = frozenset({"", ".log"})
"""Endings of files that do not count, although they are named: plug-ins write their logs there."""
WRITING = frozenset({"write_text", "write_bytes"})
"""Methods of a path that write its file."""
MODES_OF_WRITING = frozenset(a + b for a in "wax" for b in ("", "b", "t", "+", "b+", "+b"))
"""Modes of `open` in which a file is written."""
MOST_TRIED = 1000
"""Most names that are looked for one by one in a folder, which may have a million files; of more
the folder is listed. Chosen by hand."""
LARGE_FILE_BYTES = 1_000_000
"""Files of this size or more are read again only if their time or size changes; chosen by hand."""


def plugin_hash(spec: Spec) -> str:
    """Hash a resolved plug-in's source, arguments and the files that its arguments name, but logs.

    Of a plug-in of roadscope, its module and all modules that this imports are hashed; of another
    plug-in its file, what this imports and reads and the version of its distribution
    (`source_hash`), without importing it; of an oracle its parts.
    """
    if spec.kind == ORACLE:
        return fingerprint([plugin_hash(part) for part in spec.parts.values()])
    place, _, name = spec.target.rpartition(":")
    if spec.ours:
        required = spec.requirement
        needed = f"{required.distribution}={required.version}" if required else ""
        source = f"{code_hash(place)} {name} {needed}"
    else:
        source = source_hash(spec.target)
    file = None if spec.ours else file_of(place)
    folder = None if file is None else file.parent
    return fingerprint([source, dict(spec.arguments), _named_files(spec.arguments, folder)])


def _named_files(arguments: Mapping[str, Any], folder: Path | None) -> list[str]:
    """Return the hashes of files that arguments name, such as weights.

    folder: that of the plug-in's file; paths count from there and from the working directory.
    """
    texts = [value for value in arguments.values() if isinstance(value, str | Path)]
    paths = [place / text for text in texts for place in (Path(), folder) if place is not None]
    return [_content_digest(path) for path in paths if path.suffix not in LOGS and _is_file(path)]


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def source_hash(target: str) -> str:
    """Hash the sources of a plug-in, `module:Class` or `path/file.py:Class`: 16 hex digits.

    These are its file and all code that it imports, directly or not, and that no distribution has
    installed: files beside it, in the working directory, on `PYTHONPATH` and of distributions that
    are installed as editable; in a package, all files of the package and the version of its
    distribution. The versions of all other packages that these files import count too, and the
    data files that they name (`_data_files`). Of each source the syntax tree is hashed, without
    comments and docstrings. Files are read; nothing is imported.
    """
    place, _, name = target.rpartition(":")
    file = file_of(place)
    if file is None:
        raise SpecError(f"no file or module {place}")
    sources, packages = _plugin_sources(file.resolve())
    if not place.endswith(".py"):
        packages = packages | {place.partition(".")[0]}
    versions = [distribution_version(top) for top in sorted(packages)]
    digest = sha256(f"{name} {versions}".encode())
    for path in sources:
        digest.update(_source_digest(path).encode() + b"\0")
    for path in _data_files(sources):
        digest.update(f"{path.name} {_content_digest(path)}\n".encode())
    return digest.hexdigest()[:16]


def _source_digest(path: Path) -> str:
    """Return the digest of a source, or of the content of an extension module."""
    if path.suffix == ".py":
        return _parsed_plugin(path.read_bytes()).digest
    return _content_digest(path)


def _content_digest(path: Path) -> str:
    """Return the digest of a file's content; that of a large file is remembered."""
    try:
        state = path.stat()
        if state.st_size < LARGE_FILE_BYTES:
            return sha256(path.read_bytes()).hexdigest()
        return _large_file_digest(path, state.st_mtime_ns, state.st_size)
    except OSError:
        return "cannot be read"


@lru_cache(REMEMBERED_SOURCES)
def _large_file_digest(path: Path, _mtime_ns: int, _size: int) -> str:
    with path.open("rb") as file:
        return file_digest(file, "sha256").hexdigest()


class _PluginSource(NamedTuple):
    """The parts of a plug-in's source that count for hashes.

    digest: of its syntax tree, or of its bytes if it has none.
    imports: first parts of the names of all modules that it imports.
    texts: string constants of one line, which may name data files or their folders; without those
        of calls that write a file, such as a log.
    """

    digest: str
    imports: frozenset[str]
    texts: frozenset[str]


@lru_cache(REMEMBERED_SOURCES)
def _parsed_plugin(content: bytes) -> _PluginSource:
    try:
        digest, nodes = counted_nodes(ast.parse(content))
    except PARSE_ERRORS:
        return _PluginSource(sha256(content).hexdigest(), frozenset(), frozenset())
    written = {
        id(part)
        for node in nodes
        if isinstance(node, ast.Call) and _writes(node)
        for part in ast.walk(node)
    }
    constants = (n.value for n in nodes if isinstance(n, ast.Constant) and id(n) not in written)
    texts = (text for text in constants if isinstance(text, str) and 0 < len(text) < 256)
    named = frozenset(text for text in texts if not set(text) & set("\n\0"))
    return _PluginSource(digest, imported_packages(nodes), named)


def _writes(call: ast.Call) -> bool:
    """Whether a call writes a file, as `open(path, "a")` and `path.write_text(text)` do."""
    name = getattr(call.func, "id", getattr(call.func, "attr", ""))
    if name != "open":
        return name in WRITING
    modes = [*call.args[:2], *(each.value for each in call.keywords if each.arg == "mode")]
    texts = [mode.value for mode in modes if isinstance(mode, ast.Constant)]
    return any(text in MODES_OF_WRITING for text in texts)


def _package_of(file: Path) -> Path | None:
    """Return the folder of the topmost package that a file is in; None: it is in no package."""
    folders = [folder for folder in file.parents if (folder / "__init__.py").is_file()]
    inside = [f for k, f in enumerate(folders) if f == file.parents[k]]
    return inside[-1] if inside else None


def _plugin_sources(file: Path) -> tuple[list[Path], frozenset[str]]:
    """Return a plug-in's own sources, sorted, and the packages whose versions count."""
    folder = _package_of(file)
    files: set[Path] = set()
    searched: set[tuple[str, Path]] = set()
    pending = _code_in(folder) if folder else [file]
    while pending:
        path = pending.pop()
        if path in files:
            continue
        files.add(path)
        imports = _parsed_plugin(path.read_bytes()).imports if path.suffix == ".py" else ()
        for top in imports:
            if top != "roadscope" and (top, path.parent) not in searched:
                searched.add((top, path.parent))
                pending += _own_code(top, (path.parent, file.parent))
    # One's own modules have no version. A module may be named like a package that counts, too.
    packages = {top for top, _ in searched} - set(sys.stdlib_module_names)
    return sorted(files), frozenset(packages)


def _own_code(top: str, folders: Iterable[Path]) -> list[Path]:
    """Return the files of a module that no distribution has installed; none of another.

    top: its name. folders: where it is looked for first.
    """
    for folder in folders:
        files = [folder / f"{top}{ending}" for ending in CODE_ENDINGS]
        beside = [path for path in files if path.is_file()] + _code_in(folder / top)
        if beside:
            return [] if _is_of_distributions(folder) else beside
    if top in sys.stdlib_module_names:
        return []
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):
        return []
    if spec is None:
        return []
    places = spec.submodule_search_locations or ([spec.origin] if spec.origin else [])
    own = [Path(each).resolve() for each in places if not _is_of_distributions(Path(each).parent)]
    return [path for place in own for path in ([place] if place.is_file() else _code_in(place))]


def _is_of_distributions(folder: Path) -> bool:
    """Whether a folder is where distributions are installed, `pip install --target` included."""
    return bool({"site-packages", "dist-packages"} & set(folder.parts)) or any(
        folder.glob("*.dist-info")
    )


def _code_in(folder: Path) -> list[Path]:
    """Return the sources and extension modules of a package's folder."""
    paths = (
        Path(place, name)
        for place, _, names in os.walk(folder)
        for name in names
        if name.endswith(CODE_ENDINGS)
    )
    return [path for path in paths if path.is_file()]


def _data_files(sources: Sequence[Path]) -> list[Path]:
    """Return the existing files, no sources themselves, that a plug-in's sources name.

    A file counts if a string constant is its path, from the folder of a source, from the working
    directory or from a folder that another constant names. Empty files do not count, as those of
    `/proc` and devices are, and those of `LOGS` neither.
    """
    texts_by_head: dict[str, list[str]] = {}
    for path in sources:
        for text in _parsed_plugin(path.read_bytes()).texts if path.suffix == ".py" else ():
            for head in Path(text).parts[:1]:
                texts_by_head.setdefault(head, []).append(text)
    pending = [*{path.parent for path in sources}, Path.cwd()]
    reached: set[Path] = set()
    while pending:
        # Texts may be anything: names that are too long or no names, folders that cannot be read.
        with suppress(OSError, RuntimeError, ValueError):
            place = pending.pop().resolve()
            if place not in reached and place.exists():
                reached.add(place)
                heads = _existing(place, texts_by_head) if place.is_dir() else ()
                pending += [place / text for head in heads for text in texts_by_head[head]]
    named = (path for path in reached - set(sources) if path.suffix not in LOGS)
    others = (path for path in named if path.is_file())
    return sorted(path for path in others if path.stat().st_size)


def _existing(folder: Path, names: Collection[str]) -> list[str]:
    """Return which names there are in a folder; a name may also be `..` or the root."""
    if len(names) <= MOST_TRIED:
        return [name for name in names if os.path.lexists(folder / name)]
    listed = {os.pardir, os.sep, *(each.name for each in folder.iterdir())}
    return [name for name in names if name in listed]


@cache
def distribution_version(top: str) -> str:
    """Return the versions of the distributions that a package belongs to; empty if of none.

    top: name of the package as it is imported.
    """
    with suppress(PackageNotFoundError):
        return version(top)
    names = sorted(set(_distributions(tuple(sys.path)).get(top, [])))
    return ",".join(f"{name}={version(name)}" for name in names)


@lru_cache(1)
def _distributions(_import_path: tuple[str, ...]) -> Mapping[str, list[str]]:
    """Return the distributions of each package; cached, as reading takes a third of a second."""
    return packages_distributions()
