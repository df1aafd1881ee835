"""Point clouds in PCD files (version 0.7): ascii, binary and binary_compressed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.formats.cloud_rows import CloudHeader, ascii_rows, binary_rows
from roadscope.benchmarks.formats.table import FormatError, read_content, refuse

DTYPES = {
    **{("F", size): f"f{size}" for size in (4, 8)},
    **{("I", size): f"i{size}" for size in (1, 2, 4, 8)},
    **{("U", size): f"u{size}" for size in (1, 2, 4, 8)},
}
"""TYPE and SIZE of a field -> its NumPy dtype."""
ENCODINGS = ("ascii", "binary", "binary_compressed")
MAX_HEADER_LINES = 64
"""No header is longer: it has 11 lines and comments. Chosen by hand."""


class _Entry(NamedTuple):
    """One line of the header: its words after the key, and its line number."""

    words: list[str]
    line: int


def read_pcd(path: Path | str) -> dict[str, np.ndarray]:
    """Return the fields of all points by name, each (N,); x, y and z are among them."""
    path = Path(path)
    content = read_content(path)
    header = _read_header(path, content)
    read = {"ascii": _read_ascii, "binary": _read_binary, "binary_compressed": _read_compressed}
    columns = read[header.encoding](path, header, content[header.offset :])
    names = header.layout.names or ()
    return {name: columns[name] for name in names if not name.startswith("_")}


def _read_header(path: Path, content: bytes) -> CloudHeader:
    entries: dict[str, _Entry] = {}
    offset = 0
    for number in range(1, MAX_HEADER_LINES + 1):
        end = content.find(b"\n", offset)
        if end < 0:
            break
        words = content[offset:end].decode("ascii", "replace").split()
        offset = end + 1
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = _Entry(words[1:], number)
        if "DATA" in entries:
            return _checked_header(path, entries, offset=offset, lines=number)
    raise FormatError(f"{path}: expected a PCD header that ends with a DATA line, got none")


def _checked_header(
    path: Path, entries: Mapping[str, _Entry], *, offset: int, lines: int
) -> CloudHeader:
    for key in ("FIELDS", "SIZE", "TYPE", "POINTS"):
        if key not in entries:
            refuse(path, lines, f"a line {key} before DATA", ", ".join(entries))
    layout = _point_layout(path, entries)
    data = entries["DATA"]
    encoding = " ".join(data.words)
    if encoding not in ENCODINGS:
        refuse(path, data.line, f"DATA {', '.join(ENCODINGS)}", encoding)
    count = entries["POINTS"]
    points = _whole_number(path, count.line, " ".join(count.words))
    return CloudHeader(layout, points, encoding, offset, lines)


def _point_layout(path: Path, entries: Mapping[str, _Entry]) -> np.dtype:
    """Return the dtype of one point; padding and fields of several values begin with `_`."""
    names, types, sizes = entries["FIELDS"], entries["TYPE"], entries["SIZE"]
    counts = entries.get("COUNT", _Entry(["1"] * len(names.words), names.line))
    for entry in (sizes, types, counts):
        if len(entry.words) != len(names.words):
            expected = f"{len(names.words)} values, one per field"
            refuse(path, entry.line, expected, " ".join(entry.words))
    layout = []
    for number, name in enumerate(names.words):
        kind, size = types.words[number], sizes.words[number]
        dtype = DTYPES.get((kind.upper(), _whole_number(path, sizes.line, size)))
        if dtype is None:
            expected = "TYPE F with SIZE 4 or 8, or TYPE I or U with SIZE 1, 2, 4 or 8"
            refuse(path, types.line, expected, f"TYPE {kind} with SIZE {size}")
        width = _whole_number(path, counts.line, counts.words[number])
        unique = name if name != "_" and width == 1 else f"_{number}"
        layout.append((unique, f"<{dtype}", (width,)) if width != 1 else (unique, f"<{dtype}"))
    if not {"x", "y", "z"} <= set(names.words):
        refuse(path, names.line, "fields x, y and z", " ".join(names.words))
    if len({name for name, *_ in layout}) < len(layout):
        refuse(path, names.line, "each field once", " ".join(names.words))
    return np.dtype(layout)


def _whole_number(path: Path, line: int, text: str) -> int:
    if not text.isdigit():
        refuse(path, line, "a whole number", text)
    return int(text)


def _columns(rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return the fields of a structured array by name."""
    return {name: rows[name] for name in rows.dtype.names or ()}


def _read_compressed(path: Path, header: CloudHeader, body: bytes) -> dict[str, np.ndarray]:
    """Read points that are compressed by LZF, one field after the other."""
    # The compiler takes half a second to import.
    from roadscope.benchmarks.formats.lzf import decompress_lzf

    expected = header.count * header.layout.itemsize
    packed, size = np.frombuffer(body[:8].ljust(8, b"\0"), "<u4").tolist()
    content = decompress_lzf(np.frombuffer(body, np.uint8, offset=min(8, len(body)))[:packed], size)
    if size != expected or len(content) != expected or len(body) < 8 + packed:
        raise FormatError(
            f"{path}: expected {header.count} compressed points of {header.layout.itemsize} "
            f"bytes, got {len(content)} bytes"
        )
    columns, first = {}, 0
    for name in header.layout.names or ():
        field = header.layout[name]
        length = header.count * field.itemsize
        columns[name] = np.frombuffer(content[first : first + length].tobytes(), field)
        first += length
    return columns


def _read_binary(path: Path, header: CloudHeader, body: bytes) -> dict[str, np.ndarray]:
    return _columns(binary_rows(path, header, body))


def _read_ascii(path: Path, header: CloudHeader, body: bytes) -> dict[str, np.ndarray]:
    lines = [(n, row) for n, row in enumerate(body.splitlines(), header.lines + 1) if row.strip()]
    if len(lines) != header.count:
        last = lines[-1][0] if lines else header.lines
        refuse(path, last, f"{header.count} points", f"{len(lines)} points")
    return _columns(ascii_rows(path, header, lines))
