"""Bags of ROS 2, written by rosbags."""

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_HUMBLE)
CLOUD, IMU = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Imu"
IMAGE, JPEG = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
START_NS = 1_700_000_000 * 10**9
KINDS = {"f4": 7, "f8": 8, "u2": 4, "u1": 2, "u4": 6}


def made(kind, *values):
    return TYPES.types[kind](*values)


def header(stamp_s):
    whole = round(stamp_s * 1e9)
    stamp = made("builtin_interfaces/msg/Time", *divmod(START_NS + whole, 10**9))
    return made("std_msgs/msg/Header", stamp, "sensor")


def cloud(stamp_s, fields, *, order="<", rows=1, gap=0):
    """A cloud of fields by name. rows: height; gap: bytes that fill up each of them."""
    formats = [values.dtype.str[1:] for values in fields.values()]
    layout = np.dtype(
        {
            "names": list(fields),
            "formats": [order + each for each in formats],
            "offsets": 4 + 8 * np.arange(len(fields)),
            "itemsize": 8 * len(fields) + 8,
        }
    )
    count = len(next(iter(fields.values())))
    points = np.zeros(count, layout)
    for name, values in fields.items():
        points[name] = values
    width, step = count // rows, layout.itemsize
    data = np.zeros((rows, width * step + gap), np.uint8)
    data[:, : width * step] = points.view(np.uint8).reshape(rows, -1)
    described = [
        made("sensor_msgs/msg/PointField", name, 4 + 8 * k, KINDS[each], 1)
        for k, (name, each) in enumerate(zip(fields, formats, strict=True))
    ]
    return made(
        CLOUD,
        header(stamp_s),
        rows,
        width,
        described,
        order == ">",
        step,
        width * step + gap,
        data.ravel(),
        True,
    )


def imu(stamp_s, rate, force):
    covariance = np.zeros(9)
    vector, turn = "geometry_msgs/msg/Vector3", made("geometry_msgs/msg/Quaternion", 0, 0, 0, 1)
    return made(
        IMU,
        header(stamp_s),
        turn,
        covariance,
        made(vector, *map(float, rate)),
        covariance,
        made(vector, *map(float, force)),
        covariance,
    )


def image(stamp_s, pixels, encoding="rgb8", gap=0):
    height, width, channels = pixels.shape
    rows = np.zeros((height, width * channels + gap), np.uint8)
    rows[:, : width * channels] = pixels.reshape(height, -1)
    return made(
        IMAGE, header(stamp_s), height, width, encoding, 0, width * channels + gap, rows.ravel()
    )


def jpeg(stamp_s, content):
    return made(JPEG, header(stamp_s), "jpeg", np.frombuffer(content, np.uint8))


def write_bag(path, messages, *, mcap=False, silent=()):
    """Write a folder. messages: stamp of recording in seconds, topic and message each.

    silent: topics of clouds without messages.
    """
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for topic in silent:
            writer.add_connection(topic, CLOUD, typestore=TYPES)
        for _, topic, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
        for stamp_s, topic, message in messages:
            raw = TYPES.serialize_cdr(message, message.__msgtype__)
            writer.write(connections[topic], START_NS + round(stamp_s * 1e9), raw)
    return path
