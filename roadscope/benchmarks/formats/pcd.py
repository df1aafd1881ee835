"""Point clouds in PCD files (version 0.7), ascii and binary."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.table import FormatError, refuse

KINDS = {("F", 4): "f4", ("F", 8): "f8", **{
    (kind, size): f"{kind.lower()}{size}" for kind in "IU" for size in (1, 2, 4, 8)}}  # fmt: skip
MOST_HEADER_LINES = 64


@dataclass(frozen=True, slots=True)
class Header:
    """What a PCD file says of itself.

    layout: a point's fields. points: how many. data: `ascii` or `binary`. starts_at: where
    points begin, in bytes; lines: how many lines the header has.
    """

    layout: np.dtype
    points: int
    data: str
    starts_at: int
    lines: int


def read_pcd(path: Path | str) -> dict[str, np.ndarray]:
    """Return the fields of all points by name, (N,) each; x, y and z are among them."""
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from error
    header = _header(path, content)
    body = content[header.starts_at :]
    rows = _binary(path, header, body) if header.data == "binary" else _ascii(path, header, body)
    names = header.layout.names or ()
    return {name: rows[name] for name in names if not name.startswith("_")}


def _header(path: Path, content: bytes) -> Header:
    said: dict[str, tuple[list[str], int]] = {}
    at = 0
    for number in range(1, MOST_HEADER_LINES + 1):
        end = content.find(b"\n", at)
        if end < 0:
            break
        words = content[at:end].decode("ascii", "replace").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            said[words[0].upper()] = (words[1:], number)
        if "DATA" in said:
            return _checked(path, said, at, number)
    raise FormatError(f"{path}: expected a PCD header that ends with a DATA line, got none")


def _checked(
    path: Path, said: dict[str, tuple[list[str], int]], starts_at: int, lines: int
) -> Header:
    for key in ("FIELDS", "SIZE", "TYPE", "POINTS"):
        if key not in said:
            refuse(path, lines, f"a line {key} before DATA", ", ".join(said))
    names, number = said["FIELDS"]
    counts = said.get("COUNT", (["1"] * len(names), number))
    columns = [said["SIZE"], said["TYPE"], counts]
    for given, line in columns:
        if len(given) != len(names):
            refuse(path, line, f"{len(names)} values, one a field", " ".join(given))
    layout = []
    for field, (name, size, kind, count) in enumerate(
        zip(names, *(given for given, _ in columns), strict=True)
    ):
        code = KINDS.get((kind.upper(), _integer(path, size, said["SIZE"][1])))
        if code is None:
            refuse(path, said["TYPE"][1], "types F of 4 or 8, I or U of 1 to 8 bytes", kind + size)
        width, padding = _integer(path, count, counts[1]), name == "_"
        unique = f"_{field}" if padding or width != 1 else name
        layout.append((unique, f"<{code}", (width,)) if width != 1 else (unique, f"<{code}"))
    if not {"x", "y", "z"} <= set(names):
        refuse(path, number, "fields x, y and z", " ".join(names))
    if len({name for name, *_ in layout}) < len(layout):
        refuse(path, number, "each field once", " ".join(names))
    data, line = said["DATA"]
    if data not in (["ascii"], ["binary"]):
        refuse(path, line, "DATA ascii or DATA binary (write it again without compression)",
               " ".join(data))  # fmt: skip
    points = _integer(path, " ".join(said["POINTS"][0]), said["POINTS"][1])
    return Header(np.dtype(layout), points, data[0], starts_at, lines)


def _integer(path: Path, text: str, line: int) -> int:
    if not text.isdigit():
        refuse(path, line, "a whole number", text)
    return int(text)


def _binary(path: Path, header: Header, body: bytes) -> np.ndarray:
    wanted = header.points * header.layout.itemsize
    if len(body) < wanted:
        raise FormatError(f"{path}: expected {wanted} bytes after the header, {header.points} "
                          f"points of {header.layout.itemsize}, got {len(body)}")  # fmt: skip
    return np.frombuffer(body, header.layout, header.points)


def _ascii(path: Path, header: Header, body: bytes) -> np.ndarray:
    lines = [(n, row) for n, row in enumerate(body.splitlines(), header.lines + 1) if row.strip()]
    if len(lines) != header.points:
        last = lines[-1][0] if lines else header.lines
        refuse(path, last, f"{header.points} points", f"{len(lines)} points")
    names = header.layout.names or ()
    columns = sum(int(np.prod(header.layout[name].shape)) for name in names)
    values = np.empty((len(lines), columns))
    for row, (number, line) in enumerate(lines):
        words = line.split()
        try:
            values[row] = [float(word) for word in words]
        except ValueError:
            refuse(path, number, f"{columns} numbers", line.decode("ascii", "replace"))
    rows, at = np.empty(len(lines), header.layout), 0
    for name in names:
        shape = header.layout[name].shape
        width = int(np.prod(shape))
        rows[name] = values[:, at : at + width].reshape(len(lines), *shape)
        at += width
    return rows
