"""The error text for an unknown name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST_LIST = 15
"""Most names that are listed beside a suggestion; chosen by hand."""


def unknown(kind: str, name: str, possible: Iterable[str], *, hint: str = "") -> str:
    """Return the error text for a name that does not exist.

    It suggests the most similar of the possible names, if one is similar. It lists all of them,
    unless one is similar and there are more than `LONGEST_LIST`: then it says how many there are.

    hint: shown in place of the most similar name.
    """
    names = list(possible)
    close = [] if name in names else difflib.get_close_matches(name, names, n=1)
    known = ", ".join(names)
    if close and len(names) > LONGEST_LIST:
        known = f"{close[0]} and {len(names) - 1} others"
    if hint:
        hint = f" ({hint})"
    elif close:
        hint = f" (did you mean '{close[0]}'?)"
    return f"no {kind} '{name}'{hint}; known: {known}"
