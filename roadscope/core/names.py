"""The error text for an unknown name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST_LIST = 12
"""Names; longer lists hide what is suggested."""


def unknown(kind: str, name: str, possible: Iterable[str], *, hint: str = "") -> str:
    """Return the error text for a name that does not exist.

    It offers the most similar of the possible names. All are listed, but for long lists of which
    one name is similar.

    hint: shown in place of the most similar name.
    """
    names = list(possible)
    close = difflib.get_close_matches(name, names, n=1)
    listed = not close or len(names) <= LONGEST_LIST
    if hint:
        hint = f" ({hint})"
    elif close:
        hint = f" (did you mean '{close[0]}'?)"
    return f"no {kind} '{name}'{hint}" + (f"; known: {', '.join(names)}" if listed else "")
