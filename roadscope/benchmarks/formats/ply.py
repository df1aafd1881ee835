"""Point clouds in PLY files: ascii, binary_little_endian and binary_big_endian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.table import FormatError, read_content, refuse

DTYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"},
}
"""Type of a property -> its NumPy dtype."""
BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
VERTEX = "vertex"
SCALAR_PREFIX = "scalar_"
"""CloudCompare writes it in front of the names of fields, which it begins with a capital."""
MAX_HEADER_BYTES = 1 << 16
"""No header is longer. Chosen by hand."""


@dataclass(frozen=True, slots=True)
class PlyHeader:
    """What a PLY file says about its vertices, which have to be its first element.

    layout: the properties of one vertex.
    offset: the byte at which the vertices begin. lines: how many lines the header has.
    """

    encoding: str
    count: int
    layout: np.dtype
    offset: int
    lines: int


def read_ply(path: Path | str) -> dict[str, np.ndarray]:
    """Return the properties of all vertices by name, each (N,); x, y and z are among them."""
    path = Path(path)
    content = read_content(path)
    header = _read_header(path, content)
    read = _read_ascii if header.encoding == "ascii" else _read_binary
    rows = read(path, header, content[header.offset :])
    return {_plain(name): rows[name] for name in header.layout.names or ()}


def _plain(name: str) -> str:
    return name.removeprefix(SCALAR_PREFIX).lower() if name.startswith(SCALAR_PREFIX) else name


def _read_header(path: Path, content: bytes) -> PlyHeader:
    head, end, _ = content[:MAX_HEADER_BYTES].partition(b"end_header")
    if not content.startswith(b"ply") or not end:
        raise FormatError(f"{path}: expected a PLY header, from ply to end_header, got none")
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    encoding, elements = "", list[tuple[str, int]]()
    properties: list[tuple[str, str]] = []
    for number, words in enumerate(lines, start=1):
        if words[:1] == ["format"]:
            encoding = words[1] if len(words) > 1 else ""
            if encoding not in BYTE_ORDERS:
                refuse(path, number, f"a format {', '.join(BYTE_ORDERS)}", " ".join(words))
        elif words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isdigit():
                refuse(path, number, "element, a name and a number", " ".join(words))
            elements.append((words[1], int(words[2])))
        elif words[:1] == ["property"] and len(elements) == 1:
            if len(words) != 3 or words[1] not in DTYPES:
                refuse(path, number, "property, a type of number and a name", " ".join(words))
            properties.append((words[2], BYTE_ORDERS.get(encoding, "<") + DTYPES[words[1]]))
    names = [name for name, _ in properties]
    if not encoding or not elements or elements[0][0] != VERTEX:
        raise FormatError(f"{path}: expected a format, and vertices as the first element")
    if not {"x", "y", "z"} <= set(names) or len(set(map(_plain, names))) < len(names):
        raise FormatError(
            f"{path}: expected properties x, y and z, each name once, got {' '.join(names)}"
        )
    offset = content.find(b"\n", len(head)) + 1 or len(content)
    return PlyHeader(encoding, elements[0][1], np.dtype(properties), offset, len(lines) + 1)


def _read_binary(path: Path, header: PlyHeader, body: bytes) -> np.ndarray:
    size = header.count * header.layout.itemsize
    if len(body) < size:
        raise FormatError(
            f"{path}: expected {size} bytes after the header, {header.count} vertices of "
            f"{header.layout.itemsize}, got {len(body)}"
        )
    return np.frombuffer(body, header.layout, header.count)


def _read_ascii(path: Path, header: PlyHeader, body: bytes) -> np.ndarray:
    lines = body.decode("ascii", "replace").splitlines()[: header.count]
    if len(lines) < header.count:
        refuse(path, header.lines + len(lines), f"{header.count} vertices", f"{len(lines)}")
    names: Sequence[str] = header.layout.names or ()
    rows = np.empty(header.count, header.layout)
    values = np.empty((header.count, len(names)))
    for row, line in enumerate(lines):
        try:
            values[row] = [float(word) for word in line.split()]
        except ValueError:
            refuse(path, header.lines + row + 1, f"{len(names)} numbers", line)
    for column, name in enumerate(names):
        rows[name] = values[:, column]
    return rows
