"""Hashes of everything that a result depends on: values, our code, plug-ins, libraries."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from roadscope.benchmarks.sources import DATA_KINDS, package, source_hash
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
    plug-in its file, the files beside it and the version of its distribution (`source_hash`),
    without importing it; of an oracle its parts.
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
    return fingerprint([source, dict(spec.arguments), _named_files(spec.arguments)])


def _named_files(arguments: Mapping[str, Any]) -> list[str]:
    """Return the hashes of files that arguments name, such as weights."""
    texts = [value for value in arguments.values() if str(value).endswith((".py", *DATA_KINDS))]
    return [sha256(Path(text).read_bytes()).hexdigest() for text in texts if _is_file(text)]


def _is_file(text: str) -> bool:
    try:
        return Path(text).is_file()
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
