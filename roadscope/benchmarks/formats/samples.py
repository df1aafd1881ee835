"""Samples of an IMU or of the wheels in text files beside scans: one per line, the stamp first.

A new kind of samples needs its columns, its file names, and a reader that calls `read_samples` and
checks the unit of the values.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.formats.bags import IMUS, Bag, imu_rows
from roadscope.benchmarks.formats.kitti_calibration import OXTS_COLUMNS, read_kitti_transform
from roadscope.benchmarks.formats.scan_stamps import (
    TIMES_FILES,
    in_order,
    rows_of_scans,
    stamp_table,
)
from roadscope.benchmarks.formats.table import FormatError, Table, read_lines, read_table, visible
from roadscope.core import ImuSamples, Pose, WheelSamples

IMU_FILES = ("imu.csv", "imu.txt")
IMU_COLUMNS = ("stamp", "wx", "wy", "wz", "ax", "ay", "az")
OXTS_FOLDER = "oxts"
OXTS_MOUNTING = "calib_imu_to_velo.txt"
"""The IMU of KITTI's raw drives, in the folder of the drive, and its mounting, beside the drive."""
WHEEL_FILES = ("wheels.csv", "wheels.txt")
WHEEL_COLUMNS = ("stamp", "speed")
MOUNTING_FIELDS = "x,y,z,roll,pitch,yaw"

MAX_STEP_S = 1.0
MIN_STEP_NS = 2e5
"""A median step of at most `MAX_STEP_S` is in seconds, one of at least `MIN_STEP_NS` is in
nanoseconds (samples of at most 5 kHz). One in between is in another unit: wheel speeds with stamps
in microseconds have steps of about 20 000."""
MAX_DISORDERED_SHARE = 0.01
"""A file with a larger share of stamps out of order is refused. Chosen by hand."""
MIN_FORCE_M_S2 = 5.0
MAX_FORCE_M_S2 = 20.0
"""The median specific force of a vehicle, or of a person on foot, is near gravity. Chosen by
hand."""
MAX_RATE_RAD_S = 6.0
"""Vehicles and people turn more slowly in 99 % of the samples. Chosen by hand."""
MAX_SPEED_M_S = 90.0
"""Vehicles on roads are slower in 99 % of the samples. Chosen by hand."""


@dataclass(frozen=True, slots=True)
class StampedSamples:
    """Usable samples in order of time.

    stamps_s: (K,) float64, seconds, strictly rising.
    values: (K, C) float64, the columns after the stamp.
    left_out: number of lines without use: a field is `nan` or `inf`, or the stamp is out of order.
    """

    stamps_s: np.ndarray
    values: np.ndarray
    left_out: int


def read_imu(path: Path | str) -> tuple[ImuSamples, int]:
    """Read lines of `stamp wx wy wz ax ay az`, rad/s and m/s^2, as `read_samples` does.

    Return the samples and the number of lines that are left out.
    """
    path = Path(path)
    samples = _read_oxts(path) if path.is_dir() else read_samples(path, IMU_COLUMNS)
    return _checked_imu(samples, str(path)), samples.left_out


def read_bag_imu(bag: Bag, topics: Sequence[str] = ()) -> tuple[ImuSamples, int] | None:
    """Read the messages of type Imu of a bag, as `read_imu` does; None if there are none.

    topics: of which one is meant, if there are several of this type.
    """
    topic = bag.topic(IMUS, topics)
    if topic is None:
        return None
    rows = imu_rows(bag, topic)
    usable = rows[np.isfinite(rows).all(axis=1)]
    usable = usable[rising_rows(usable[:, 0])] if len(usable) else usable
    source = f"{bag.path}, {topic}"
    if len(usable) < 2:
        raise FormatError(f"{source}: expected two or more samples, got {len(usable)}")
    samples = StampedSamples(usable[:, 0], usable[:, 1:], len(rows) - len(usable))
    return _checked_imu(samples, source), samples.left_out


