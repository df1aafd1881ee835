"""Shape, dtype and value checks that say what was wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike

Shape = tuple[int | str, ...]


class RecordError(ValueError):
    """A record was made from values that do not fit it."""


def settle_arrays(record: object, /, **fields: tuple[DTypeLike, Shape]) -> None:
    """Convert the named fields of a frozen record to arrays and check their shapes.

    A letter in a shape is a length that must agree between all fields that use it; floats must
    be finite. Raises `RecordError` naming record, field, expectation and what was given.
    """
    lengths: dict[str, tuple[int, str]] = {}
    for name, (dtype, shape) in fields.items():
        value = getattr(record, name)
        array = _convert(record, name, value, dtype)
        _check_shape(record, name, array, shape, lengths)
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            bad = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            raise RecordError(f"{_label(record, name)}: must be finite, got {array[bad]} at {bad}")
        object.__setattr__(record, name, array)


def require(condition: bool, record: object, name: str, expected: str, given: object) -> None:
    """Raise `RecordError` unless the condition holds."""
    if not condition:
        raise RecordError(f"{_label(record, name)}: expected {expected}, got {given!r}")


def _label(record: object, name: str) -> str:
    return f"{type(record).__name__}.{name}"


def _convert(record: object, name: str, value: Any, dtype: DTypeLike) -> np.ndarray:
    try:
        given = np.asarray(value)
        wanted = np.dtype(dtype)
        if given.size and given.dtype.kind == "f" and wanted.kind in "iu":
            raise TypeError(f"floats given, {wanted} wanted")
        return np.ascontiguousarray(given, dtype=wanted).reshape(given.shape)
    except (TypeError, ValueError) as error:
        raise RecordError(
            f"{_label(record, name)}: not an array of {np.dtype(dtype)}: {error}"
        ) from error


def _check_shape(
    record: object, name: str, array: np.ndarray, shape: Shape, lengths: dict[str, tuple[int, str]]
) -> None:
    text = "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"
    if array.ndim != len(shape):
        raise RecordError(f"{_label(record, name)}: expected shape {text}, got {array.shape}")
    for given, wanted in zip(array.shape, shape, strict=True):
        if isinstance(wanted, int):
            if given != wanted:
                raise RecordError(
                    f"{_label(record, name)}: expected shape {text}, got {array.shape}"
                )
            continue
        known, source = lengths.setdefault(wanted, (given, name))
        if given != known:
            raise RecordError(
                f"{_label(record, name)}: expected shape {text} with {wanted} = {known} "
                f"as in {source}, got {array.shape}"
            )
