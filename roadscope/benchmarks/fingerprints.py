"""Hashes of everything that a result depends on beside plug-ins: values, our code, libraries.

Sources count by their syntax trees. A file of roadscope is parsed once: its digest and its imports
are kept in the cache folder.
"""

from __future__ import annotations

import ast
import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from importlib.util import resolve_name
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from roadscope.benchmarks.cache import cache_dir, write_atomically

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
    digest, nodes = counted_nodes(tree)
    constants = [node.value for node in nodes if isinstance(node, ast.Constant)]
    texts = [text for text in constants if isinstance(text, str) and text]
    return Source(
        state.st_mtime_ns,
        state.st_size,
        digest=digest,
        imports=tuple(dict.fromkeys(each for node in nodes for each in _imports(node, place))),
        libraries=tuple(sorted(NUMERICAL_LIBRARIES & imported_packages(nodes))),
        bound=tuple(sorted(bound)),
        offered=tuple(dict.fromkeys(offered)) if "__getattr__" in bound else (),
        texts=tuple(dict.fromkeys(text for text in texts if not set(text) & set(" \n"))),
        only_offers=path.name == "__init__.py" and all(map(_only_offers, tree.body)),
    )


class _Counted(NamedTuple):
    """What counts of a syntax tree: its digest, and its nodes without contexts of names."""

    digest: str
    nodes: list[ast.AST]


def counted_nodes(tree: ast.AST) -> _Counted:
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


def imported_packages(nodes: Iterable[ast.AST]) -> frozenset[str]:
    """Return the first parts of the names of all modules that a syntax tree's nodes import."""
    names: list[str] = []
    for node in nodes:
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names += [node.module] if node.module else [alias.name for alias in node.names]
    return frozenset(name.partition(".")[0] for name in names)


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
