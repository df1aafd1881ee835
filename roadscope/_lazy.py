"""Names that a package offers and loads when they are first used (PEP 562)."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

NOTHING: Mapping[str, str] = MappingProxyType({})


def lazy_names(
    package: str, places: Mapping[str, str] = NOTHING, parts: Mapping[str, str] = NOTHING
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package whose names are defined elsewhere.

    package: its `__name__`; its `__all__`, if it has one, holds all that is public, these names
    too. places: name -> `module:attribute`, or `module` for a whole module. parts: file of the
    package, without its ending -> names that it defines, with spaces between them. What was
    loaded once is an ordinary attribute of the package from then on.
    """
    known = {
        name: f"{package}.{file}:{name}" for file, names in parts.items() for name in names.split()
    } | dict(places)

    def load(name: str) -> Any:
        place = known.get(name)
        if place is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, _, attribute = place.partition(":")
        value = importlib.import_module(module)
        if attribute:
            value = getattr(value, attribute)
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        module = vars(sys.modules[package])
        public = module.get("__all__", known)
        return sorted({*public, *(name for name in module if name[:2] == "__")})

    return load, names
