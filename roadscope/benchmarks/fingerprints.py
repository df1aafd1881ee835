"""Hashes of everything that a result depends on: values, our code, plug-ins, libraries.

Sources count by their syntax trees. A file of roadscope is parsed once: its digest and its imports
are kept in the cache folder.
"""

from __future__ import annotations

import ast
import json
import os
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache, lru_cache
from hashlib import file_digest, sha256
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from roadscope.benchmarks.cache import cache_dir, write_atomically
from roadscope.core.loading import PARSE_ERRORS, SpecError, file_of
from roadscope.core.spec import ORACLE, Spec

PACKAGE = Path(__file__).resolve().parents[1]
RECORDING = "roadscope.envs.traffic.scenarios"
"""The module that records traffic; it names the builders of scenarios as text."""
SENSING = (
    "roadscope.envs.sensors.faults",
    "roadscope.envs.sensors.rigs",
    "roadscope.envs.sensors.sensing",
    "roadscope.envs.sensors.weathers",
)
"""The modules that make frames and truth from traffic."""
DATA_KINDS = (".toml", ".json", ".npz", ".safetensors")
"""Endings of data files that results depend on, beside the sources."""
NUMERICAL_LIBRARIES = frozenset({"filterpy", "highway_env", "numba", "numpy", "scipy", "torch"})
"""Packages of others whose versions may change a score."""
FORMAT = 5
"""Version of the index; increased when `Source` or what its digest covers changes."""
REMEMBERED_SOURCES = 1024
"""Most contents of plug-ins' files whose digests and imports a process remembers."""
CODE_ENDINGS = (".py", *EXTENSION_SUFFIXES)
"""Endings of sources and of compiled modules."""
MOST_TRIED = 1000
"""Most names that are looked for one by one in a folder, which may have a million files; of more
the folder is listed. Chosen by hand."""
LARGE_FILE_BYTES = 1_000_000
"""Files of this size or more are read again only if their time or size changes; chosen by hand."""


def fingerprint(value: Any) -> str:
    """Hash plain values, arrays and dataclasses by content: 16 hexadecimal digits."""
    text = json.dumps(_plain(value), sort_keys=True, separators=(",", ":"))
    return sha256(text.encode()).hexdigest()[:16]


@cache
def code_hash(*modules: str, root: Path = PACKAGE) -> str:
    """Hash the syntax trees and data of modules and of all modules that they import.

    The versions of `NUMERICAL_LIBRARIES` that these import count too.
    modules: dotted names, such as `roadscope.envs.traffic.scenarios`. root: folder of the package.
    Comments, docstrings, positions and imports for type checkers alone do not count.
    """
    sources = package(root)
    names = sorted(sources.closure(modules))
    digest = sha256()
    for name in names:
        digest.update(f"{name} {sources.source(name).digest}\n".encode())
    for library in sorted({each for name in names for each in sources.source(name).libraries}):
        digest.update(f"{library} {package_version(library)}\n".encode())
    for path in sources.data_files(names):
        content = sha256(path.read_bytes()).hexdigest()
        digest.update(f"{path.relative_to(sources.root).as_posix()} {content}\n".encode())
    return digest.hexdigest()[:16]


def package_hash() -> str:
    """Hash all sources and data of this package, papers and tools included."""
    return code_hash(*package(PACKAGE).modules())


def timeline_hash(scenario: str = "") -> str:
    """Hash the code that records traffic.

    scenario: whose traffic; empty: all scenarios. The code of sensors does not count.
    """
    from roadscope.envs.traffic.scenarios import SCENARIOS, find

    scenarios = [find(scenario)] if scenario else list(SCENARIOS.values())
    builders = {each.builder.partition(":")[0] for each in scenarios}
    return code_hash(RECORDING, *sorted(builders))


def sensing_hash(scenario: str = "") -> str:
    """Hash the code that makes frames and truth: `timeline_hash` and the sensors."""
    return fingerprint([timeline_hash(scenario), code_hash(*SENSING)])


