"""Recordings of scans: folders with a file each, and bags of ROS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.bags import (
    BAG_ENDINGS,
    CLOUDS,
    NS,
    Bag,
    BagMessage,
    Source,
    open_bag,
)
from roadscope.benchmarks.formats.point_fields import ENDINGS, READERS, ending_of
from roadscope.benchmarks.formats.point_layout import MAX_SWEEP_S, PointLayout, ReadScan, layout_of
from roadscope.benchmarks.formats.scan_stamps import (
    in_order,
    recorded_stamps,
    stamps_of_files,
    without_ending,
)
from roadscope.benchmarks.formats.table import FormatError, names_in, visible
from roadscope.core import LidarScan

SCAN_FOLDERS = ("velodyne", "velodyne_points/data")
"""Where KITTI has the scans of a sequence, and of a raw drive."""
SAMPLES = 5
"""So many scans of a folder tell which field of their points is what."""


@dataclass(slots=True)
class ReadingLosses:
    """What could not be used of the scans that were read.

    points: how many are left out of each file, by reason.
    scans: the errors of files that could not be read; they count as empty scans.
    fields: of which files a field that others have is not used, and why.
    empty: files that have no points of use.
    A file that is read again counts once.
    """

    points: dict[Source, Counter[str]] = field(default_factory=dict)
    scans: dict[Source, FormatError] = field(default_factory=dict)
    fields: dict[Source, str] = field(default_factory=dict)
    empty: set[Source] = field(default_factory=set)

    def add(self, path: Source, read: ReadScan) -> LidarScan:
        """Return the scan of a file, and count what is left out of it."""
        self.points[path] = read.left_out
        if not len(read.scan):
            self.empty.add(path)
        elif read.lacks:
            self.fields[path] = "; ".join(read.lacks)
        return read.scan

    def notes(self) -> tuple[str, ...]:
        """Return what was lost, in sentences."""
        total = sum(self.points.values(), Counter[str]())
        notes = [
            f"{count} point{'s' if count > 1 else ''} left out: {reason}"
            for reason, count in total.items()
        ]
        if self.scans:
            first = next(iter(self.scans.values()))
            notes.append(_counted(len(self.scans), "taken as empty", str(first)))
        if self.empty:
            notes.append(
                _counted(len(self.empty), "without points", str(min(map(str, self.empty))))
            )
        if self.fields:
            path, why = next(iter(self.fields.items()))
            notes.append(_counted(len(self.fields), "read without a field", f"{path}: {why}"))
        return tuple(notes)


def _scans_are(count: int) -> str:
    return "1 scan is" if count == 1 else f"{count} scans are"


def _counted(count: int, what: str, first: str) -> str:
    """Return how many scans are such, and the first of them."""
    return f"{_scans_are(count)} {what}: {'the first: ' if count > 1 else ''}{first}"


@dataclass(frozen=True, slots=True)
class ScanFolder:
    """Files of scans in order, and their stamps; in a bag, messages stand for files.

    stamps_s: seconds, one per file: those of `times_file`, by the names of the files, or of
        messages.
    times_file: one number per line, in seconds or milli-, micro- or nanoseconds; None without it.
    layout: which field of the points is what.
    notes: what was assumed about order, stamps and fields, in sentences.
    measured: whether the stamps are of a clock; otherwise scans are counted.
    losses: what could not be used of the scans read so far.
    """

    files: tuple[Source, ...]
    stamps_s: tuple[float, ...]
    times_file: Path | None
    layout: PointLayout
    notes: tuple[str, ...]
    measured: bool = False
    losses: ReadingLosses = field(default_factory=ReadingLosses, compare=False)

    @staticmethod
    def find(
        folder: Path | str,
        *,
        rate_hz: float = 10.0,
        columns: Sequence[str] = (),
        topics: Sequence[str] = (),
        bag: Bag | None = None,
    ) -> ScanFolder:
        """Return the scans of a folder; they must all be of one kind. Hidden files are no scans.

        folder: of the scans, or of a sequence or a raw drive of KITTI; or a bag.
        rate_hz: scans per second if neither a file nor the names have stamps.
        columns: names of the columns of `.bin` and `.npy` files, if what is in them is not to
            decide: of x, y, z, intensity, ring, time, and `_` for one that is not used.
        topics: of a bag, if it has several of the type PointCloud2.
        bag: that of the folder, if it is open already.
        """
        root, suffixes = Path(folder), ", ".join((*READERS, *BAG_ENDINGS))
        files = scan_files(root)
        bag = None if files else bag or open_bag(root)
        if bag is not None:
            return _scans_of_bag(bag, columns, topics)
        if topics:
            raise FormatError(f"{root}: topics are of a bag, and there is none")
        if not root.is_dir():
            what = "a file" if root.is_file() else "no such folder"
            raise FormatError(f"{root}: {what}; expected a folder with {suffixes}")
        if not rate_hz > 0:
            raise FormatError(f"expected a rate above 0 Hz, got {rate_hz}")
        if not files:
            raise FormatError(f"{root}: expected files {suffixes}, got {names_in(root)}")
        kinds = sorted({ending_of(path) for path in files})
        if len(kinds) > 1:
            raise FormatError(f"{root}: expected scans of one kind, got {' and '.join(kinds)}")
        scans = in_order(files, ENDINGS)
        stamps, times_file = stamps_of_files(scans, rate_hz)
        layout = layout_of(_samples(scans.files), columns)
        notes = (*scans.notes, *stamps.notes, *layout.notes)
        return ScanFolder(scans.files, stamps.stamps_s, times_file, layout, notes, stamps.measured)

    def __len__(self) -> int:
        return len(self.files)

    @property
    def place(self) -> Path:
        """The folder with the scans."""
        first = self.files[0]
        return first.bag.path.parent if isinstance(first, BagMessage) else first.parent

    @property
    def bag(self) -> Bag | None:
        """The bag with the scans; None for files."""
        first = self.files[0]
        return first.bag if isinstance(first, BagMessage) else None

    @property
    def inputs(self) -> list[Path]:
        """All files with scans."""
        return [each.bag.path if isinstance(each, BagMessage) else each for each in self.files]

    @property
    def names(self) -> list[str]:
        """The names of the scans, without ending."""
        return [without_ending(path.name, ENDINGS) for path in self.files]

    def __iter__(self) -> Iterator[LidarScan]:
        """Yield all scans; one that cannot be read is empty and counted in `losses`."""
        return self.part(0, len(self))

    def part(self, first: int, end: int) -> Iterator[LidarScan]:
        """Yield the scans from `first` up to but not including `end`, as `__iter__` does."""
        for path, stamp_s in zip(self.files[first:end], self.stamps_s[first:end], strict=True):
            try:
                scan = self.losses.add(path, self.layout.read(path, stamp_s))
            except FormatError as error:
                self.losses.scans[path] = error
                yield empty_scan(stamp_s)
            else:
                yield scan


def scan_files(root: Path) -> list[Path]:
    """Return the files of scans in a folder or in one of `SCAN_FOLDERS` in it."""
    within = (root, *(root / name for name in SCAN_FOLDERS))
    files_by_folder = ([path for path in visible(each) if ending_of(path)] for each in within)
    return next((files for files in files_by_folder if files), [])


def _samples(files: Sequence[Source]) -> list[Source]:
    """Return some files from the whole folder, those without content only if all are."""
    filled = [each for each in files if isinstance(each, BagMessage) or _has_content(each)]
    filled = filled or list(files)
    rows = np.linspace(0, len(filled) - 1, min(SAMPLES, len(filled))).round().astype(int)
    return [filled[k] for k in rows]


def _has_content(path: Path) -> bool:
    """Return whether a file has bytes; False for one that cannot be read, such as a broken link."""
    with suppress(OSError):
        return path.stat().st_size > 0
    return False


def _scans_of_bag(bag: Bag, columns: Sequence[str], topics: Sequence[str]) -> ScanFolder:
    topic = bag.topic(CLOUDS, topics)
    if topic is None:
        listing = bag.listing() or "no topics"
        raise FormatError(f"{bag.path}: expected a topic of type PointCloud2, got {listing}")
    messages, left_out, by_recorder = bag.messages(topic)
    samples = _samples(messages)
    layout = layout_of(samples, columns)
    middle_s = _middle_s(layout, samples)
    names = [each.name for each in messages]
    stamps = recorded_stamps(np.array([each.stamp_ns * NS + middle_s for each in messages]), names)
    moved = (
        f"stamps are moved by {middle_s:.3f} s to the middle of the sweeps, which the times of "
        "points show"
        if middle_s
        else "stamps of messages are taken for the middle of the sweeps"
    )
    notes = (f"scans are those of {topic}", moved, *stamps.notes, *layout.notes)
    if by_recorder:
        notes += ("the stamps in the messages are all the same: those of the recording are used",)
    if left_out:
        why = "stamps more than a day from those of the others"
        notes += (f"{_scans_are(left_out)} left out: {why}",)
    return ScanFolder(messages, stamps.stamps_s, None, layout, notes, measured=True)


def _middle_s(layout: PointLayout, samples: Sequence[Source]) -> float:
    """Return the time from the stamp of a message to the middle of its sweep, median, seconds.

    Times of points count from the stamp, or from the epoch as it does; 0 without such times.
    """
    middles = []
    for each in samples:
        assert isinstance(each, BagMessage)
        with suppress(FormatError):
            middle_s = layout.middle_s(each)
            if np.isfinite(middle_s):
                middles.append(middle_s - (each.stamp_ns * NS if middle_s > MAX_SWEEP_S else 0.0))
    middle_s = float(np.median(middles)) if middles else 0.0
    return middle_s if abs(middle_s) <= MAX_SWEEP_S else 0.0


def read_scan(path: Path | str, stamp_s: float, columns: Sequence[str] = ()) -> LidarScan:
    """Read a scan, without the points of rays that had no return.

    stamp_s: the middle of the sweep. The times of points count from there; a file without times is
        read as if all points were measured at once, as in a scan that was deskewed.
    columns: see `ScanFolder.find`.
    Beams are those of the file if it has them, otherwise their directions tell them.
    """
    path = Path(path)
    if not ending_of(path):
        raise FormatError(f"{path}: expected a file {', '.join(READERS)}")
    return layout_of([path], columns).read(path, stamp_s).scan


def empty_scan(stamp_s: float) -> LidarScan:
    """Return a scan without points."""
    none = np.zeros(0)
    return LidarScan(np.zeros((0, 3)), none, none, none, none, stamp_s, "lidar")
