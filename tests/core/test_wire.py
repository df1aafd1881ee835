"""Records as bytes and back."""

import pickle
from collections.abc import Callable
from time import perf_counter
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from roadscope.core import (
    Category,
    OdometryStatus,
    Pose,
    RecordError,
    Tracks,
    Truth,
    WireError,
    decode,
    encode,
    same_value,
)
from tests.core.wire_values import NAMES, make_value

records = st.builds(
    lambda name, seed, count: make_value(name, np.random.default_rng(seed), count),
    st.sampled_from(NAMES),
    st.integers(0, 2**32 - 1),
    st.integers(0, 12),
)
dtypes = st.sampled_from(
    [
        "bool",
        "float32",
        "float64",
        *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
    ]
)
arrays = dtypes.flatmap(
    lambda dtype: npst.arrays(dtype, npst.array_shapes(min_dims=0, max_dims=4, min_side=0))
)
texts = st.text(st.characters(exclude_categories=["Cs"]))
plain = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False)
    | texts
    | arrays
)
keys = texts.filter(lambda key: not key.startswith("$"))
values = st.recursive(
    plain | records,
    lambda inner: st.tuples(inner, inner) | st.dictionaries(keys, inner, max_size=4),
    max_leaves=8,
)


@given(values)
@settings(deadline=None)
def test_what_is_decoded_is_what_was_encoded(value: Any) -> None:
    assert _same(decode(encode(value)), value)


@given(arrays)
def test_arrays_are_copies_that_can_be_written_to(array: np.ndarray) -> None:
    message = bytearray(encode(array))
    decoded = decode(message)
    message[:] = bytes(len(message))
    assert _same(decoded, array)
    assert decoded.flags.writeable
    assert decoded.flags.owndata


@pytest.mark.parametrize("view", [np.s_[::2], np.s_[:, ::-1], np.s_[..., 0], np.s_[::-1]])
def test_arrays_of_any_layout(view: Any) -> None:
    array = np.arange(60, dtype=np.int32).reshape(5, 12)[view]
    assert _same(decode(encode(array)), array)
    assert _same(decode(encode(np.asfortranarray(array))), array)
    assert _same(decode(encode(array.astype(">i4"))), array)


def test_scalars_of_numpy_become_those_of_python() -> None:
    numpy_scalars = (
        np.float32(0.5),
        np.int8(-3),
        np.uint64(2**64 - 1),
        np.bool_(True),
        Category.VAN,
    )
    decoded = decode(encode(numpy_scalars))
    assert decoded == (0.5, -3, 2**64 - 1, True, 1)
    assert [type(value) for value in decoded] == [float, int, int, bool, int]


def test_enumerations_stay_what_they_are() -> None:
    assert decode(encode(OdometryStatus.DEGRADED)) is OdometryStatus.DEGRADED


class Foreign(Tracks):
    """A record of somebody's own."""


def test_records_of_derived_classes_arrive_as_ours() -> None:
    tracks = make_value("tracks", np.random.default_rng(0), 3)
    foreign = Foreign(*(getattr(tracks, name) for name in Tracks.__slots__))
    assert decode(encode(foreign)) == tracks


def _cyclic() -> list[Any]:
    value: list[Any] = []
    value.append(value)
    return value


def _incomplete() -> Tracks:
    return object.__new__(Tracks)


@pytest.mark.parametrize(
    "value",
    [
        object(),
        {1, 2},
        b"bytes",
        1j,
        2**64,
        {1: "key"},
        {"$record": "Tracks"},
        np.array([object()]),
        np.array(["text"]),
        np.zeros(2, np.float16),
        np.zeros(2, complex),
        np.zeros(2, [("x", float)]),
        np.zeros(2, "datetime64[s]"),
        "\ud800",
        Tracks,
        _cyclic(),
        _incomplete(),
        object.__new__(Truth),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_cannot_be_sent_is_refused(value: Any) -> None:
    with pytest.raises(WireError):
        encode(value)


def test_a_message_is_not_longer_than_it_may_be() -> None:
    array = np.zeros(1000)
    assert _same(decode(encode(array, most_bytes=9000)), array)
    with pytest.raises(WireError):
        encode(array, most_bytes=8000)
    with pytest.raises(WireError):
        # What describes the arrays is limited too: reading it costs far more than its bytes.
        encode([None] * (8 << 20))


def _spoiled(record: Any, **changes: Any) -> bytes:
    for name, value in changes.items():
        object.__setattr__(record, name, value)
    return encode(record)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"centres": np.full((3, 3), np.nan)}, "centres"),
        ({"ids": np.zeros(3)}, "ids"),
        ({"ids": np.zeros(3, int)}, "ids"),
        ({"ids": np.zeros((3, 1), int)}, "ids"),
        ({"categories": np.full(3, 99)}, "categories"),
        ({"scores": np.full(2, 0.5)}, "scores"),
        ({"stamp_s": "now"}, "stamp_s"),
        ({"stamp_s": None}, "stamp_s"),
        ({"stamp_s": True}, "stamp_s"),
        ({"frame": 1}, "frame"),
        ({"yaws": [0.0, 0.0, 0.0]}, "yaws"),
    ],
)
def test_records_are_checked_again(changes: dict[str, Any], named: str) -> None:
    tracks = make_value("tracks", np.random.default_rng(0), 3)
    with pytest.raises(WireError, match=f"Tracks.{named}"):
        decode(_spoiled(tracks, **changes))


