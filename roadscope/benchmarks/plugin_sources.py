"""What a plug-in that is not ours is made from."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from functools import cache
from hashlib import sha256
from importlib.metadata import packages_distributions, version
from pathlib import Path

from roadscope.benchmarks.sources import source_digest
from roadscope.core.loading import SpecError, file_of


def source_hash(target: str) -> str:
    """Hash what `module:Class` or `path/file.py:Class` is made from: 16 hexadecimal digits.

    That is its file and the files beside it that it imports; in a package all files of the package
    and the version of its distribution. Of each file its syntax tree counts, without comments and
    docstrings. Files are read, nothing is imported.
    """
    place, _, name = target.rpartition(":")
    file = file_of(place)
    if file is None:
        raise SpecError(f"no file or module {place}")
    digest = sha256(f"{_distribution_version(place)} {name}".encode())
    package = _package_of(file.resolve())
    for each in sorted(package.rglob("*.py")) if package else _source_files(file):
        digest.update(_digest(each.read_bytes()).encode() + b"\0")
    return digest.hexdigest()[:16]


def _digest(content: bytes) -> str:
    """Return the digest of a source: of its syntax tree, or of its bytes if it has none."""
    try:
        return source_digest(content)
    except (SyntaxError, ValueError):
        return sha256(content).hexdigest()


def _package_of(file: Path) -> Path | None:
    """Return the folder of the topmost package that a file is in; None: it is in no package."""
    folders = [folder for folder in file.parents if (folder / "__init__.py").is_file()]
    inside = [f for k, f in enumerate(folders) if f == file.parents[k]]
    return inside[-1] if inside else None


def _source_files(file: Path) -> list[Path]:
    """Return a plug-in's file and the files and packages beside it that it imports, sorted."""
    files: set[Path] = set()
    ahead = [file.resolve()]
    while ahead:
        here = ahead.pop()
        if here in files:
            continue
        files.add(here)
        try:
            tree = ast.parse(here.read_bytes())
        except (SyntaxError, ValueError):
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module] if node.module else [alias.name for alias in node.names]
            else:
                continue
            for top in {name.partition(".")[0] for name in names}:
                beside = here.parent / f"{top}.py"
                ahead += [beside] if beside.is_file() else (here.parent / top).rglob("*.py")
    return sorted(files)


def _distribution_version(module: str) -> str:
    names = _distributions().get(module.partition(".")[0], [])
    return ",".join(f"{name}={version(name)}" for name in sorted(set(names)))


@cache
def _distributions() -> Mapping[str, list[str]]:
    """Read once which distribution each package is of: it takes a third of a second."""
    return packages_distributions()
