"""Tables whose columns are arrays with equal numbers of rows."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np


def rows_of(index: np.ndarray, count: int) -> np.ndarray:
    """Return the rows that a mask or an index array selects; `IndexError` for any other mask."""
    index = np.asarray(index)
    if index.dtype != np.bool_:
        return index
    if index.shape != (count,):
        raise IndexError(f"a mask of shape {index.shape} does not fit {count} rows")
    return np.flatnonzero(index)


class ArrayTable:
    """Base of frozen, slotted dataclasses whose fields are arrays of N rows, or such tables."""

    __slots__ = ()
    __dataclass_fields__: ClassVar[dict[str, Any]]

    def select(self, index: np.ndarray) -> Self:
        """Return the rows that a mask or an index array selects."""
        rows = rows_of(index, self._row_count())
        columns = [
            column.select(rows) if isinstance(column, ArrayTable) else column.take(rows, axis=0)
            for column in self._columns()
        ]
        return type(self)(*columns)

    def joined(self, other: Self) -> Self:
        """Return the rows of this table, then those of another."""
        columns = [
            column.joined(below)
            if isinstance(column, ArrayTable)
            else np.concatenate((column, below))
            for column, below in zip(self._columns(), other._columns(), strict=True)
        ]
        return type(self)(*columns)

    def replaced(self, rows: np.ndarray, other: Self) -> Self:
        """Return a table in which the rows of an index array are those of another table."""
        columns = []
        for column, new in zip(self._columns(), other._columns(), strict=True):
            if isinstance(column, ArrayTable):
                columns.append(column.replaced(rows, new))
                continue
            changed = column.copy()
            changed[rows] = new
            columns.append(changed)
        return type(self)(*columns)

    def _row_count(self) -> int:
        first = self._columns()[0]
        return first._row_count() if isinstance(first, ArrayTable) else len(first)

    def _columns(self) -> list[Any]:
        return [getattr(self, name) for name in self.__dataclass_fields__]
