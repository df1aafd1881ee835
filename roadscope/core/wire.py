"""Records as bytes and back, without pickle: nothing in a message can run code.

A message is the length of its header (4 bytes, little endian), the header in MessagePack, and
then the bytes of its arrays, one after another. Lists and tuples both come back as tuples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from roadscope.core.category import Family
from roadscope.core.checks import RecordError
from roadscope.core.detections import Detections, ImageDetections
from roadscope.core.driving import DrivingCommand, DrivingScene
from roadscope.core.frame import Calibration, Frame
from roadscope.core.fused import FusedDetections
from roadscope.core.image import CameraImage
from roadscope.core.imu import ImuSamples
from roadscope.core.odometry import OdometryEstimate, OdometryStatus
from roadscope.core.pose import Pose
from roadscope.core.projection import Projection
from roadscope.core.record import Record
from roadscope.core.scan import LidarScan
from roadscope.core.tracks import Tracks
from roadscope.core.wheels import WheelSamples

MOST_HEADER_BYTES = 4 << 20
"""Chosen by hand: a header describes arrays and does not contain them; 4 MB are 10,000 records."""
LENGTH_BYTES = 4
RECORD, FIELDS, ARRAY, SHAPE, ENUM, VALUE = "$record", "fields", "$array", "shape", "$enum", "value"
DTYPES = {
    dtype.name: dtype
    for dtype in map(
        np.dtype,
        (
            np.bool_,
            np.int8,
            np.int16,
            np.int32,
            np.int64,
            np.uint8,
            np.uint16,
            np.uint32,
            np.uint64,
            np.float32,
            np.float64,
        ),
    )
}
RECORDS: Mapping[str, type[Record]] = {
    kind.__name__: kind
    for kind in (
        Calibration,
        CameraImage,
        Detections,
        DrivingCommand,
        DrivingScene,
        Frame,
        FusedDetections,
        ImageDetections,
        ImuSamples,
        LidarScan,
        OdometryEstimate,
        Pose,
        Projection,
        Tracks,
        WheelSamples,
    )
}
ENUMS: Mapping[str, type[StrEnum]] = {kind.__name__: kind for kind in (Family, OdometryStatus)}
_FIELD_NAMES = {kind: tuple(field.name for field in fields(kind)) for kind in RECORDS.values()}
_FIELD_TYPES = {
    kind: {name: get_type_hints(kind)[name] for name in names}
    for kind, names in _FIELD_NAMES.items()
}
_PLAIN = frozenset({NoneType, bool, int, float, str})


class WireError(ValueError):
    """A value cannot be encoded, or bytes are not a message."""


def encode(value: Any, *, most_bytes: int | None = None) -> bytes:
    """Return a message that `decode` turns back into the value.

    Possible are None, bool, int, float, str, lists, tuples, dicts with str keys, arrays of
    bools, integers and floats, and the records that plug-ins get and give. `WireError` for
    anything else, and for a message longer than `most_bytes`.
    """
    arrays: list[np.ndarray] = []
    try:
        header = msgspec.msgpack.encode(_described(value, arrays))
    except RecursionError as error:
        raise WireError("nested too deeply to be sent") from error
    except OverflowError as error:
        raise WireError("an integer of more than 64 bits cannot be sent") from error
    except (UnicodeError, msgspec.MsgspecError) as error:
        raise WireError(f"cannot be sent: {error}") from error
    length = LENGTH_BYTES + len(header) + sum(array.nbytes for array in arrays)
    if most_bytes is not None and length > most_bytes:
        raise WireError(_too_long(length, most_bytes))
    if len(header) > MOST_HEADER_BYTES:
        raise WireError(_too_long(len(header), MOST_HEADER_BYTES))
    length_bytes = len(header).to_bytes(LENGTH_BYTES, "little")
    return b"".join([length_bytes, header, *(array.data for array in arrays)])


def decode(message: bytes | bytearray | memoryview) -> Any:
    """Return the value of a message; its arrays are fresh copies that can be written to.

    Records are made by their constructors, so that they are checked again. `WireError` for
    bytes that `encode` cannot have made.
    """
    view = memoryview(message)
    if len(view) < LENGTH_BYTES:
        raise WireError("truncated message: it has no header")
    length = int.from_bytes(view[:LENGTH_BYTES], "little")
    if length > min(MOST_HEADER_BYTES, len(view) - LENGTH_BYTES):
        raise WireError(f"truncated message, or one with a wrong header length: {length}")
    payload = _Payload(view, LENGTH_BYTES + length)
    try:
        described = msgspec.msgpack.decode(view[LENGTH_BYTES : payload.position])
        value = _restored(described, payload)
    except WireError:
        raise
    except (ValueError, RecursionError, MemoryError) as error:
        raise WireError(f"malformed message: {error}") from error
    if payload.position != len(view):
        raise WireError(f"{len(view) - payload.position} bytes too many in a message")
    return value


@dataclass(slots=True)
class _Payload:
    """The bytes of a message, and where the next array begins."""

    view: memoryview
    position: int

    def take(self, count: int) -> memoryview:
        start, self.position = self.position, self.position + count
        if self.position > len(self.view):
            raise WireError("truncated message: an array is longer than what is left")
        return self.view[start : self.position]


def _described(value: Any, arrays: list[np.ndarray]) -> Any:
    """Return a value as MessagePack can encode it; append its arrays to `arrays`."""
    kind = type(value)
    if kind in _PLAIN:
        return value
    if isinstance(value, np.ndarray):
        return _array_described(value, arrays)
    if isinstance(value, Record):
        return _record_described(value, arrays)
    if isinstance(value, (list, tuple)):
        return [_described(item, arrays) for item in value]
    if isinstance(value, dict):
        return {_key(key): _described(item, arrays) for key, item in value.items()}
    if kind.__name__ in ENUMS and ENUMS[kind.__name__] is kind:
        return {ENUM: kind.__name__, VALUE: value.value}
    for numeric, plain in ((np.bool_, bool), (np.integer, int), (np.floating, float)):
        if isinstance(value, numeric):
            return plain(value)
    for base in (int, float, str):
        if isinstance(value, base):
            return base(value)
    raise WireError(f"{kind.__name__} cannot be sent")


def _array_described(array: np.ndarray, arrays: list[np.ndarray]) -> dict[str, Any]:
    name = array.dtype.name
    if name not in DTYPES:
        raise WireError(f"an array of {name} cannot be sent; possible: {', '.join(DTYPES)}")
    arrays.append(np.asarray(array, dtype=DTYPES[name], order="C"))
    return {ARRAY: name, SHAPE: array.shape}


def _record_described(record: Record, arrays: list[np.ndarray]) -> dict[str, Any]:
    kind = next((base for base in type(record).__mro__ if base in _FIELD_NAMES), None)
    if kind is None:
        raise WireError(f"{type(record).__name__} cannot be sent")
    described = {}
    for name in _FIELD_NAMES[kind]:
        try:
            described[name] = _described(getattr(record, name), arrays)
        except AttributeError:
            raise WireError(f"{kind.__name__}.{name} is missing") from None
    return {RECORD: kind.__name__, FIELDS: described}


def _key(key: Any) -> str:
    if not isinstance(key, str) or key.startswith("$"):
        raise WireError(f"a dict with the key {key!r:.80} cannot be sent")
    return str(key)


def _restored(described: Any, payload: _Payload) -> Any:
    kind = type(described)
    if kind in _PLAIN:
        return described
    if kind is list:
        return tuple([_restored(item, payload) for item in described])
    if kind is not dict:
        raise WireError(f"malformed message: {kind.__name__} in it")
    if RECORD in described:
        return _record_restored(described, payload)
    if ARRAY in described:
        return _array_restored(described, payload)
    if ENUM in described:
        return _enum_restored(described)
    return {_sent_key(key): _restored(item, payload) for key, item in described.items()}


def _array_restored(described: dict[str, Any], payload: _Payload) -> np.ndarray:
    name, shape = _pair(described, ARRAY, SHAPE)
    dtype = DTYPES.get(name) if isinstance(name, str) else None
    if dtype is None:
        raise WireError(f"an array of {name!r:.80} in a message")
    if type(shape) is not list or not all(type(n) is int and n >= 0 for n in shape):
        raise WireError(f"an array of shape {shape!r:.80} in a message")
    data = payload.take(math.prod(shape) * dtype.itemsize)
    array = np.frombuffer(data, dtype).reshape(shape).copy()
    if dtype.kind == "b" and bool((array.view(np.uint8) > 1).any()):
        raise WireError("an array of bool with other values in a message")
    return array


def _record_restored(described: dict[str, Any], payload: _Payload) -> Record:
    name, values = _pair(described, RECORD, FIELDS)
    kind = RECORDS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise WireError(f"a record {name!r:.80} in a message")
    if type(values) is not dict or values.keys() != set(_FIELD_NAMES[kind]):
        raise WireError(f"{name} with other fields than its own in a message")
    # In the order of the message, which is that of the arrays.
    restored = {field: _restored(value, payload) for field, value in values.items()}
    for field, expected in _FIELD_TYPES[kind].items():
        if not _fits(restored[field], expected):
            raise WireError(
                f"{name}.{field}: expected {_type_name(expected)}, "
                f"got {type(restored[field]).__name__}"
            )
    try:
        with np.errstate(all="ignore"):
            return kind(**restored)
    except RecordError as error:
        raise WireError(str(error)) from error
    except Exception as error:
        raise WireError(f"{name}: {type(error).__name__}: {error}") from error


def _enum_restored(described: dict[str, Any]) -> StrEnum:
    name, value = _pair(described, ENUM, VALUE)
    kind = ENUMS.get(name) if isinstance(name, str) else None
    if kind is None or value not in list(kind):
        raise WireError(f"{value!r:.80} of {name!r:.80} in a message")
    return kind(value)


def _pair(described: dict[str, Any], first: str, second: str) -> tuple[Any, Any]:
    if described.keys() != {first, second}:
        raise WireError(f"malformed message: {first} with {', '.join(map(str, described))[:80]}")
    return described[first], described[second]


def _sent_key(key: Any) -> str:
    if type(key) is not str or key.startswith("$"):
        raise WireError(f"a dict with the key {key!r:.80} in a message")
    return key


def _fits(value: Any, expected: Any) -> bool:
    """Return whether a restored value has the annotated type of a record's field."""
    origin = get_origin(expected)
    if origin in (Union, UnionType):
        return any(_fits(value, kind) for kind in get_args(expected))
    if origin is tuple:
        kinds = get_args(expected)
        if type(value) is not tuple:
            return False
        if kinds[-1] is Ellipsis:
            return all(_fits(item, kinds[0]) for item in value)
        return len(value) == len(kinds) and all(map(_fits, value, kinds))
    if expected is float:
        return type(value) in (int, float)
    return type(value) is expected


def _type_name(expected: Any) -> str:
    return str(expected) if get_args(expected) else str(getattr(expected, "__name__", expected))


def _too_long(length: int, most: int) -> str:
    return f"{length / 1e6:.1f} MB, more than the {most / 1e6:g} MB that can be sent"
