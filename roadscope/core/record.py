"""The base of all records: frozen values that compare by content, arrays included."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, ClassVar, Self

import numpy as np


class Record:
    """Base of frozen, slotted dataclasses made with `eq=False`.

    Two records are equal when they have the same type and all fields are equal; arrays are
    equal when shape, dtype and values are (NaN equals NaN).
    """

    __slots__ = ()
    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return all(
            same_value(getattr(self, field.name), getattr(other, field.name))
            for field in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]

    def _trusted(self, **changes: object) -> Self:
        """Return a copy with changed fields, unchecked: for values taken from checked records."""
        copy = object.__new__(type(self))
        for name in self.__dataclass_fields__:
            value = changes[name] if name in changes else getattr(self, name)
            if name in changes and isinstance(value, np.ndarray):
                value = np.ascontiguousarray(value)
            object.__setattr__(copy, name, value)
        return copy


def same_value(a: object, b: object) -> bool:
    """Compare two field values, arrays by content."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        if not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray)):
            return False
        equal_nan = a.dtype.kind in "fc" and b.dtype.kind in "fc"
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=equal_nan)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(same_value, a, b))
    return bool(a == b)