def test_the_message_of_a_record_is_kept() -> None:
    skewed = np.eye(4)
    skewed[0, 1] = 0.5
    with pytest.raises(RecordError) as expected:
        Pose(skewed)
    with pytest.raises(WireError) as raised:
        decode(_spoiled(Pose.identity(), matrix=skewed))
    assert str(raised.value) == str(expected.value)


def _message(header: Any, payload: bytes = b"") -> bytes:
    packed = header if isinstance(header, bytes) else msgspec.msgpack.encode(header)
    return len(packed).to_bytes(4, "little") + packed + payload


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"\x00",
        b"\xff\xff\xff\xff",
        _message(None, b"more"),
        _message(b""),
        _message(b"\xc1"),
        _message(b"\xdd\xff\xff\xff\xff"),
        _message(b"\xdf\xff\xff\xff\xff"),
        _message(b"\x91" * 100_000 + b"\xc0"),
        _message(b"\xa2\xff\xfe"),
        _message(b"\xd6\xff\x00\x00\x00\x00"),
        _message(b"\xc7\x01\x05\x00"),
        _message(b"bytes"),
        _message(pickle.dumps(Category.CAR)),
        _message({1: 2}),
        _message({"$other": 2}),
        _message({"$record": "Truth", "fields": {}}),
        _message({"$record": "Pose", "fields": {}}),
        _message({"$record": "Pose", "fields": {"matrix": 1}}),
        _message({"$record": "Pose", "fields": {"matrix": 1, "other": 2}}),
        _message({"$record": ["Pose"], "fields": {}}),
        _message({"$record": "Pose"}),
        _message({"$record": "Calibration", "fields": {"ego_from_sensor": [["a", "b"]]}}),
        _message({"$enum": "OdometryStatus", "value": "other"}),
        _message({"$enum": "Path", "value": "/"}),
        _message({"$array": "object", "shape": [1]}, bytes(8)),
        _message({"$array": "float64", "shape": [-1]}, bytes(8)),
        _message({"$array": "float64", "shape": [True]}, bytes(8)),
        _message({"$array": "float64", "shape": 1}, bytes(8)),
        _message({"$array": "float64", "shape": [2]}, bytes(8)),
        _message({"$array": "float64", "shape": [1]}, bytes(9)),
        _message({"$array": "float64", "shape": [2**62, 2**62]}, bytes(8)),
        _message({"$array": "float64", "shape": [2**63 - 1, 0, 2**63 - 1]}),
        _message({"$array": "float64", "shape": [1] * 100}, bytes(8)),
        _message({"$array": "bool", "shape": [1]}, b"\x02"),
        _message({"$array": ["bool"], "shape": [1]}, b"\x01"),
    ],
)
def test_what_is_no_message_is_refused(message: bytes) -> None:
    with pytest.raises(WireError):
        decode(message)


@given(st.binary(max_size=200))
def test_random_bytes_are_refused_or_a_value(data: bytes) -> None:
    _refused_or_value(data)
    _refused_or_value(_message(data))


@given(records, st.data())
@settings(deadline=None, max_examples=300)
def test_damaged_messages_are_refused_or_a_value(record: Any, data: st.DataObject) -> None:
    message = bytearray(encode(record))
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, min(len(message), 1500) - 1))
        message[place] ^= 1 << data.draw(st.integers(0, 7))
    _refused_or_value(bytes(message))


@given(records, st.data())
@settings(deadline=None)
def test_truncated_messages_are_refused(record: Any, data: st.DataObject) -> None:
    message = encode(record)
    with pytest.raises(WireError):
        decode(message[: data.draw(st.integers(0, len(message) - 1))])


@pytest.mark.parametrize(
    ("name", "count", "most_ms"), [("lidar", 60_000, 1.0), ("tracks", 30, 0.2)]
)
def test_encoding_is_fast(name: str, count: int, most_ms: float) -> None:
    record = make_value(name, np.random.default_rng(0), count)
    assert _least_ms(lambda: encode(record)) < most_ms


def _least_ms(call: Callable[[], object]) -> float:
    times = []
    for _ in range(50):
        start = perf_counter()
        call()
        times.append(perf_counter() - start)
    return min(times) * 1e3


def _refused_or_value(message: bytes) -> None:
    try:
        value = decode(message)
    except WireError:
        return
    encode(value)


def _same(a: Any, b: Any) -> bool:
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return same_value(a, b)