def plugin_hash(spec: Spec) -> str:
    """Hash a resolved plug-in's source, arguments and the files that its arguments name.

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
    return [_content_digest(path) for path in paths if _is_file(path)]


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


@cache
def package_version(name: str) -> str:
    """Return the installed version of a distribution, or `not installed`."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _plain(value: Any) -> Any:
    """Return a value as JSON can hold it; arrays and records by their content."""
    if isinstance(value, np.ndarray):
        return [str(value.dtype), list(value.shape), sha256(value.tobytes()).hexdigest()]
    if isinstance(value, np.generic):
        return value.item()
    if is_dataclass(value) and not isinstance(value, type):
        parts = {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
        return [type(value).__name__, parts]
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if callable(value):
        return f"{value.__module__}.{value.__qualname__}"
    return value if isinstance(value, str | int | float | bool | None) else repr(value)


# --------------------------------------------------------------------------------------------------
# Sources of roadscope


class Import(msgspec.Struct, frozen=True, array_like=True):
    """One imported name.

    module: dotted name. name: what is taken from it; empty for `import module`.
    """

    module: str
    name: str = ""


class Source(msgspec.Struct, frozen=True, array_like=True):
    """The parts of one source file that count for hashes.

    mtime_ns, size: of the file when it was parsed.
    digest: of the syntax tree without comments, docstrings, positions and what only type
        checkers read.
    imports: from the same package, inside functions too.
    libraries: those of `NUMERICAL_LIBRARIES` that it imports.
    bound: names that the top level binds.
    offered: imports for type checkers in a module with a `__getattr__` of its own, which loads
        them on use.
    texts: string constants without white space, which may name data files.
    only_offers: whether it is the `__init__` of a package that does nothing but import names, which
        others import from it.
    """

    mtime_ns: int
    size: int
    digest: str
    imports: tuple[Import, ...]
    libraries: tuple[str, ...]
    bound: tuple[str, ...]
    offered: tuple[Import, ...]
    texts: tuple[str, ...]
    only_offers: bool = False


class Package:
    """The source files of one package, read as needed."""

    def __init__(self, root: Path) -> None:
        """Take the package's folder; its name is the package's name."""
        self.root = root.resolve()
        self.name = self.root.name
        self._sources: dict[str, Source] = {}
        self._files: dict[str, Path | None] = {}
        # Syntax trees differ between versions of Python.
        key = f"{FORMAT} {sys.version_info[:2]} {self.root}"
        self._index = cache_dir() / "sources" / f"{sha256(key.encode()).hexdigest()[:16]}.json"
        self._parsed = self._read_index()
        self._new = False

    def file_of(self, module: str) -> Path | None:
        """Return the file of a dotted name, or None if the package has no such module."""
        if module not in self._files:
            first, *rest = module.split(".")
            place = self.root.joinpath(*rest)
            files = [place / "__init__.py", *([place.with_name(f"{place.name}.py")] * bool(rest))]
            existing = (path for path in files if first == self.name and path.is_file())
            self._files[module] = next(existing, None)
        return self._files[module]

    def modules(self) -> list[str]:
        """Return the dotted names of all modules."""
        paths = (path.relative_to(self.root.parent) for path in self.root.rglob("*.py"))
        names = (path.with_suffix("").parts for path in paths)
        return sorted(".".join(n[:-1] if n[-1] == "__init__" else n) for n in names)

    def source(self, module: str) -> Source:
        """Return the source of a module; parse it unless an earlier parse of this file is kept."""
        if module not in self._sources:
            path = self.file_of(module)
            if path is None:
                raise ModuleNotFoundError(f"no module '{module}' in {self.root}")
            state, source = path.stat(), self._parsed.get(str(path))
            if source is None or (source.mtime_ns, source.size) != (
                state.st_mtime_ns,
                state.st_size,
            ):
                source = self._parsed[str(path)] = _parse(path, module)
                self._new = True
            self._sources[module] = source
        return self._sources[module]

    def closure(self, modules: Iterable[str]) -> set[str]:
        """Return these modules and all of the package that they import, directly or not."""
        reached: set[str] = set()
        pending = list(modules)
        while pending:
            module = pending.pop()
            if module not in reached:
                reached.add(module)
                for imported in self.source(module).imports:
                    pending += self._targets(imported)
        self._save()
        return reached

    def data_files(self, modules: Iterable[str]) -> list[Path]:
        """Return the data that modules may read.

        That is all data in their folders, and in those subfolders without sources that one of
        the modules names.
        """
        texts: dict[Path, set[str]] = {}
        for module in modules:
            path = self.file_of(module)
            assert path is not None
            texts.setdefault(path.parent, set()).update(self.source(module).texts)
        return sorted(
            path
            for folder, named in texts.items()
            for path in _data_in(folder)
            if path.parent == folder or any(path.parent.name in text for text in named)
        )

    def _targets(self, imported: Import) -> list[str]:
        """Return the modules that one import depends on; none if it is of another package.

        A name that a package only offers depends on the module that defines it, not on those of
        the other names.
        """
        module, name = imported.module, imported.name
        if self.file_of(module) is None:
            return []
        below = f"{module}.{name}"
        is_module = bool(name) and self.file_of(below) is not None
        source = self.source(module)
        if is_module and name not in source.bound:
            return [below]
        if source.only_offers and any(each.name == name for each in source.imports):
            origins = [each for each in source.imports if each.name == name]
            return [target for each in origins for target in self._targets(each)]
        offered = [each for each in source.offered if each.name == name and each != imported]
        targets = [target for each in offered for target in self._targets(each)]
        return [module, *targets, *([below] if is_module else [])]

    def _read_index(self) -> dict[str, Source]:
        """Read what an earlier process kept; nothing if the file is damaged."""
        try:
            return msgspec.json.decode(self._index.read_bytes(), type=dict[str, Source])
        except (OSError, msgspec.DecodeError):
            return {}

    def _save(self) -> None:
        if self._new:
            self._new = False
            content = msgspec.json.encode({**self._read_index(), **self._parsed})
            with suppress(OSError):
                write_atomically(self._index, lambda part: part.write_bytes(content))


@cache
def package(root: Path) -> Package:
    """Return the package in a folder; its files are read once in a process."""
    return Package(root)


def _parse(path: Path, module: str) -> Source:
    """Return the parts of a source file that count. module: its dotted name."""
    state, tree = path.stat(), ast.parse(path.read_bytes())
    # Relative imports begin at the package of the module, which may be the module itself.
    place = module if path.name == "__init__.py" else module.rpartition(".")[0]
    bound = {name for node in tree.body for name in _bound_by(node)}
    for_checkers = [node for node in tree.body if _is_for_checkers(node)]
    offered = [
        i for block in for_checkers for node in ast.walk(block) for i in _imports(node, place)
    ]
    digest, nodes = _counted(tree)
    constants = [node.value for node in nodes if isinstance(node, ast.Constant)]
    texts = [text for text in constants if isinstance(text, str) and text]
    return Source(
        state.st_mtime_ns,
        state.st_size,
        digest=digest,
        imports=tuple(dict.fromkeys(each for node in nodes for each in _imports(node, place))),
        libraries=tuple(sorted(NUMERICAL_LIBRARIES & _imported_packages(nodes))),
        bound=tuple(sorted(bound)),
        offered=tuple(dict.fromkeys(offered)) if "__getattr__" in bound else (),
        texts=tuple(dict.fromkeys(text for text in texts if not set(text) & set(" \n"))),
        only_offers=path.name == "__init__.py" and all(map(_only_offers, tree.body)),
    )


class _Counted(NamedTuple):
    """What counts of a syntax tree: its digest, and its nodes without contexts of names."""

    digest: str
    nodes: list[ast.AST]


def _counted(tree: ast.AST) -> _Counted:
    """Walk a syntax tree once, past docstrings and statements that only type checkers read.

    Contexts of names are left out: they follow from where a name stands.
    """
    nodes: list[ast.AST] = []
    parts: list[str] = []
    pending: list[Any] = [tree]
    while pending:
        item = pending.pop()
        if isinstance(item, ast.AST):
            nodes.append(item)
            parts.append(type(item).__name__)
            names = [name for name in reversed(item._fields) if name != "ctx"]
            pending += [getattr(item, name, None) for name in names]
        elif isinstance(item, list):
            items = list(_counted_items(item))
            parts.append(f"[{len(items)}]")
            pending += reversed(items)
        else:
            parts.append(repr(item))
    return _Counted(sha256("\n".join(parts).encode()).hexdigest(), nodes)


def _counted_items(items: Iterable[Any]) -> Iterator[Any]:
    """Yield the items of a list in a syntax tree that count for hashes.

    Docstrings, and blocks that only type checkers read, do not; the `else` of such a block does.
    """
    for item in items:
        if _is_for_checkers(item):
            yield from _counted_items(item.orelse)
        elif not (
            isinstance(item, ast.Expr)
            and isinstance(item.value, ast.Constant)
            and isinstance(item.value.value, str)
        ):
            yield item


def _is_for_checkers(node: object) -> bool:
    """Whether this is `if TYPE_CHECKING:` or `if typing.TYPE_CHECKING:`."""
    if not isinstance(node, ast.If):
        return False
    name = getattr(node.test, "id", getattr(node.test, "attr", ""))
    return bool(name == "TYPE_CHECKING")


def _imports(node: ast.AST, place: str) -> list[Import]:
    """Return what a statement of a module in the package `place` imports from its own package."""
    if isinstance(node, ast.Import):
        imported = [Import(alias.name) for alias in node.names]
    elif isinstance(node, ast.ImportFrom):
        source = resolve_name("." * node.level + (node.module or ""), place)
        imported = [Import(source, alias.name) for alias in node.names]
    else:
        return []
    package_name = place.partition(".")[0]
    return [each for each in imported if each.module.partition(".")[0] == package_name]


def _bound_by(node: ast.AST) -> Iterator[str]:
    """Yield the names that a statement of the top level binds."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        yield node.name
    elif isinstance(node, ast.Import | ast.ImportFrom):
        yield from (alias.asname or alias.name.partition(".")[0] for alias in node.names)
    elif not _is_for_checkers(node):
        yield from (
            part.id
            for part in ast.walk(node)
            if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store)
        )


def _only_offers(node: ast.stmt) -> bool:
    """Whether a statement imports names or lists them as `__all__`."""
    if isinstance(node, ast.Assign):
        return [getattr(target, "id", "") for target in node.targets] == ["__all__"]
    if isinstance(node, ast.ImportFrom):
        return all(alias.asname is None for alias in node.names)
    return False


@cache
def _data_in(folder: Path) -> tuple[Path, ...]:
    """Return data files of a folder and of its subfolders without sources."""
    paths = [path for path in folder.iterdir() if path.suffix in DATA_KINDS]
    for below in folder.iterdir():
        if below.is_dir() and not any(below.rglob("*.py")):
            paths += [path for path in below.rglob("*") if path.suffix in DATA_KINDS]
    return tuple(paths)


# --------------------------------------------------------------------------------------------------
# Sources of plug-ins that are not part of roadscope


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
    texts: string constants of one line, which may name data files or their folders.
    """

    digest: str
    imports: frozenset[str]
    texts: frozenset[str]


@lru_cache(REMEMBERED_SOURCES)
def _parsed_plugin(content: bytes) -> _PluginSource:
    try:
        digest, nodes = _counted(ast.parse(content))
    except PARSE_ERRORS:
        return _PluginSource(sha256(content).hexdigest(), frozenset(), frozenset())
    constants = (node.value for node in nodes if isinstance(node, ast.Constant))
    texts = (text for text in constants if isinstance(text, str) and 0 < len(text) < 256)
    named = frozenset(text for text in texts if not set(text) & set("\n\0"))
    return _PluginSource(digest, _imported_packages(nodes), named)


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
    `/proc` and devices are.
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
    others = (path for path in reached - set(sources) if path.is_file())
    return sorted(path for path in others if path.stat().st_size)


def _existing(folder: Path, names: Collection[str]) -> list[str]:
    """Return which names there are in a folder; a name may also be `..` or the root."""
    if len(names) <= MOST_TRIED:
        return [name for name in names if os.path.lexists(folder / name)]
    listed = {os.pardir, os.sep, *(each.name for each in folder.iterdir())}
    return [name for name in names if name in listed]


def _imported_packages(nodes: Iterable[ast.AST]) -> frozenset[str]:
    """Return the first parts of the names of all modules that a syntax tree's nodes import."""
    names: list[str] = []
    for node in nodes:
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names += [node.module] if node.module else [alias.name for alias in node.names]
    return frozenset(name.partition(".")[0] for name in names)


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
