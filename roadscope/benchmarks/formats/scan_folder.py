"""Folders of scans, one file each (KITTI's `.bin`, `.pcd`, `.npy`), and their stamps.

A new suffix needs an entry in `POINT_READERS`. `PointColumns` says which columns a file has.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.formats.pcd import read_pcd
from roadscope.benchmarks.formats.table import FormatError, names_in, read_table
from roadscope.core import LidarScan
from roadscope.core.scan import FARTHEST_M, MOST_RINGS

TIMES_FILE = "times.txt"
"""The stamps of scans, in their folder or beside it."""
POINT_TIMES_FOLDER = "velodyne_times"
"""The folder with the times of points beside `velodyne`, as `roadscope export` writes it."""
MIN_SCAN_STEP_S = 0.01
MAX_SCAN_STEP_S = 5.0
"""The time between two scans, by which the unit of their stamps is known. Chosen by hand."""
MIN_SWEEP_S = 0.005
MAX_SWEEP_S = 1.0
"""The time between the first and the last point of a scan, by which the unit of their times is
known. Chosen by hand."""
TIME_UNITS_S = (1.0, 1e-3, 1e-6, 1e-9)
TIME_UNITS = "in seconds or milli-, micro- or nanoseconds"
TIME_FIELDS = ("time", "t", "timestamp", "offset_time", "time_offset_s")
INTENSITY_FIELDS = ("intensity", "i", "reflectivity")
RING_FIELDS = ("ring", "channel", "line")
"""Names of a point's time, intensity and beam in `.pcd` files; drivers differ."""
COLUMNS = "x y z [intensity [time in seconds]]"
"""Columns of `.npy` files."""

AZIMUTH_STEP_RAD = np.deg2rad(0.2)
"""Azimuth steps of common sensors at 10 Hz."""
MAX_BEAM_HEIGHT_RAD = np.deg2rad(0.4)
"""Elevations within this are of one beam: HDL-64E's beams are 0.33 to 0.5 degrees apart."""
MIN_BEAM_GAP_RAD = np.deg2rad(0.1)
"""There are no points within at least this gap between two beams. Chosen by hand."""


@dataclass(frozen=True, slots=True)
class ScanFolder:
    """Files of scans in order, and their stamps.

    stamps_s: seconds, one per file; from `times_file`, otherwise at `rate_hz` from 0 on.
    times_file: one number per line, in seconds or milli-, micro- or nanoseconds; None without it.
    """

    files: tuple[Path, ...]
    stamps_s: tuple[float, ...]
    rate_hz: float
    times_file: Path | None = None

    @staticmethod
    def find(folder: Path | str, *, rate_hz: float = 10.0) -> ScanFolder:
        """Return the scans of a folder; they must all be of one kind.

        rate_hz: scans per second if there is no file of stamps.
        """
        root, suffixes = Path(folder), ", ".join(POINT_READERS)
        if not root.is_dir():
            raise FormatError(f"{root}: no such folder; expected one with {suffixes}")
        if not rate_hz > 0:
            raise FormatError(f"expected a rate above 0 Hz, got {rate_hz}")
        files = sorted((p for p in root.iterdir() if p.suffix.lower() in POINT_READERS), key=_order)
        if not files:
            raise FormatError(f"{root}: expected files {suffixes}, got {names_in(root)}")
        kinds = sorted({p.suffix.lower() for p in files})
        if len(kinds) > 1:
            raise FormatError(f"{root}: expected scans of one kind, got {' and '.join(kinds)}")
        places = (root / TIMES_FILE, root.parent / TIMES_FILE)
        times_file = next((path for path in places if path.is_file()), None)
        if times_file is None:
            stamps_s = tuple(k / rate_hz for k in range(len(files)))
        else:
            stamps_s = _read_stamps(times_file, len(files))
        return ScanFolder(tuple(files), stamps_s, rate_hz, times_file)

    def __len__(self) -> int:
        return len(self.files)

    def __iter__(self) -> Iterator[LidarScan]:
        for path, stamp_s in zip(self.files, self.stamps_s, strict=True):
            yield read_scan(path, stamp_s)


@dataclass(frozen=True, slots=True)
class PointColumns:
    """The columns of one scan file as float64, in the file's units; None for one that it lacks.

    points: (N, 3) x y z.
    intensities: (N,) of any range.
    times: (N,) of any unit and origin.
    rings: (N,) beam numbers in the file's own order.
    """

    points: np.ndarray
    intensities: np.ndarray | None = None
    times: np.ndarray | None = None
    rings: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.points)

    def select(self, index: np.ndarray) -> PointColumns:
        """Return the points of a mask or an index array."""
        optional = (self.intensities, self.times, self.rings)
        return PointColumns(
            self.points[index], *(None if each is None else each[index] for each in optional)
        )

    def usable(self) -> np.ndarray:
        """Return (N,) bool: all columns are finite, and the point is neither at 0 nor too far.

        Drivers write such points for rays without a return.
        """
        near = (np.abs(self.points) <= FARTHEST_M).all(axis=1)
        usable: np.ndarray = near & self.points.any(axis=1)
        for column in (self.intensities, self.times, self.rings):
            if column is not None:
                usable &= np.isfinite(column)
        return usable