def _checked_imu(samples: StampedSamples, source: str) -> ImuSamples:
    """Return samples of an IMU; refuse other units than rad/s and m/s^2."""
    rates, forces = samples.values[:, :3], samples.values[:, 3:]
    force = float(np.median(np.linalg.norm(forces, axis=1)))
    if not MIN_FORCE_M_S2 < force < MAX_FORCE_M_S2:
        raise FormatError(
            f"{source}: expected ax ay az in m/s^2 with gravity, about 9.8 at rest, got a median "
            f"of {force:.2f}; they may be in g, or gravity may be subtracted"
        )
    rate = float(np.quantile(np.linalg.norm(rates, axis=1), 0.99))
    if rate > MAX_RATE_RAD_S:
        raise FormatError(
            f"{source}: expected wx wy wz in rad/s, up to {MAX_RATE_RAD_S:g}, got up to "
            f"{rate:.1f}; they may be in degrees per second"
        )
    return ImuSamples(samples.stamps_s, rates, forces)


def read_wheels(path: Path | str) -> tuple[WheelSamples, int]:
    """Read lines of `stamp speed`, m/s along the vehicle, as `read_samples` does.

    Return the samples and the number of lines that are left out.
    """
    path = Path(path)
    samples = read_samples(path, WHEEL_COLUMNS)
    speeds = samples.values[:, 0]
    fastest = float(np.quantile(np.abs(speeds), 0.99))
    if fastest > MAX_SPEED_M_S:
        raise FormatError(
            f"{path}: expected speeds in m/s, up to {MAX_SPEED_M_S:g}, got up to {fastest:.1f}; "
            "they may be in km/h"
        )
    return WheelSamples(samples.stamps_s, speeds), samples.left_out


def find_imu(folder: Path) -> Path | None:
    """Return the file of IMU samples in a folder of scans or beside it; None if there is none.

    For a raw drive of KITTI it is the folder `oxts`.
    """
    path = folder.absolute()
    drives = (each / OXTS_FOLDER for each in (path, path.parent, path.parent.parent))
    oxts = next((each for each in drives if (each / TIMES_FILES[1]).is_file()), None)
    return _find_beside(folder, IMU_FILES) or oxts


def mounting_of(imu: Path) -> Pose | None:
    """Return `lidar_from_imu` of a raw drive of KITTI; None for other files."""
    file = imu.parent.parent / OXTS_MOUNTING
    return read_kitti_transform(file) if imu.is_dir() and file.is_file() else None


def find_wheels(folder: Path) -> Path | None:
    """Return the file of wheel speeds in a folder of scans or beside it; None if there is none."""
    return _find_beside(folder, WHEEL_FILES)


def parse_mounting(text: str) -> Pose:
    """Return `lidar_from_imu` for x, y, z in metres and roll, pitch, yaw in degrees."""
    try:
        numbers = [float(part) for part in text.replace(",", " ").split()]
        x, y, z, *angles_deg = (number for number in numbers if np.isfinite(number))
        roll, pitch, yaw = np.deg2rad(angles_deg)
    except ValueError:
        raise FormatError(
            f"expected a mounting {MOUNTING_FIELDS}, in metres and degrees, got {text!r}"
        ) from None
    return Pose.from_euler(x, y, z, roll=roll, pitch=pitch, yaw=yaw)


