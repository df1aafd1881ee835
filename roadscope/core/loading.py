"""Classes of plug-ins, loaded from a module or from a file."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
import traceback
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from roadscope.core.text import error_text

LOADERS = (__file__, importlib.__file__)
"""Files whose lines are left out when an error in a plug-in's module is located."""
PARSE_ERRORS = (SyntaxError, ValueError, RecursionError, MemoryError)
"""What `ast.parse` raises for a text that is not Python, or whose expressions nest too deeply."""


class SpecError(ValueError):
    """A plug-in could not be named, loaded or made."""


class LoadingError(SpecError):
    """The code of a plug-in's module raised an exception when it was loaded."""


class NotInstalledError(SpecError):
    """A plug-in needs a distribution that is not installed."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """A distribution that a plug-in needs and roadscope does not install.

    The plug-in's class has it as its attribute `requires`.

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


def load_class(target: str) -> type[Any]:
    """Return the class that `module:Class` or `path/file.py:Class` names.

    `SpecError` says what is wrong with the name, the syntax or the imports of the module;
    `LoadingError` says what else the module raised and in which line.
    """
    place, _, attribute = target.rpartition(":")
    if not place:
        raise SpecError(f"'{target}' names no module or file before the colon")
    if not attribute:
        raise SpecError(f"'{target}': name a class after the colon: {place}:Class")
    module = _import_file(Path(place)) if place.endswith(".py") else _import_module(place)
    try:
        value = getattr(module, attribute)
    except AttributeError:
        classes = [
            name
            for name, member in vars(module).items()
            if inspect.isclass(member) and member.__module__ == module.__name__ and name[0] != "_"
        ]
        raise SpecError(
            f"no class '{attribute}' in {place}; it has: {', '.join(classes) or 'no class'}"
        ) from None
    if not inspect.isclass(value):
        raise SpecError(f"'{target}' is not a class")
    return value


def file_of(place: str) -> Path | None:
    """Return the file of a module or the file itself, None if there is none; imports nothing.

    The working directory is put last on `sys.path`, as `load_class` does it.
    """
    if place.endswith(".py"):
        return Path(place) if Path(place).is_file() else None
    first, *rest = place.split(".")
    if str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))
    top = importlib.util.find_spec(first)
    if top is None:
        return None
    if not rest:
        return Path(top.origin) if top.origin and Path(top.origin).is_file() else None
    for folder in top.submodule_search_locations or ():
        stem = Path(folder).joinpath(*rest)
        for path in (stem / "__init__.py", stem.with_name(f"{stem.name}.py")):
            if path.is_file():
                return path
    return None


def _import_module(name: str) -> Any:
    if str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))
    try:
        return importlib.import_module(name)
    except ImportError as error:
        text = error_text(error).partition(": ")[2]
        raise SpecError(f"cannot import '{name}': {text}{_where(error)}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise _loading_error(name, error) from error


def _import_file(path: Path) -> Any:
    """Import a file; the files beside it come first on the path, as where Python runs it."""
    if not path.is_file():
        raise SpecError(f"no file {path}")
    folder = str(path.resolve().parent)
    sys.path[:] = [folder, *(place for place in sys.path if place != folder)]
    name = "roadscope_plugin_" + sha256(str(path.resolve()).encode()).hexdigest()[:12]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        sys.modules.pop(name, None)
        if isinstance(error, KeyboardInterrupt):
            raise
        raise _loading_error(path, error) from error
    return module


def _loading_error(place: object, error: BaseException) -> SpecError:
    kind = SpecError if isinstance(error, ImportError | SyntaxError) else LoadingError
    return kind(f"{place} fails when loaded: {error_text(error)}{_where(error)}")


def _where(error: BaseException) -> str:
    """Return the line of the loaded module in which the error arose; empty if none of it ran."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename not in LOADERS and not frame.filename.startswith("<frozen importlib")
    ]
    lines = [frame.lineno for frame in frames if frame.filename == frames[0].filename]
    return f" ({Path(frames[0].filename).name}:{lines[-1]})" if frames else ""
