"""Folders of scans, one file each: KITTI's `.bin`, `.pcd`, `.npy`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.pcd import read_pcd
from roadscope.benchmarks.formats.scan_layout import rings_and_columns, rings_of
from roadscope.benchmarks.formats.table import FormatError, read_table
from roadscope.core import LidarScan
from roadscope.core.scan import FARTHEST_M

SUFFIXES = (".bin", ".pcd", ".npy")
TIMES = "times.txt"
POINT_TIMES = "velodyne_times"
"""Folder of the times of points beside `velodyne`, as `roadscope export` writes them."""
NEAREST_S, FARTHEST_S = 0.01, 5.0
"""Scans follow one another so far apart, which tells the unit of their stamps."""
NUMBERS = re.compile(r"([0-9]+)")
UNITS_S = (1.0, 1e-3, 1e-6, 1e-9)
TIME_FIELDS = ("time", "t", "timestamp", "offset_time", "time_offset_s")
"""What drivers call a point's time."""
INTENSITY_FIELDS = ("intensity", "i", "reflectivity")
RING_FIELDS = ("ring", "channel", "line")
COLUMNS = "x y z [intensity [time in seconds]]"


@dataclass(frozen=True, slots=True)
class ScanFolder:
    """Files of scans, in order, and when each was taken.

    stamps_s: as many; from the file `times`, one number a line, in seconds or milli-, micro- or
        nanoseconds, or at `rate_hz`.
    """

    files: tuple[Path, ...]
    stamps_s: tuple[float, ...]
    rate_hz: float
    times: Path | None = None

    @staticmethod
    def find(folder: Path | str, *, rate_hz: float = 10.0) -> ScanFolder:
        """Take a folder of scans of one kind; others are refused with what was found."""
        root = Path(folder)
        if not root.is_dir():
            raise FormatError(f"{root}: no such folder; expected one with {', '.join(SUFFIXES)}")
        if not rate_hz > 0:
            raise FormatError(f"a rate is above 0 Hz, got {rate_hz}")
        files = sorted((p for p in root.iterdir() if p.suffix.lower() in SUFFIXES), key=_order)
        if not files:
            seen = ", ".join(sorted(p.name for p in root.iterdir())[:8]) or "nothing"
            raise FormatError(f"{root}: expected files {', '.join(SUFFIXES)}, got {seen}")
        kinds = sorted({p.suffix.lower() for p in files})
        if len(kinds) > 1:
            raise FormatError(f"{root}: expected scans of one kind, got {' and '.join(kinds)}")
        times = next((p for p in (root / TIMES, root.parent / TIMES) if p.is_file()), None)
        return ScanFolder(tuple(files), _stamps(times, len(files), rate_hz), rate_hz, times)

    def __len__(self) -> int:
        return len(self.files)

    def __iter__(self) -> Iterator[LidarScan]:
        for path, stamp_s in zip(self.files, self.stamps_s, strict=True):
            yield read_scan(path, stamp_s)


def read_scan(path: Path | str, stamp_s: float) -> LidarScan:
    """Read a scan; its points' times, where it has any, are told from the middle of the sweep.

    Without times the scan is taken as seen all at once, as one is whose own motion has been taken
    out. Beams are those that a `.pcd` tells, else bands of elevation. Points that are no numbers,
    as drivers write for rays without a return, are left out.
    """
    path = Path(path)
    rows = _pcd_rows(path) if path.suffix.lower() == ".pcd" else _rows(path)
    near = (np.abs(rows[:, :3]) <= FARTHEST_M).all(axis=1) & rows[:, :3].any(axis=1)
    rows = rows[near & np.isfinite(rows).all(axis=1)]
    points = rows[:, :3].astype(np.float32)
    ring, column = rings_and_columns(points)
    beams = rings_of(points, rows[:, 5])
    ring = ring if beams is None else beams
    intensity = rows[:, 3] / max(1.0, float(rows[:, 3].max(initial=0)))
    return LidarScan(
        points, np.clip(intensity, 0, 1), ring, column, _offsets(path, rows[:, 4]), stamp_s,
        "lidar",
    )  # fmt: skip


