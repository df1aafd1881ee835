"""Tables of arrays, one row for each target."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np


class Rows:
    """Base of frozen, slotted dataclasses whose fields are arrays, or again rows, of N each."""

    __slots__ = ()
    __dataclass_fields__: ClassVar[dict[str, Any]]

    def select(self, index: np.ndarray) -> Self:
        """Keep the rows that a mask or an index array names."""
        if index.dtype == bool:
            index = np.flatnonzero(index)
        return type(self)(*[
            value.select(index) if isinstance(value, Rows) else value.take(index, axis=0)
            for value in self._columns()
        ])  # fmt: skip

    def joined(self, other: Self) -> Self:
        """Put the rows of another below."""
        return type(self)(*[
            value.joined(below) if isinstance(value, Rows) else np.concatenate((value, below))
            for value, below in zip(self._columns(), other._columns(), strict=True)
        ])  # fmt: skip

    def replaced(self, rows: np.ndarray, other: Self) -> Self:
        """Put another's rows in place of those that an index array names."""
        values = []
        for value, into in zip(self._columns(), other._columns(), strict=True):
            if isinstance(value, Rows):
                values.append(value.replaced(rows, into))
                continue
            changed = value.copy()
            changed[rows] = into
            values.append(changed)
        return type(self)(*values)

    def _columns(self) -> list[Any]:
        return [getattr(self, name) for name in self.__dataclass_fields__]
