"""The error text for an unknown name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def unknown(kind: str, name: str, possible: Iterable[str], *, hint: str = "") -> str:
    """Return the error text for a name that does not exist.

    It offers the most similar of the possible names, and lists them all.

    hint: shown in place of the most similar name.
    """
    names = list(possible)
    close = difflib.get_close_matches(name, names, n=1)
    if hint:
        hint = f" ({hint})"
    elif close:
        hint = f" (did you mean '{close[0]}'?)"
    return f"no {kind} '{name}'{hint}; known: {', '.join(names)}"
