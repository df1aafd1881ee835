"""Point clouds in PLY files: ascii, binary_little_endian and binary_big_endian."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.cloud_rows import CloudHeader, ascii_rows, binary_rows
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


def read_ply(path: Path | str) -> dict[str, np.ndarray]:
    """Return the properties of all vertices by name, each (N,); x, y and z are among them."""
    path = Path(path)
    content = read_content(path)
    header = _read_header(path, content)
    read = _read_ascii if header.encoding == "ascii" else binary_rows
    rows = read(path, header, content[header.offset :])
    return {_plain(name): rows[name] for name in header.layout.names or ()}


def _plain(name: str) -> str:
    return name.removeprefix(SCALAR_PREFIX).lower() if name.startswith(SCALAR_PREFIX) else name


def _read_header(path: Path, content: bytes) -> CloudHeader:
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
    return CloudHeader(np.dtype(properties), elements[0][1], encoding, offset, len(lines) + 1)


def _read_ascii(path: Path, header: CloudHeader, body: bytes) -> np.ndarray:
    lines = body.splitlines()[: header.count]
    if len(lines) < header.count:
        refuse(path, header.lines + len(lines), f"{header.count} points", f"{len(lines)}")
    return ascii_rows(path, header, enumerate(lines, header.lines + 1))
