"""The error text for an unknown name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def unknown(kind: str, name: str, possible: Iterable[str], *, hint: str = "") -> str:
    """Return the text of an error: a name does not exist, which similar one does, and which do.

    hint: shown in place of the similar name.
    """
    names = list(possible)
    close = difflib.get_close_matches(name, names, n=1)
    if hint:
        hint = f" ({hint})"
    elif close:
        hint = f" (did you mean '{close[0]}'?)"
    return f"no {kind} '{name}'{hint}; known: {', '.join(names)}"
