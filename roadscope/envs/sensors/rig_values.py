"""Keys and values of a rig's file, each refused with what was expected."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from roadscope.core import RecordError

ANGLES = ("yaw", "pitch", "roll")
MOUNT_KEYS = ("x_m", "y_m", "z_m", *(f"{angle}_deg" for angle in ANGLES))


def known_keys(table: Mapping[str, Any], keys: Sequence[str]) -> None:
    """Refuse a table with any other key."""
    for key in table:
        if key not in keys:
            close = difflib.get_close_matches(key, keys, n=1)
            hint = f" (did you mean '{close[0]}'?)" if close else ""
            raise RecordError(f"unknown key '{key}'{hint}; known: {', '.join(keys)}")


def name_of(key: str, value: object, kind: str, names: Iterable[str]) -> str:
    """Return the name of a sensor of that kind."""
    if value is None:
        raise RecordError(f"no key '{key}'; it names one of: {', '.join(names)}")
    if not isinstance(value, str) or value not in names:
        raise RecordError(f"no {kind} {value!r}; known: {', '.join(names)}")
    return value


def number(key: str, value: object) -> float:
    """Return a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RecordError(f"{key}: expected a number, got {value!r}")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise RecordError(f"{key}: expected a finite number, got {found}")
    return found


def switch(key: str, value: object) -> bool:
    """Return true or false."""
    if not isinstance(value, bool):
        raise RecordError(f"{key}: expected true or false, got {value!r}")
    return value
