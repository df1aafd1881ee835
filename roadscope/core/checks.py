"""Checks of shapes, dtypes and values for records; errors name the record and the field."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np
from numpy.typing import DTypeLike

from roadscope.core.category import Category

Shape = tuple[int | str, ...]


class RecordError(ValueError):
    """A record was made from values that do not fit it."""


def settle_arrays(record: object, /, **fields: tuple[DTypeLike, Shape]) -> None:
    """Convert the named fields of a frozen record to arrays and check their shapes.

    A letter in a shape is a length that must agree between all fields that use it; floats must
    be finite. Values of another dtype are converted where that changes no value beyond rounding:
    floats to integers if they are whole, numbers to booleans if they are 0 or 1. Raises
    `RecordError` with the record, the field, what was expected and the actual value.
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


def require(condition: bool, record: object, name: str, expected: str, actual: object) -> None:
    """Raise `RecordError` unless the condition holds; the other arguments are for its message."""
    if not condition:
        raise RecordError(f"{_label(record, name)}: expected {expected}, got {actual!r}")


def check_sizes(record: object, name: str, sizes: np.ndarray) -> None:
    """Raise `RecordError` if one of (N, 3) lengths, widths and heights is not positive."""
    _require_rows((sizes > 0).all(axis=1), record, name, "positive lengths", sizes)


def check_categories(record: object, name: str, categories: np.ndarray) -> None:
    """Raise `RecordError` if one of (N,) categories is no value of `Category`."""
    valid = (categories >= 0) & (categories < len(Category))
    expected = f"values of Category, 0 to {len(Category) - 1}"
    _require_rows(valid, record, name, expected, categories)


def check_scores(record: object, name: str, scores: np.ndarray) -> None:
    """Raise `RecordError` if one of (N,) scores is not in 0 to 1."""
    _require_rows((scores >= 0) & (scores <= 1), record, name, "values in 0 to 1", scores)


def check_image_boxes(record: object, name: str, boxes: np.ndarray) -> None:
    """Raise `RecordError` if one of (N, 4) boxes has right < left or bottom < top."""
    ordered = (boxes[:, 2:] >= boxes[:, :2]).all(axis=1)
    expected = "left, top, right, bottom with right >= left and bottom >= top"
    _require_rows(ordered, record, name, expected, boxes)


def _require_rows(
    good: np.ndarray | np.bool, record: object, name: str, expected: str, values: np.ndarray
) -> None:
    """Raise `RecordError` that names the first of the rows that are not good."""
    require(bool(good.all()), record, name, expected, values[~good][:1].tolist())


def _label(record: object, name: str) -> str:
    return f"{type(record).__name__}.{name}"


def _convert(record: object, name: str, value: Any, dtype: DTypeLike) -> np.ndarray:
    wanted = np.dtype(dtype)
    if type(value) is np.ndarray and value.dtype == wanted and value.flags.c_contiguous:
        return value
    try:
        array = np.asarray(value)
        _check_exact(array, wanted)
        return np.ascontiguousarray(array, dtype=wanted).reshape(array.shape)
    except (TypeError, ValueError) as error:
        raise RecordError(f"{_label(record, name)}: not an array of {wanted}: {error}") from error


def _check_exact(array: np.ndarray, wanted: np.dtype[Any]) -> None:
    """Raise `ValueError` where conversion would change a value by more than rounding."""
    if array.dtype == wanted or not array.size:
        return
    if array.dtype.kind not in "biuf":
        raise ValueError(f"expected numbers, got {array.dtype} such as {array.flat[0]!r}")
    if wanted.kind == "b":
        exact, expected = (array == 0) | (array == 1), "True or False"
    elif wanted.kind in "iu" and not np.can_cast(array.dtype, wanted):
        limits = np.iinfo(wanted)
        # `<= max` would be wrong: as a float the greatest int64 is rounded up.
        exact = (array >= limits.min) & (array < limits.max + 1)
        exact &= np.trunc(array) == array if array.dtype.kind == "f" else True
        expected = f"whole numbers from {limits.min} to {limits.max}"
    else:
        return
    if not exact.all():
        raise ValueError(f"expected {expected}, got {array[~exact].flat[0]}")


def _check_shape(
    record: object, name: str, array: np.ndarray, shape: Shape, lengths: dict[str, tuple[int, str]]
) -> None:
    if array.ndim != len(shape):
        _refuse_shape(record, name, array, shape)
    for length, wanted in zip(array.shape, shape, strict=True):
        if isinstance(wanted, int):
            if length != wanted:
                _refuse_shape(record, name, array, shape)
            continue
        earlier, source = lengths.setdefault(wanted, (length, name))
        if length != earlier:
            _refuse_shape(record, name, array, shape, f" with {wanted} = {earlier} as in {source}")


def _refuse_shape(
    record: object, name: str, array: np.ndarray, shape: Shape, where: str = ""
) -> NoReturn:
    text = "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"
    raise RecordError(f"{_label(record, name)}: expected shape {text}{where}, got {array.shape}")
