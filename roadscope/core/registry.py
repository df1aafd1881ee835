"""Plug-ins by name: a registered name, `module:Class` or `path/file.py:Class`, with arguments.

Every spec may end in arguments, `nearest?gate_m=2.5&coast_frames=20`; values are read as Python
literals and otherwise taken as text. Packages add names by entry points.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.metadata import (
    PackageNotFoundError,
    entry_points,
    packages_distributions,
    version,
)
from pathlib import Path
from types import NoneType
from typing import Any, Generic, TypeVar, cast, get_args

from roadscope.core.names import unknown

T = TypeVar("T")
LOADERS = (__file__, importlib.__file__)
KINDS: Mapping[Any, str] = {bool: "True or False", int: "a whole number", float: "a number"}


class SpecError(ValueError):
    """A plug-in could not be named, loaded or made."""


class NotInstalledError(SpecError):
    """A plug-in needs a distribution that is not there."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """What a plug-in needs and this package does not bring; its class says so as `requires`.

    distribution: its name on the package index.
    command: what installs it.
    """

    distribution: str
    command: str

    @property
    def version(self) -> str | None:
        """The installed version, or None."""
        try:
            return version(self.distribution)
        except PackageNotFoundError:
            return None

    @property
    def missing(self) -> str | None:
        """Why the plug-in cannot be made, or None if it can."""
        if self.version is not None:
            return None
        return f"{self.distribution} is not installed: {self.command}"


@dataclass(frozen=True)
class Plugin(Generic[T]):
    """A plug-in that is known but not yet made.

    spec: the string that names it, as the user wrote it.
    factory: its class.
    arguments: keyword arguments given in the spec.
    ours: whether it ships with this package.
    """

    spec: str
    factory: Callable[..., T]
    arguments: Mapping[str, Any]
    ours: bool

    @property
    def requirement(self) -> Requirement | None:
        """What it needs beside this package, if anything."""
        found = getattr(self.factory, "requires", None)
        return found if isinstance(found, Requirement) else None

    @property
    def missing(self) -> str | None:
        """Why it cannot be made here, or None if it can."""
        return self.requirement.missing if self.requirement else None

    def make(self) -> T:
        """Construct the plug-in; wrong arguments are named, and what is not installed."""
        try:
            inspect.signature(self.factory).bind(**self.arguments)
        except TypeError as error:
            known = ", ".join(_describe_parameters(self.factory)) or "none"
            raise SpecError(f"'{self.spec}': {error}; its arguments: {known}") from error
        if self.ours and (wrong := _wrong_kind(self.factory, self.arguments)):
            raise ValueError(wrong)
        if self.missing:
            raise NotInstalledError(self.missing)
        return self.factory(**self.arguments)


class Registry(Generic[T]):
    """Names of one kind of plug-in."""

    def __init__(
        self,
        kind: str,
        entries: Mapping[str, str],
        *,
        group: str | None = None,
        summaries: Mapping[str, str] | None = None,
        made: str = "",
    ) -> None:
        """Take the kind's name, names with their specs, and the entry point group to join.

        summaries: one line for a reader, by name. made: how one is put together from parts.
        """
        self.kind, self._made = kind, made
        self.summaries = dict(summaries or {})
        self._entries = dict(entries)
        self._group = group

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __contains__(self, name: object) -> bool:
        return name in self.names()

    def names(self) -> list[str]:
        """All registered names, our own first, then those of installed packages."""
        return list(self._entries) + sorted(set(self._external()) - set(self._entries))

    def installed(self) -> list[str]:
        """Those of `names` that can be made here."""
        return [name for name in self.names() if not self.missing(name)]

    def missing(self, spec: str) -> str | None:
        """Say what is not installed that the spec needs, or None if it can be made."""
        return self.resolve(spec).missing

    def target(self, name: str) -> str:
        """Return the spec behind a registered name."""
        found = self._entries.get(name) or self._external().get(name)
        if found is None:
            raise SpecError(self._unknown(name))
        return found

    def make(self, spec: str) -> T:
        """Construct the plug-in that the spec names."""
        return self.resolve(spec).make()

    def resolve(self, spec: str) -> Plugin[T]:
        """Find the class and the arguments that the spec names, without making it."""
        name, arguments = split_spec(spec)
        if ":" not in name:
            if name.endswith(".py"):
                raise SpecError(f"'{spec}': name the class in the file too: {name}:Class")
            target, defaults = split_spec(self.target(name))
            arguments = {**defaults, **arguments}
        else:
            target = name
        return Plugin(spec, self._load(target), arguments, target.startswith("roadscope."))

    def _external(self) -> dict[str, str]:
        if self._group is None:
            return {}
        return {point.name: point.value for point in entry_points(group=self._group)}

    def _unknown(self, name: str) -> str:
        made = f"or put one together: {self._made}; " if self._made else ""
        return (
            f"{unknown(self.kind, name, self.names())}; {made}"
            "or name your own: package.module:Class, path/to/file.py:Class"
        )

    def _load(self, target: str) -> Callable[..., T]:
        place, _, attribute = target.rpartition(":")
        if not place:
            raise SpecError(f"'{target}' names no module or file before the colon")
        if not attribute:
            raise SpecError(f"'{target}': name a class after the colon: {place}:Class")
        module = _import_file(Path(place)) if place.endswith(".py") else _import_module(place)
        try:
            found = getattr(module, attribute)
        except AttributeError:
            known = [
                name
                for name, value in vars(module).items()
                if inspect.isclass(value) and value.__module__ == module.__name__ and name[0] != "_"
            ]
            raise SpecError(
                f"no class '{attribute}' in {place}; it has: {', '.join(known) or 'no class'}"
            ) from None
        if not inspect.isclass(found):
            raise SpecError(f"'{target}' is not a class")
        return cast("Callable[..., T]", found)


def split_spec(spec: str) -> tuple[str, dict[str, Any]]:
    """Split `name?a=1&b=x` into the name and its arguments."""
    name, _, query = spec.partition("?")
    if not name:
        raise SpecError(f"'{spec}' names nothing")
    arguments: dict[str, Any] = {}
    for item in filter(None, query.split("&")):
        key, equals, text = item.partition("=")
        if not equals or not key.isidentifier():
            raise SpecError(f"'{spec}': arguments look like name?key=value&key=value, got '{item}'")
        arguments[key] = _literal(text)
    return name, arguments


def source_hash(plugin: Plugin[Any]) -> str:
    """Hash what a plug-in's class was loaded from: 16 hexadecimal digits.

    That is its file, the files and packages beside it that it imports (helpers and base
    classes) and, for an installed package, its version, and that of what it `requires`.
    """
    module = str(getattr(plugin.factory, "__module__", ""))
    path = getattr(sys.modules.get(module), "__file__", None)
    if path is None:
        return sha256(repr(plugin.factory).encode()).hexdigest()[:16]
    digest = sha256(_distribution_version(module).encode())
    if plugin.requirement:
        needed = plugin.requirement
        digest.update(f"{needed.distribution}={needed.version}".encode())
    files: set[Path] = set()
    _collect_sources(Path(path).resolve(), files)
    for file in sorted(files):
        digest.update(file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _collect_sources(file: Path, files: set[Path]) -> None:
    """Add a file and, by its import statements, those beside it that it needs."""
    if file in files:
        return
    files.add(file)
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module] if node.module else [alias.name for alias in node.names]
        else:
            continue
        for top in {name.partition(".")[0] for name in names}:
            beside = file.parent / f"{top}.py"
            for found in [beside] if beside.is_file() else (file.parent / top).rglob("*.py"):
                _collect_sources(found, files)


def _distribution_version(module: str) -> str:
    names = _distributions().get(module.partition(".")[0], [])
    return ",".join(f"{name}={version(name)}" for name in sorted(set(names)))


@cache
def _distributions() -> Mapping[str, list[str]]:
    """Read once which distribution each package is of: it takes a third of a second."""
    return packages_distributions()


def _literal(text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return {"true": True, "false": False, "none": None}.get(text.lower(), text)


def _describe_parameters(factory: Callable[..., Any]) -> list[str]:
    return [
        p.name if p.default is p.empty else f"{p.name}={p.default}"
        for p in inspect.signature(factory).parameters.values()
    ]


def _wrong_kind(factory: Callable[..., Any], arguments: Mapping[str, Any]) -> str:
    """Say which argument is of another kind than its annotation says; empty if none is.

    Annotations other than bool, int, float and None, alone or in a union, say nothing here.
    """
    parameters = inspect.signature(factory, eval_str=True).parameters
    for name, value in arguments.items():
        if name not in parameters or value is None:
            continue
        annotation = parameters[name].annotation
        kinds = set(get_args(annotation) or (annotation,)) - {NoneType}
        if not kinds or not kinds <= KINDS.keys():
            continue
        # A whole number is a number; True is none.
        taken = kinds | ({int} if float in kinds else set())
        if type(value) not in taken:
            expected = " or ".join(words for kind, words in KINDS.items() if kind in kinds)
            return f"{name} must be {expected}, got {value!r}"
    return ""


def _import_module(name: str) -> Any:
    if str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SpecError(f"cannot import '{name}': {error}{_where(error)}") from error
    except (Exception, SystemExit) as error:
        raise SpecError(_fails(name, error)) from error


def _import_file(path: Path) -> Any:
    if not path.is_file():
        raise SpecError(f"no file {path}")
    name = "roadscope_plugin_" + sha256(str(path.resolve()).encode()).hexdigest()[:12]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise SpecError(_fails(path, error)) from error
    return module


def _fails(place: object, error: BaseException) -> str:
    return f"{place} fails when loaded: {type(error).__name__}: {error}{_where(error)}"


def _where(error: BaseException) -> str:
    """Say at which line of the module that is loaded; empty where it was not found or read."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename not in LOADERS and not frame.filename.startswith("<frozen importlib")
    ]
    lines = [frame.lineno for frame in frames if frame.filename == frames[0].filename]
    return f" ({Path(frames[0].filename).name}:{lines[-1]})" if frames else ""