def read_scan(path: Path | str, stamp_s: float) -> LidarScan:
    """Read a scan, without the points of rays that had no return.

    stamp_s: the middle of the sweep. The times of points count from there; a file without times is
        read as if all points were measured at once, as in a scan that was deskewed.
    Beams are those of the file (`.pcd` only), otherwise `rings_and_columns` finds them.
    """
    path = Path(path)
    columns = POINT_READERS.get(path.suffix.lower(), _read_npy)(path)
    columns = columns.select(columns.usable())
    points = columns.points.astype(np.float32)
    layout = rings_and_columns(points)
    rings = None if columns.rings is None else ranked_rings(points, columns.rings)
    return LidarScan(
        points=points,
        intensity=_scaled_intensities(columns),
        ring=layout.rings if rings is None else rings,
        column=layout.columns,
        time_offset_s=_time_offsets(path, columns),
        stamp_s=stamp_s,
        sensor="lidar",
    )


class ScanLayout(NamedTuple):
    """The beam and the azimuth step of each of N points.

    rings: (N,) int16, number of the beam, 0 the lowest.
    columns: (N,) int32, azimuth steps, clockwise from behind.
    """

    rings: np.ndarray
    columns: np.ndarray


def rings_and_columns(points: np.ndarray) -> ScanLayout:
    """Return the beam and the azimuth step of (N, 3) points, found by their directions.

    Beams are separated by gaps between elevations. If there are no gaps, as in a deskewed scan,
    bands of elevation take their place; one of them may hold two beams of the sensor.
    """
    if not len(points):
        return ScanLayout(np.zeros(0, np.int16), np.zeros(0, np.int32))
    x, y, _ = points.T.astype(np.float64)
    elevations = _elevations(points)
    rings = _rings_by_gaps(elevations)
    if rings is None:
        rings = np.floor((elevations - elevations.min()) / MAX_BEAM_HEIGHT_RAD)
    columns = np.floor((np.pi - np.arctan2(y, x)) / AZIMUTH_STEP_RAD)
    return ScanLayout(rings.astype(np.int16), columns.astype(np.int32))


def ranked_rings(points: np.ndarray, numbers: np.ndarray) -> np.ndarray | None:
    """Return (N,) int16 beams, 0 the lowest; None if the numbers cannot be those of beams.

    points: (N, 3).
    numbers: (N,) beam numbers of the file. They may count from below or from above, with gaps for
        beams without returns; numbers in another order, as of firing, are ranked by elevation.
    """
    known, beams = np.unique(numbers, return_inverse=True)
    span = known[-1] - known[0] if len(known) else 0
    if len(known) < 2 or span >= MOST_RINGS or (known != np.floor(known)).any():
        return None
    mean = np.bincount(beams, _elevations(points)) / np.bincount(beams)
    rises = np.diff(mean) > 0
    rank = np.empty(len(known), np.int16)
    if rises.all():
        rank[:] = known - known[0]
    elif not rises.any():
        rank[:] = known[-1] - known
    else:
        rank[np.argsort(mean, kind="stable")] = np.arange(len(known))
    rings: np.ndarray = rank[beams]
    return rings


def _elevations(points: np.ndarray) -> np.ndarray:
    x, y, z = points.T.astype(np.float64)
    elevations: np.ndarray = np.arctan2(z, np.hypot(x, y))
    return elevations


def _rings_by_gaps(elevations: np.ndarray) -> np.ndarray | None:
    """Return (N,) beams between gaps; None if one is too high or if there are too many."""
    order = np.argsort(elevations, kind="stable")
    rising = elevations[order]
    starts = np.concatenate([[0], np.flatnonzero(np.diff(rising) > MIN_BEAM_GAP_RAD) + 1])
    ends = np.concatenate([starts[1:], [len(rising)]]) - 1
    highest = (rising[ends] - rising[starts]).max()
    if len(starts) > MOST_RINGS or highest > MAX_BEAM_HEIGHT_RAD:
        return None
    rings = np.empty(len(elevations))
    rings[order] = np.repeat(np.arange(len(starts)), ends - starts + 1)
    return rings


def _read_bin(path: Path) -> PointColumns:
    size = path.stat().st_size
    if size % 16:
        hint = ""
        if not size % 20:
            hint = (
                "; if those are five numbers a point, as nuScenes writes them: "
                "numpy.fromfile(FILE, 'f4').reshape(-1, 5)[:, :4], saved as .npy"
            )
        raise FormatError(
            f"{path}: expected float32 x y z intensity, 16 bytes a point, got {size} bytes{hint}"
        )
    rows = np.fromfile(path, "<f4").reshape(-1, 4).astype(np.float64)
    times_path = _point_times_path(path)
    times = _read_point_times(times_path, len(rows)) if times_path.is_file() else None
    return PointColumns(rows[:, :3], rows[:, 3], times)


