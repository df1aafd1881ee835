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
        return self._made(lambda value: value[index], lambda value: value.select(index))

    def joined(self, other: Self) -> Self:
        """Put the rows of another below."""
        return self._made(
            lambda value, below: np.concatenate([value, below]),
            lambda value, below: value.joined(below),
            other,
        )

    def replaced(self, rows: np.ndarray, other: Self) -> Self:
        """Put another's rows in place of those that an index array names."""

        def put(value: np.ndarray, into: np.ndarray) -> np.ndarray:
            changed = value.copy()
            changed[rows] = into
            return changed

        return self._made(put, lambda value, into: value.replaced(rows, into), other)

    def _made(self, of_arrays: Any, of_rows: Any, *others: Self) -> Self:
        values = []
        for name in self.__dataclass_fields__:
            given = [getattr(each, name) for each in (self, *others)]
            values.append((of_rows if isinstance(given[0], Rows) else of_arrays)(*given))
        return type(self)(*values)