def read_samples(path: Path, columns: Sequence[str]) -> StampedSamples:
    """Read lines with these columns, the first one a stamp, split at commas or white space.

    Stamps are in seconds or in whole nanoseconds, on the clock of the scans. A line of names at the
    top and lines that begin with `#` are skipped. A few stamps may be out of order, such as those
    of samples that came late. A file with many of them is refused: its clock was set back.
    """
    text = _read_text(path, columns)
    finite = np.flatnonzero(np.isfinite(text.values).all(axis=1))
    values = text.values[finite]
    rising = rising_rows(values[:, 0])
    if len(values) - len(rising) > max(MAX_DISORDERED_SHARE * len(values), 1):
        falling = np.flatnonzero(np.diff(values[:, 0]) <= 0)
        row = int(finite[falling[0] + 1])
        text.table.refuse(
            row, "a stamp above the stamp of the line before", text.table.rows[row][0]
        )
    usable = values[rising]
    if len(usable) < 2:
        names = " ".join(columns)
        raise FormatError(f"{path}: expected two or more lines of {names}, got {len(usable)}")
    seconds = _seconds_per_unit(path, usable[:, 0])
    return StampedSamples(usable[:, 0] * seconds, usable[:, 1:], len(text.values) - len(usable))


def rising_rows(stamps: np.ndarray) -> np.ndarray:
    """Return the numbers of the longest sequence of rows whose stamps rise strictly, in order.

    stamps: (K,).
    Schensted 1961: for each length, keep the lowest stamp that ends a rising sequence of it.
    """
    if (np.diff(stamps) > 0).all():
        return np.arange(len(stamps))
    end_stamps: list[float] = []
    end_rows: list[int] = []
    previous = np.full(len(stamps), -1)
    for row, stamp in enumerate(stamps.tolist()):
        length = bisect_left(end_stamps, stamp)
        previous[row] = end_rows[length - 1] if length else -1
        end_stamps[length : length + 1] = [stamp]
        end_rows[length : length + 1] = [row]
    rows = [end_rows[-1]]
    while previous[rows[-1]] >= 0:
        rows.append(int(previous[rows[-1]]))
    return np.array(rows[::-1])


def _read_oxts(folder: Path) -> StampedSamples:
    """Read the turn rates and specific forces of a raw drive of KITTI, as `read_samples` does."""
    table = stamp_table(folder / TIMES_FILES[1])
    files = in_order(visible(folder / "data", "*.txt"), (".txt",))
    stamps = table.numbers(0, 1)[rows_of_scans(table, files), 0]
    tables = [read_table(file, OXTS_COLUMNS, required=25) for file in files.files]
    columns = [OXTS_COLUMNS.index(name) for name in IMU_COLUMNS[1:]]
    values = np.array([table.numbers(0, 25)[0, columns] for table in tables]).reshape(-1, 6)
    rising = rising_rows(stamps)
    return StampedSamples(stamps[rising], values[rising], len(stamps) - len(rising))


class _SampleText(NamedTuple):
    """The lines of a file of samples.

    values: (N, C) float64, in which `nan` and `inf` are allowed.
    """

    table: Table
    values: np.ndarray


def _read_text(path: Path, columns: Sequence[str]) -> _SampleText:
    """Read the lines; a comma in the first two lines that are no comments is the separator."""
    content = (line for line in read_lines(path) if line.strip() and not line.startswith("#"))
    separator = "," if any("," in line for line in islice(content, 2)) else None
    table = read_table(path, columns, separator=separator, comment="#", header=True)
    return _SampleText(table, table.numbers_or_nan(0, len(columns)))


def _seconds_per_unit(path: Path, stamps: np.ndarray) -> float:
    """Return 1 for stamps in seconds and 1e-9 for stamps in nanoseconds; others are refused."""
    step = float(np.median(np.diff(stamps)))
    if 0 < step <= MAX_STEP_S:
        return 1.0
    if step >= MIN_STEP_NS:
        return 1e-9
    raise FormatError(
        f"{path}: expected stamps in seconds (steps up to {MAX_STEP_S:g}) or in nanoseconds (steps "
        f"from {MIN_STEP_NS:g}), got steps of {step:g}"
    )


def _find_beside(folder: Path, names: Sequence[str]) -> Path | None:
    """Return the first file with one of the names, in the folder or in its parent."""
    paths = (root / name for root in (folder, folder.parent) for name in names)
    return next((path for path in paths if path.is_file()), None)
