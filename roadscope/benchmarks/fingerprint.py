"""Hashes that change whenever what a result depends on changes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.core.registry import Plugin, source_hash

PACKAGE = Path(__file__).resolve().parents[1]
LIBRARIES = ("highway-env", "numpy", "scipy", "numba", "filterpy")
"""Whose versions may change a score."""
KINDS = (".py", ".toml", ".json", ".npz", ".safetensors")
"""Files that decide: sources, and what was learned."""


def fingerprint(value: Any) -> str:
    """Hash plain values, arrays and dataclasses by content: 16 hexadecimal digits."""
    text = json.dumps(_plain(value), sort_keys=True, separators=(",", ":"))
    return sha256(text.encode()).hexdigest()[:16]


@cache
def code_hash(*rooms: str) -> str:
    """Hash all sources and data of rooms of this package, such as `core`, or single files of it."""
    digest = sha256()
    for room in sorted(rooms):
        place = PACKAGE / room
        paths = (
            [place]
            if place.is_file()
            else sorted(file for file in place.rglob("*.*") if file.suffix in KINDS)
        )
        if not paths:
            raise FileNotFoundError(f"no source file of the package in {place}")
        for path in paths:
            digest.update(str(path.relative_to(PACKAGE)).encode() + b"\0")
            digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def sensing_hash() -> str:
    """Hash what frames and truth are made by: our code and the versions of what it calls."""
    return fingerprint([code_hash("core", "envs"), [package_version(n) for n in LIBRARIES]])


def plugin_hash(plugin: Plugin[Any]) -> str:
    """Hash a plug-in's source, arguments and files that these name; ours with their whole room."""
    room = str(getattr(plugin.factory, "__module__", "")).split(".")
    shared = code_hash(room[1]) if plugin.ours and len(room) > 1 else ""
    source = _source_of_ours(plugin.factory) if plugin.ours else source_hash(plugin)
    return fingerprint([source, shared, dict(plugin.arguments), _named_files(plugin.arguments)])


def _named_files(arguments: Mapping[str, Any]) -> list[str]:
    """Return the hashes of data that arguments name, such as learned traits of one's own."""
    texts = [value for value in arguments.values() if str(value).endswith(KINDS)]
    return [sha256(Path(text).read_bytes()).hexdigest() for text in texts if _is_file(text)]


def _is_file(text: str) -> bool:
    try:
        return Path(text).is_file()
    except (OSError, ValueError):
        return False


@cache
def _source_of_ours(factory: Callable[..., Any]) -> str:
    """Hash once what does not change while a process runs: a file of a user's may."""
    return source_hash(Plugin("", factory, {}, True))


@cache
def package_version(name: str) -> str:
    """Return the installed version of a distribution, or `not installed`."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _plain(value: Any) -> Any:
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