def _rows(path: Path) -> np.ndarray:
    """Return (N, 6) x y z intensity time and ring, 0 where unknown, of a `.bin` or `.npy`."""
    if path.suffix.lower() == ".bin":
        rows = _filled(_bin(path))
        if (times := _times_beside(path)).is_file():
            rows[:, 4] = _point_times(times, len(rows))
        return rows
    try:
        given = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise FormatError(f"{path}: expected an array saved by numpy, got: {error}") from error
    if not isinstance(given, np.ndarray) or given.ndim != 2 or not 3 <= given.shape[1] <= 5:
        raise FormatError(f"{path}: expected an array (N, 3) to (N, 5) of {COLUMNS}, got "
                          f"{getattr(given, 'shape', type(given).__name__)}")  # fmt: skip
    if given.dtype.kind not in "fiu":
        raise FormatError(f"{path}: expected numbers, got {given.dtype}")
    return _filled(given)


def _bin(path: Path) -> np.ndarray:
    size = path.stat().st_size
    if size % 16:
        five = (
            ""
            if size % 20
            else (
                "; if those are five numbers a point, as nuScenes writes them: "
                "numpy.fromfile(FILE, 'f4').reshape(-1, 5)[:, :4], saved as .npy"
            )
        )
        raise FormatError(f"{path}: expected float32 x y z intensity, 16 bytes a point, "
                          f"got {size} bytes{five}")  # fmt: skip
    return np.fromfile(path, "<f4").reshape(-1, 4)


def _times_beside(path: Path) -> Path:
    """Return where an exported suite has the times of the points of `velodyne/SEQ/NAME.bin`."""
    sequence = path.absolute().parent
    return sequence.parent.parent / POINT_TIMES / sequence.name / path.name


def _point_times(path: Path, count: int) -> np.ndarray:
    times = np.fromfile(path, "<f4") if path.stat().st_size == 4 * count else None
    if times is None:
        raise FormatError(f"{path}: expected float32, one for each of {count} points")
    return times


def _pcd_rows(path: Path) -> np.ndarray:
    fields = read_pcd(path)
    rows = np.zeros((len(fields["x"]), 6))
    told = [("x",), ("y",), ("z",), INTENSITY_FIELDS, TIME_FIELDS, RING_FIELDS]
    for column, names in enumerate(told):
        name = next((n for n in names if n in fields), None)
        if name is not None:
            rows[:, column] = fields[name]
    return rows


def _filled(given: np.ndarray) -> np.ndarray:
    rows = np.zeros((len(given), 6))
    rows[:, : given.shape[1]] = given
    return rows


def _offsets(path: Path, times: np.ndarray) -> np.ndarray:
    """Return seconds about the middle of the sweep; nanoseconds and microseconds are told apart."""
    if not len(times) or times.max() == times.min():
        return np.zeros(len(times))
    length = float(times.max() - times.min())
    unit = next((u for u in UNITS_S if 0.005 <= length * u <= 1.0), None)
    if unit is None:
        raise FormatError(
            f"{path}: expected times of points over 5 ms to 1 s, in seconds or milli-, micro- or "
            f"nanoseconds, got {length:g} from first to last"
        )
    offsets: np.ndarray = (times - (times.max() + times.min()) / 2) * unit
    return offsets


def _stamps(path: Path | None, count: int, rate_hz: float) -> tuple[float, ...]:
    if path is None:
        return tuple(k / rate_hz for k in range(count))
    table = read_table(path, ("seconds",))
    if len(table) != count:
        raise FormatError(f"{path}: expected {count} lines, one a scan, got {len(table)}")
    stamps = table.numbers(0, 1)[:, 0]
    step = float(np.median(np.diff(stamps))) if count > 1 else 0.0
    unit = next((u for u in UNITS_S if NEAREST_S <= step * u <= FARTHEST_S), None)
    if unit is None and step > FARTHEST_S:
        raise FormatError(
            f"{path}: expected stamps {NEAREST_S:g} to {FARTHEST_S:g} s apart, in seconds or "
            f"milli-, micro- or nanoseconds, got steps of {step:g}"
        )
    return tuple((stamps * (unit or 1.0)).tolist())


def _order(path: Path) -> list[tuple[int, str]]:
    """Numbers in names count, so that 10 comes after 9."""
    parts = NUMBERS.split(path.stem)
    return [(int(part), part) if part.isdigit() else (-1, part) for part in parts if part]