def _read_npy(path: Path) -> PointColumns:
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise FormatError(f"{path}: expected an array saved by numpy, got: {error}") from error
    if not isinstance(array, np.ndarray) or array.ndim != 2 or not 3 <= array.shape[1] <= 5:
        actual = getattr(array, "shape", type(array).__name__)
        raise FormatError(f"{path}: expected an array (N, 3) to (N, 5) of {COLUMNS}, got {actual}")
    if array.dtype.kind not in "fiu":
        raise FormatError(f"{path}: expected numbers, got {array.dtype}")
    rows = array.astype(np.float64)
    return PointColumns(rows[:, :3], *rows.T[3:])


def _read_pcd(path: Path) -> PointColumns:
    fields = read_pcd(path)

    def first_of(names: tuple[str, ...]) -> np.ndarray | None:
        name = next((name for name in names if name in fields), None)
        return None if name is None else fields[name].astype(np.float64)

    return PointColumns(
        np.column_stack([fields[name].astype(np.float64) for name in "xyz"]),
        first_of(INTENSITY_FIELDS),
        first_of(TIME_FIELDS),
        first_of(RING_FIELDS),
    )


POINT_READERS: Mapping[str, Callable[[Path], PointColumns]] = {
    ".bin": _read_bin,
    ".pcd": _read_pcd,
    ".npy": _read_npy,
}
"""Suffix -> reader of the points."""


def _point_times_path(path: Path) -> Path:
    """Return where an exported suite has the times of the points of `velodyne/SEQ/NAME.bin`."""
    sequence = path.absolute().parent
    return sequence.parent.parent / POINT_TIMES_FOLDER / sequence.name / path.name


def _read_point_times(path: Path, count: int) -> np.ndarray:
    if path.stat().st_size != 4 * count:
        raise FormatError(
            f"{path}: expected float32, one for each of {count} points, "
            f"got {path.stat().st_size} bytes"
        )
    return np.fromfile(path, "<f4").astype(np.float64)


def _scaled_intensities(columns: PointColumns) -> np.ndarray:
    """Return (N,) intensities from 0 to 1; the largest becomes 1 if it is above 1."""
    if columns.intensities is None:
        return np.zeros(len(columns))
    scaled = columns.intensities / max(1.0, float(columns.intensities.max(initial=0)))
    return np.clip(scaled, 0, 1)


def _time_offsets(path: Path, columns: PointColumns) -> np.ndarray:
    """Return (N,) seconds from the middle of the sweep; all 0 for a file without times."""
    times = columns.times
    if times is None or not len(times) or times.max() == times.min():
        return np.zeros(len(columns))
    length = float(times.max() - times.min())
    unit_s = time_unit_s(length, shortest_s=MIN_SWEEP_S, longest_s=MAX_SWEEP_S)
    if unit_s is None:
        raise FormatError(
            f"{path}: expected times of points over {MIN_SWEEP_S * 1000:g} ms to {MAX_SWEEP_S:g} "
            f"s, {TIME_UNITS}, got {length:g} from first to last"
        )
    offsets: np.ndarray = (times - (times.max() + times.min()) / 2) * unit_s
    return offsets


def time_unit_s(length: float, *, shortest_s: float, longest_s: float) -> float | None:
    """Return the first of `TIME_UNITS_S` in which a time is within the limits; None if none is.

    length: a time in an unknown unit.
    """
    return next((unit for unit in TIME_UNITS_S if shortest_s <= length * unit <= longest_s), None)


def _read_stamps(path: Path, count: int) -> tuple[float, ...]:
    """Return seconds, one per scan; the median step decides the unit."""
    table = read_table(path, ("seconds",))
    if len(table) != count:
        raise FormatError(f"{path}: expected {count} lines, one a scan, got {len(table)}")
    stamps = table.numbers(0, 1)[:, 0]
    step = float(np.median(np.diff(stamps))) if count > 1 else 0.0
    unit_s = time_unit_s(step, shortest_s=MIN_SCAN_STEP_S, longest_s=MAX_SCAN_STEP_S)
    if unit_s is None and step > MAX_SCAN_STEP_S:
        raise FormatError(
            f"{path}: expected stamps {MIN_SCAN_STEP_S:g} to {MAX_SCAN_STEP_S:g} s apart, "
            f"{TIME_UNITS}, got steps of {step:g}"
        )
    return tuple((stamps * (unit_s or 1.0)).tolist())


def _order(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that compares numbers in names as numbers: 9 comes before 10."""
    parts = re.split(r"([0-9]+)", path.stem)
    return [(int(part), part) if part.isdigit() else (-1, part) for part in parts if part]
