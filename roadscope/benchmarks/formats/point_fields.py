"""The points of one file with all their fields, as the file has them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeGuard, TypeVar

import numpy as np

from roadscope.benchmarks.formats.bags import BagMessage, Source, cloud_fields
from roadscope.benchmarks.formats.pcd import read_pcd
from roadscope.benchmarks.formats.ply import read_ply
from roadscope.benchmarks.formats.table import FormatError
from roadscope.core.loading import Requirement

ENDINGS = (".pcd.bin", ".bin", ".pcd", ".npy", ".ply", ".las", ".laz")
"""Endings of the names of files of points; the longer ones first."""
POINT_TIMES_FOLDER = "velodyne_times"
"""The folder with the times of points beside `velodyne`, as `roadscope export` writes it."""
TIME = "time"
"""The name of these times among the fields of a `.bin` file."""
IGNORED = "_"
"""Name of a column that nobody needs; there may be several."""
PLACE = ("x", "y", "z")
NAMED = "expected x, y and z, and no layout for files with names"
FLOAT_BYTES = 4
FEWEST_COLUMNS, MOST_COLUMNS = 3, 10
"""Numbers of columns of a `.npy` or `.bin` file."""
LASPY = Requirement("laspy", "pip install 'roadscope[bags]'")
LAS_FIELDS = ("intensity", "gps_time")
"""The fields of points of LAS files that tell something about a scan."""

F = TypeVar("F", bound=Source)
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class PointFields:
    """The N points of a file.

    points: (N, 3) float64, x y z in the file's unit; not finite for rays without a return.
    others: further fields by name, (N,) float64 each.
    times_beside: whether the times of points are of `POINT_TIMES_FOLDER`.
    problem: why those cannot be read, or "".
    """

    points: np.ndarray
    others: Mapping[str, np.ndarray]
    times_beside: bool = False
    problem: str = ""

    def __len__(self) -> int:
        return len(self.points)


def column_name(number: int) -> str:
    """Return what a column without a name is called, counted from 1."""
    return f"column {number}"


def unnamed(width: int) -> tuple[str, ...]:
    """Return the names of the columns of a file that names none: x y z, and numbers."""
    return (*PLACE, *(column_name(k + 1) for k in range(3, width)))


def ending_of(path: Path) -> str:
    """Return the ending of a file of points; empty if it is none."""
    return next((ending for ending in ENDINGS if path.name.lower().endswith(ending)), "")


def is_raw(path: Source) -> TypeGuard[Path]:
    """Return whether a file is floats in a row, without a word on how many belong to a point."""
    return path.name.lower().endswith(".bin")


def read_fields(path: Source, columns: Sequence[str] = ()) -> PointFields:
    """Read the points of a file or of a message.

    columns: names of the columns of a `.bin` or `.npy` file; for `.npy` they may be left out.
    """
    if isinstance(path, BagMessage):
        return _named(cloud_fields(path), str(path), tuple(columns))
    return READERS[path.suffix.lower()](path, tuple(columns))


def read_floats(path: Path) -> np.ndarray:
    """Return all numbers of a `.bin` file, (M,) float32."""
    try:
        size = path.stat().st_size
        if size % FLOAT_BYTES:
            raise FormatError(
                f"{path}: expected float32 numbers of {FLOAT_BYTES} bytes, got {size} bytes"
            )
        return np.fromfile(path, "<f4")
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from error


def readable(read: Callable[[F], T], files: Iterable[F]) -> Iterator[T]:
    """Yield what `read` returns of those files that can be read.

    Raises the first error if there are only errors.
    """
    first_error, any_read = None, False
    for file in files:
        try:
            content = read(file)
        except FormatError as error:
            first_error = first_error or error
        else:
            any_read = True
            yield content
    if first_error and not any_read:
        raise first_error


def _read_bin(path: Path, columns: tuple[str, ...]) -> PointFields:
    floats, width = read_floats(path), len(columns)
    if len(floats) % width:
        raise FormatError(
            f"{path}: expected points of {width} float32, got {FLOAT_BYTES * len(floats)} bytes"
        )
    fields = _of_rows(floats.reshape(-1, width).astype(np.float64), columns)
    times = _point_times_path(path)
    if not times.is_file():
        return fields
    try:
        others = {**fields.others, TIME: _point_times(times, len(fields))}
    except FormatError as error:
        return replace(fields, problem=str(error))
    return PointFields(fields.points, others, times_beside=True)


def _read_npy(path: Path, columns: tuple[str, ...]) -> PointFields:
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise FormatError(f"{path}: expected an array saved by numpy, got: {error}") from error
    if isinstance(array, np.ndarray) and array.dtype.names:
        rows = array.ravel()
        return _named({name: rows[name] for name in array.dtype.names}, str(path), columns)
    if isinstance(array, np.ndarray) and array.ndim == 3:  # rows and columns of a range image
        array = array.reshape(-1, array.shape[-1])
    shape: tuple[int, ...] = getattr(array, "shape", ())
    expected = f"(N, {FEWEST_COLUMNS}) to (N, {MOST_COLUMNS})"
    if columns:
        expected = f"(N, {len(columns)})"
    fits = len(shape) == 2 and (
        shape[1] == len(columns) if columns else FEWEST_COLUMNS <= shape[1] <= MOST_COLUMNS
    )
    if not fits:
        actual = shape if isinstance(array, np.ndarray) else type(array).__name__
        raise FormatError(
            f"{path}: expected an array {expected} of x y z [intensity ...], got {actual}"
        )
    if array.dtype.kind not in "fiu":
        raise FormatError(f"{path}: expected numbers, got {array.dtype}")
    return _of_rows(array.astype(np.float64), columns or unnamed(shape[1]))


def _with_names(
    read: Callable[[Path], Mapping[str, np.ndarray]],
) -> Callable[[Path, tuple[str, ...]], PointFields]:
    """Return a reader of files whose fields have names. read: returns them by name."""
    return lambda path, columns: _named(read(path), str(path), columns)


def _named(fields: Mapping[str, np.ndarray], source: str, columns: tuple[str, ...]) -> PointFields:
    single = {name: values for name, values in fields.items() if values.ndim == 1}
    if columns or not set(PLACE) <= set(single):
        raise FormatError(f"{source}: its fields have names: {', '.join(single)}; {NAMED}")
    numbers = {name: values.astype(np.float64) for name, values in single.items()}
    points = np.column_stack([numbers.pop(name) for name in PLACE])
    return PointFields(points, numbers)


def _read_las(path: Path) -> dict[str, np.ndarray]:
    """Return x, y and z of all points in metres, intensity, and gps_time if the file has it."""
    if LASPY.missing:
        raise FormatError(f"{path}: {LASPY.missing}")
    import laspy

    try:
        cloud = laspy.read(path)
        names = [name for name in LAS_FIELDS if name in cloud.point_format.dimension_names]
        places = {name: np.asarray(getattr(cloud, name), np.float64) for name in PLACE}
        return places | {name: np.asarray(cloud[name], np.float64) for name in names}
    except Exception as error:
        # Damaged files raise errors of every kind, those of the decompressor among them.
        raise FormatError(f"{path}: expected a LAS or LAZ file: {error}") from error


READERS: Mapping[str, Callable[[Path, tuple[str, ...]], PointFields]] = {
    ".bin": _read_bin,
    ".pcd": _with_names(read_pcd),
    ".npy": _read_npy,
    ".ply": _with_names(read_ply),
    ".las": _with_names(_read_las),
    ".laz": _with_names(_read_las),
}
"""Suffix -> reader of the points."""


def _of_rows(rows: np.ndarray, columns: tuple[str, ...]) -> PointFields:
    """Return the fields of (N, W) rows."""
    place = [columns.index(name) for name in PLACE]
    others = {
        name: rows[:, k] for k, name in enumerate(columns) if name not in PLACE and name != IGNORED
    }
    return PointFields(rows[:, place], others)


def _point_times_path(path: Path) -> Path:
    """Return where an exported suite has the times of the points of `velodyne/SEQ/NAME.bin`."""
    sequence = path.absolute().parent
    return sequence.parent.parent / POINT_TIMES_FOLDER / sequence.name / path.name


def _point_times(path: Path, count: int) -> np.ndarray:
    times = read_floats(path)
    if len(times) != count:
        raise FormatError(
            f"{path}: expected float32, one for each of {count} points, got {len(times)}"
        )
    return times.astype(np.float64)
