"""Bags of ROS 2: folders of rosbag2, `.mcap` and `.db3` files. The package rosbags reads them."""

from __future__ import annotations

import struct
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np

from roadscope.benchmarks.formats.scan_stamps import MAX_FALLING_SHARE, MAX_JUMP_S, clock_set_back
from roadscope.benchmarks.formats.table import FormatError, visible
from roadscope.core.loading import Requirement
from roadscope.core.names import unknown

ROSBAGS = Requirement("rosbags", "pip install 'roadscope[bags]'")
BAG_ENDINGS = (".mcap", ".db3")
ROS_1_ENDING = ".bag"
METADATA = "metadata.yaml"
CLOUDS = ("sensor_msgs/msg/PointCloud2",)
IMUS = ("sensor_msgs/msg/Imu",)
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
"""Types of the messages that are read."""
DTYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Type of a field of points in sensor_msgs/PointField -> its NumPy dtype."""
CHANNELS = {
    "rgb8": [0, 1, 2],
    "bgr8": [2, 1, 0],
    "rgba8": [0, 1, 2],
    "bgra8": [2, 1, 0],
    "mono8": [0, 0, 0],
}
"""Encoding of an image -> where red, green and blue are in a pixel."""
BYTES = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1}
"""Encoding of an image -> bytes of a pixel."""
NS = 1e-9


@dataclass(frozen=True, slots=True)
class BagMessage:
    """A message in a bag, which stands for the file of a scan or of an image.

    number: from 0, in the order of stamps. stamp_ns: of its header.
    order: from 0, in the order of recording. log_ns: when it was recorded.
    earlier: how many messages of the topic were recorded at the same time before it.
    """

    bag: Bag
    topic: str
    number: int
    stamp_ns: int
    order: int
    log_ns: int
    earlier: int

    def __str__(self) -> str:
        return f"{self.bag.path}, {self.topic}, message {self.number}"

    @property
    def name(self) -> str:
        """What stands for the name of a file."""
        return f"{self.number:06d}"

    def read(self) -> Any:
        """Return the message with the fields of its type."""
        return self.bag.read(self)


class _Cursor(NamedTuple):
    """Messages of a topic that are read one after the other. order: of the next one."""

    messages: Generator[tuple[Any, int, bytes], None, None]
    order: int


class TopicMessages(NamedTuple):
    """Messages of a topic in the order of their stamps.

    left_out: how many have a stamp that is more than a day from those of the others.
    by_recorder: whether the stamps are those of the recording, as those of headers do not differ.
    """

    messages: tuple[BagMessage, ...]
    left_out: int
    by_recorder: bool = False


class Bag:
    """An open bag; it is closed when nobody uses it any more."""

    def __init__(self, path: Path) -> None:
        """Open a bag; `FormatError` says why it cannot be read."""
        if ROSBAGS.missing:
            raise FormatError(f"{path}: {ROSBAGS.missing}")
        from rosbags.rosbag2 import Reader
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        try:
            self._reader = Reader(path)
            self._reader.open()
        except Exception as error:
            # Damaged bags raise errors of every kind.
            raise FormatError(f"{path}: cannot be read as a bag of ROS 2: {error}") from error
        # The types that are read are the same in all distributions.
        self._types = get_typestore(Stores.ROS2_HUMBLE)
        self._cursors: dict[str, _Cursor] = {}
        finalize(self, _close, self._reader, self._cursors)

    def listing(self) -> str:
        """Return all topics with their types, for error messages."""
        return ", ".join(
            f"{each.topic} ({each.msgtype}{'' if each.msgcount else ', no messages'})"
            for each in self._reader.connections
        )

    def topics(self, types: Sequence[str]) -> list[str]:
        """Return the topics of these types that have messages, in order."""
        connections = self._reader.connections
        return sorted(
            {each.topic for each in connections if each.msgtype in types and each.msgcount}
        )

    def topic(self, types: Sequence[str], named: Sequence[str]) -> str | None:
        """Return the topic of these types; None if there is none.

        named: topics that the user names, of any type; they are needed if there are several.
        """
        for name in named:
            known = [each.topic for each in self._reader.connections]
            if name not in known:
                raise FormatError(f"{self.path}: {unknown('topic', name, known)}")
        topics = self.topics(types)
        for each in self._reader.connections:
            if each.topic in named and each.msgtype in types and each.topic not in topics:
                raise FormatError(f"{self.path}: topic '{each.topic}' has no messages")
        wanted = [name for name in topics if name in named] or topics
        if len(wanted) > 1:
            kind = types[0].rpartition("/")[2]
            raise FormatError(
                f"{self.path}: several topics of type {kind}: {', '.join(wanted)}; name one, "
                "--topic NAME"
            )
        return wanted[0] if wanted else None

    def messages(self, topic: str) -> TopicMessages:
        """Return the messages of a topic in the order of their headers' stamps.

        Where these do not differ, stamps are those of the recording. A clock that was set back is
        refused.
        """
        logged, stamps, earlier = list[int](), list[int](), list[int]()
        for _, log_ns, raw in self._guarded(self._raw(topic), f"{self.path}, {topic}"):
            same = bool(logged) and logged[-1] == log_ns
            earlier.append(earlier[-1] + 1 if same else 0)
            logged.append(log_ns)
            stamps.append(_header_stamp_ns(raw, log_ns))
        by_recorder = len(set(stamps)) < min(2, len(stamps))
        if by_recorder:
            stamps = logged
        usable = self._near_others(topic, stamps, logged)
        set_back = clock_set_back(np.diff([stamps[row] for row in usable]) * NS)
        if set_back.any():
            row = usable[int(np.flatnonzero(set_back)[0]) + 1]
            raise FormatError(
                f"{self.path}, {topic}: expected stamps that rise, but those from the message on "
                f"that was recorded as number {row} are of a clock that was set back"
            )
        order = sorted(usable, key=stamps.__getitem__)
        messages = (
            BagMessage(self, topic, number, stamps[row], row, logged[row], earlier[row])
            for number, row in enumerate(order)
        )
        return TopicMessages(tuple(messages), len(stamps) - len(usable), by_recorder)

    def _near_others(self, topic: str, stamps: list[int], logged: list[int]) -> list[int]:
        """Return the messages whose stamps, nanoseconds, are of the clock of most others."""
        late_ns = np.subtract(stamps, logged)
        near = np.abs(late_ns - np.sort(late_ns)[(len(late_ns) - 1) // 2]) * NS <= MAX_JUMP_S
        far = int((~near).sum())
        if far > max(MAX_FALLING_SHARE * len(near), 1):
            raise FormatError(
                f"{self.path}, {topic}: expected stamps of one clock, but {far} of {len(near)} "
                "are more than a day from the others"
            )
        return np.flatnonzero(near).tolist()

    def read(self, message: BagMessage) -> Any:
        """Return a message with the fields of its type; `FormatError` if it is damaged."""
        cursor = self._cursors.pop(message.topic, None)
        if cursor is None or cursor.order != message.order:
            raws = self._raw(message.topic, message.log_ns)
            for _ in range(message.earlier):
                next(raws, None)
            cursor = _Cursor(raws, message.order)
        raw_message = next(self._guarded(cursor.messages, str(message)), None)
        if raw_message is None:
            raise FormatError(f"{message}: cannot be read: the bag ends before it")
        self._cursors[message.topic] = cursor._replace(order=message.order + 1)
        connection, _, raw = raw_message
        try:
            return self._types.deserialize_cdr(raw, connection.msgtype)
        except Exception as error:
            raise FormatError(f"{message}: cannot be read: {error}") from error

    def _raw(self, topic: str, start_ns: int | None = None) -> Generator[Any, None, None]:
        """Return the messages of a topic as bytes, from a time on, in the order of recording."""
        connections = [each for each in self._reader.connections if each.topic == topic]
        messages: Generator[Any, None, None] = self._reader.messages(connections, start=start_ns)
        return messages

    def _guarded(self, messages: Iterator[Any], source: str) -> Iterator[Any]:
        """Yield messages; whatever a damaged bag raises becomes `FormatError`."""
        while True:
            try:
                message = next(messages)
            except StopIteration:
                return
            except Exception as error:
                raise FormatError(f"{source}: cannot be read: {error}") from error
            yield message


Source = Path | BagMessage
"""Where a scan or an image is."""


def _close(reader: Any, cursors: dict[str, _Cursor]) -> None:
    for cursor in cursors.values():
        cursor.messages.close()
    with suppress(Exception):
        reader.close()


def _bag_path(path: Path) -> Path | None:
    """Return the bag that a path is or holds; None if there is none."""
    if path.is_file():
        if path.suffix.lower() == ROS_1_ENDING:
            raise FormatError(
                f"{path}: a bag of ROS 1: convert it, rosbags-convert --src {path} --dst DIR"
            )
        return path if path.suffix.lower() in BAG_ENDINGS else None
    if (path / METADATA).is_file():
        return path
    bags = [each for each in visible(path) if each.suffix.lower() in BAG_ENDINGS]
    if len(bags) > 1:
        names = ", ".join(each.name for each in bags)
        raise FormatError(f"{path}: several bags: {names}; name one of them, or add {METADATA}")
    return bags[0] if bags else None


def open_bag(path: Path) -> Bag | None:
    """Return the bag that a path is or holds, open; None if there is none."""
    place = _bag_path(path)
    return None if place is None else Bag(place)


def cloud_fields(message: BagMessage) -> dict[str, np.ndarray]:
    """Return the fields of the points of a PointCloud2 by name; x, y and z are among them."""
    cloud = message.read()
    known = [each for each in cloud.fields if each.datatype in DTYPES and each.count <= 1]
    names, order = [each.name for each in known], ">" if cloud.is_bigendian else "<"
    if not {"x", "y", "z"} <= set(names):
        raise FormatError(f"{message}: expected fields x, y and z, got {', '.join(names)}")
    width, height, step = int(cloud.width), int(cloud.height), int(cloud.point_step)
    row_step = max(int(cloud.row_step), width * step) if height > 1 else width * step
    data = np.asarray(cloud.data, np.uint8)
    if len(data) < height * row_step:
        raise FormatError(
            f"{message}: expected {width * height} points of {step} bytes, got {len(data)} bytes"
        )
    try:
        layout = np.dtype(
            {
                "names": names,
                "formats": [order + DTYPES[each.datatype] for each in known],
                "offsets": [int(each.offset) for each in known],
                "itemsize": step,
            }
        )
    except ValueError as error:
        raise FormatError(f"{message}: its fields contradict each other: {error}") from error
    rows = data[: height * row_step].reshape(height, row_step)[:, : width * step]
    points = np.ascontiguousarray(rows).reshape(-1).view(layout)
    return {name: points[name] for name in names}


def imu_rows(bag: Bag, topic: str) -> np.ndarray:
    """Return (K, 7) stamps in seconds, rates and specific forces of a topic of type Imu.

    Those of a message that cannot be used are nan.
    """
    messages, left_out, _ = bag.messages(topic)
    rows = [[np.nan] * 7] * left_out
    for message in messages:
        try:
            imu = message.read()
        except FormatError:
            rows.append([np.nan] * 7)
            continue
        rate, force = imu.angular_velocity, imu.linear_acceleration
        rows.append([message.stamp_ns * NS, rate.x, rate.y, rate.z, force.x, force.y, force.z])
    return np.array(rows, np.float64).reshape(-1, 7)


def image_pixels(message: Any, source: str) -> np.ndarray:
    """Return (H, W, 3) uint8 pixels, RGB, of an Image that is not compressed."""
    encoding, height, width = message.encoding, int(message.height), int(message.width)
    if encoding not in CHANNELS:
        raise FormatError(f"{source}: expected an encoding {', '.join(CHANNELS)}, got {encoding}")
    step, data = int(message.step), np.asarray(message.data, np.uint8)
    if step < width * BYTES[encoding] or len(data) < height * step:
        raise FormatError(f"{source}: expected {height} rows of {step} bytes, got {len(data)}")
    rows = data[: height * step].reshape(height, step)[:, : width * BYTES[encoding]]
    return rows.reshape(height, width, BYTES[encoding])[..., CHANNELS[encoding]]


def _header_stamp_ns(raw: bytes, otherwise: int) -> int:
    """Return the stamp of the header that a message begins with, behind four bytes of CDR."""
    if len(raw) < 12:
        return otherwise
    seconds, nanoseconds = struct.unpack_from("<iI" if raw[1] & 1 else ">iI", raw, 4)
    return int(seconds) * 10**9 + int(nanoseconds)
