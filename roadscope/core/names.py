"""What is said of a name that nothing bears."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def unknown(kind: str, name: str, known: Iterable[str], *, hint: str = "") -> str:
    """Say that a name does not exist, which one may be meant, and which do.

    hint: what stands in place of the name that is spelled most alike.
    """
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1)
    if hint:
        hint = f" ({hint})"
    elif close:
        hint = f" (did you mean '{close[0]}'?)"
    return f"no {kind} '{name}'{hint}; known: {', '.join(names)}"
