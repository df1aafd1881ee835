"""Scans, images and labels in folders of KITTI's object and tracking data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from roadscope.benchmarks.formats.kitti_calibration import (
    read_kitti_calibration,
    read_kitti_oxts,
    read_kitti_poses,
)
from roadscope.benchmarks.formats.kitti_cameras import KittiCamera
from roadscope.benchmarks.formats.kitti_frames import PERIOD_S
from roadscope.benchmarks.formats.kitti_labels import (
    KittiObjects,
    read_kitti_labels,
    read_kitti_object_labels,
)
from roadscope.benchmarks.formats.kitti_sequence import POSE_FOLDERS
from roadscope.benchmarks.formats.point_layout import layout_of
from roadscope.benchmarks.formats.table import FormatError, names_in, read_table, visible
from roadscope.benchmarks.formats.tracking_rows import ImageSize
from roadscope.core import LidarScan, Pose

SCANS, IMAGES = "velodyne", "images"
"""The sensors whose files a folder may have."""
SCAN_COLUMNS = ("x", "y", "z", "intensity")
POINT_BYTES = 16
POINTS = "points of float32 x y z intensity"
IMAGE_SIZE = ImageSize(1242, 375)
"""Of KITTI's images; it is assumed where there is no image."""
SAMPLES = 5
"""So many scans are looked at before a board begins."""
PART = 250
"""So many frames of the object data are one part, which is computed at once. Chosen by hand:
seconds to minutes for a detector."""
UNRELATED_S = 60.0
"""Time between frames of the object data, which are of different drives: longer than any method
looks back. Chosen by hand."""


class _Layout(NamedTuple):
    """Names of folders. by_sequence: whether a folder has one of its own for each sequence."""

    labels: str
    images: str
    by_sequence: bool

    def folder(self, sensor: str) -> str:
        """Return the folder of a sensor's files."""
        return self.images if sensor == IMAGES else sensor


OBJECT = _Layout("label_2", "image_2", by_sequence=False)
TRACKING = _Layout("label_02", "image_02", by_sequence=True)
LAYOUTS = (OBJECT, TRACKING)
ENDINGS = {SCANS: "bin", IMAGES: "png"}


class KittiView(NamedTuple):
    """The camera of a frame and the size of its image."""

    camera: KittiCamera
    image_size: ImageSize


@dataclass(frozen=True, slots=True)
class KittiFrames:
    """Frames that are read together: those of a sequence, or a part of the object data.

    root: the folder that holds `calib`. name: of the sequence, or first and last number.
    numbers: of the frames that have files of all sensors that are asked for, rising.
    """

    root: str
    name: str
    layout: _Layout
    numbers: tuple[int, ...]

    def file(self, sensor: str, number: int) -> Path:
        """Return a file of a sensor, `SCANS` or `IMAGES`."""
        folder = Path(self.root, self.layout.folder(sensor))
        folder = folder / self.name if self.layout.by_sequence else folder
        return folder / f"{number:06d}.{ENDINGS[sensor]}"

    def calibration(self, number: int) -> Path:
        """Return the calibration file of a frame."""
        return Path(self.root, "calib", f"{self._stem(number)}.txt")

    def label_file(self, number: int) -> Path:
        """Return the file of a frame's labels."""
        return Path(self.root, self.layout.labels, f"{self._stem(number)}.txt")

    def scans(self) -> Iterator[LidarScan]:
        """Yield the scans; their points are x y z intensity, float32."""
        yield from read_scans([self.file(SCANS, k) for k in self.numbers], self.stamps_s)

    def views(self) -> list[KittiView]:
        """Return the camera of each frame; without an image file it has KITTI's usual size."""
        if self.layout.by_sequence:
            return [self._view(self.numbers[0])] * len(self.numbers)
        return [self._view(number) for number in self.numbers]

    @property
    def stamps_s(self) -> tuple[float, ...]:
        """Seconds, by the numbers of the frames or by `times/SEQ.txt`, where there is one."""
        if not self.layout.by_sequence:
            return tuple(UNRELATED_S * k for k in range(len(self.numbers)))
        times = Path(self.root, "times", f"{self.name}.txt")
        if not times.is_file():
            return tuple(PERIOD_S * number for number in self.numbers)
        stamps_s = read_table(times, ("seconds",)).numbers(0, 1)[:, 0].tolist()
        self._require(times, stamps_s, "a stamp")
        chosen = tuple(stamps_s[number] for number in self.numbers)
        if any(after <= before for before, after in pairwise(chosen)):
            raise FormatError(f"{times}: expected stamps that rise from frame to frame")
        return chosen

    def poses(self) -> list[Pose] | None:
        """Return `world_from_ego` of each frame, for the ego of `kitti_frames`; None without."""
        paths = [Path(self.root, folder, f"{self.name}.txt") for folder in POSE_FOLDERS]
        path = next((each for each in paths if each.is_file()), None)
        if path is None or not self.layout.by_sequence:
            return None
        poses = (
            read_kitti_oxts(path, read_kitti_calibration(self.calibration(0)))
            if path.parent.name == "oxts"
            else read_kitti_poses(path)
        )
        self._require(path, poses, "a pose")
        return [poses[number] for number in self.numbers]

    def labels(self) -> list[KittiObjects]:
        """Return the labels of each frame, of every type."""
        if not self.layout.by_sequence:
            return [read_kitti_object_labels(self.label_file(k), k) for k in self.numbers]
        rows = read_kitti_labels(self.label_file(0)).by_frame(self.numbers[-1] + 1)
        return [rows[number] for number in self.numbers]

    def type_names(self) -> set[str]:
        """Return the types of labels in small letters; malformed lines are left out."""
        files = dict.fromkeys(self.label_file(number) for number in self.numbers)
        column = 2 if self.layout.by_sequence else 0
        lines = (line.split() for path in files for line in path.read_bytes().splitlines())
        return {
            fields[column].lower().decode(errors="replace")
            for fields in lines
            if len(fields) > column
        }

    def digest(self, sensors: Iterable[str]) -> str:
        """Return a digest of the files: bytes of text files, names, sizes and times of others.

        Images count without their sensor, too: boxes are clipped to their size.
        """
        digest = sha256()
        texts = [each(k) for k in self.numbers for each in (self.calibration, self.label_file)]
        texts += [Path(self.root, f, f"{self.name}.txt") for f in (*POSE_FOLDERS, "times")]
        for path in dict.fromkeys(texts):
            digest.update(path.read_bytes() if path.is_file() else b"none")
            digest.update(b"\0")
        kinds = dict.fromkeys((*sensors, IMAGES))
        for path in (self.file(sensor, k) for sensor in kinds for k in self.numbers):
            if path.is_file():
                state = path.stat()
                digest.update(f"{path.name} {state.st_size} {state.st_mtime_ns}\n".encode())
        return digest.hexdigest()[:16]

    def _view(self, number: int) -> KittiView:
        calibration, image, size = self.calibration(number), self.file(IMAGES, number), IMAGE_SIZE
        if image.is_file():
            size = _size_of(image)
        return KittiView(KittiCamera.read(calibration), size)

    def _stem(self, number: int) -> str:
        return self.name if self.layout.by_sequence else f"{number:06d}"

    def _require(self, path: Path, values: Sequence[object], what: str) -> None:
        last = self.numbers[-1]
        if len(values) <= last:
            raise FormatError(
                f"{path}: expected {what} for each of the frames 0 to {last} of sequence "
                f"{self.name}, got {len(values)}"
            )


class FoundFrames(NamedTuple):
    """The frames of a folder. notes: what is left out of it, in sentences."""

    frames: tuple[KittiFrames, ...]
    notes: tuple[str, ...]


def find_kitti_frames(folder: Path | str, sensors: Sequence[str] = (SCANS,)) -> FoundFrames:
    """Return the labelled frames of a folder that have files of all sensors.

    folder: holds `velodyne` (or `image_2`, `image_02`), `calib`, and `label_2` of object data or
        `label_02` of tracking data; or its `training` does.
    Missing folders and files raise `FormatError`.
    """
    folder = Path(folder)
    if not folder.is_dir():
        what = "a file" if folder.is_file() else "no such folder"
        raise FormatError(f"{folder}: {what}; expected a folder with {_expected(sensors)}")
    roots = (folder, folder / "training")
    places = [(root, each) for root in roots for each in LAYOUTS if (root / each.labels).is_dir()]
    if not places:
        raise FormatError(
            f"{folder}: expected {_expected(sensors)}, here or in training/; got "
            f"{names_in(folder)}{hint(folder)}"
        )
    root, layout = places[0]
    for name in (*map(layout.folder, sensors), "calib"):
        if not (root / name).is_dir():
            raise FormatError(
                f"{root}: expected {name}/ beside {layout.labels}/, got {names_in(root)}"
            )
    find = _sequences if layout.by_sequence else _parts
    selection = find(root.resolve(), sensors)
    if SCANS not in sensors:
        return selection
    scans = [each.file(SCANS, number) for each in selection.frames for number in each.numbers]
    return selection._replace(notes=(*selection.notes, *loss_notes(scans)))


def _expected(sensors: Sequence[str]) -> str:
    object_files, tracking_files = (
        ", ".join(
            f"{each.folder(s)}/{'SEQ/' * each.by_sequence}NNNNNN.{ENDINGS[s]}" for s in sensors
        )
        for each in LAYOUTS
    )
    return (
        f"{object_files}, calib/NNNNNN.txt and label_2/NNNNNN.txt (object data), or "
        f"{tracking_files}, calib/SEQ.txt and label_02/SEQ.txt (tracking data)"
    )


def hint(folder: Path) -> str:
    """Return where labels are instead, near the folder; empty if nowhere."""
    above = [folder.resolve().parent, folder.resolve().parent.parent]
    below = [path for path in (*visible(folder), *visible(folder, "*/*")) if path.is_dir()]
    names = [layout.labels for layout in LAYOUTS]
    place = next((p for p in (*above, *below) if any((p / name).is_dir() for name in names)), None)
    return "" if place is None else f"; name {place}"


def numbered_files(folder: Path, ending: str) -> dict[int, Path]:
    """Return the files NNNNNN.ENDING of a folder by number, rising; other names are refused."""
    files = visible(folder, f"*.{ending}")
    wrong = next((p for p in files if len(p.stem) != 6 or not p.stem.isdecimal()), None)
    if wrong is not None:
        raise FormatError(f"{wrong}: expected six digits as the name, such as 000000.{ending}")
    return {int(path.stem): path for path in files}


def _parts(root: Path, sensors: Sequence[str]) -> FoundFrames:
    """Return the object data of a folder in parts of `PART` frames."""
    by_sensor = [numbered_files(root / OBJECT.folder(s), ENDINGS[s]) for s in sensors]
    filled, notes = _with_content(by_sensor, "")
    whole = KittiFrames(str(root), "", OBJECT, tuple(filled))
    if not filled:
        raise FormatError(
            f"{root / OBJECT.folder(sensors[0])}: expected files 000000.{ENDINGS[sensors[0]]} "
            "that are not empty, got none"
        )
    for path_of in (whole.calibration, whole.label_file):
        missing = [number for number in filled if not path_of(number).is_file()]
        if missing:
            raise FormatError(
                f"{path_of(missing[0])}: missing; {by_sensor[0][missing[0]]} needs it "
                f"({len(missing)} of {len(filled)} frames have none)"
            )
    labelled = set(numbered_files(root / OBJECT.labels, "txt"))
    if without := {k for k in labelled if any(k not in files for files in by_sensor)}:
        notes.append(f"{len(without)} of {len(labelled)} labelled frames are left out: no file.")
    empty = sum(not whole.label_file(number).stat().st_size for number in filled)
    if empty:
        notes.append(f"{empty} of {len(filled)} files of labels are empty: nothing to be found.")
    parts = [filled[k : k + PART] for k in range(0, len(filled), PART)]
    frames = (
        replace(whole, name=f"{part[0]:06d}-{part[-1]:06d}", numbers=tuple(part)) for part in parts
    )
    return FoundFrames(tuple(frames), tuple(notes))


def _sequences(root: Path, sensors: Sequence[str]) -> FoundFrames:
    """Return the labelled sequences of a folder of tracking data."""
    labelled = [path.stem for path in visible(root / TRACKING.labels, "*.txt")]
    if not labelled:
        raise FormatError(f"{root / TRACKING.labels}: expected SEQ.txt files, got none")
    frames, notes, without = [], [], []
    for name in labelled:
        folders = [root / TRACKING.folder(sensor) / name for sensor in sensors]
        by_sensor = [numbered_files(f, ENDINGS[s]) for f, s in zip(folders, sensors, strict=True)]
        filled, lost = _with_content(by_sensor, f" of sequence {name}")
        if not filled:
            without.append(name)
            continue
        sequence = KittiFrames(str(root), name, TRACKING, tuple(filled))
        if not sequence.calibration(0).is_file():
            raise FormatError(f"{sequence.calibration(0)}: missing; sequence {name} needs it")
        beyond = sorted(set(_frames_of(sequence.label_file(0))) - set(filled) - set(by_sensor[0]))
        if beyond:
            lost.append(f"{len(beyond)} labelled frames of sequence {name} have no scan or image.")
        frames.append(sequence)
        notes += lost
    if not frames:
        folder = root / TRACKING.folder(sensors[0])
        raise FormatError(
            f"{folder}: expected files {labelled[0]}/000000.{ENDINGS[sensors[0]]} of a sequence "
            f"of {TRACKING.labels}, got {names_in(folder)}"
        )
    if without:
        notes.insert(0, f"{len(frames)} of {len(labelled)} labelled sequences have such files.")
    return FoundFrames(tuple(frames), tuple(notes))


def _with_content(
    by_sensor: Sequence[Mapping[int, Path]], where: str
) -> tuple[list[int], list[str]]:
    """Return the numbers of which no sensor's file is missing or empty, and notes on the others."""
    common = sorted(set.intersection(*map(set, by_sensor)))
    filled = [n for n in common if all(files[n].stat().st_size for files in by_sensor)]
    empty = len(common) - len(filled)
    return filled, [f"{empty} frames{where} with an empty file are left out."] * bool(empty)


def _frames_of(path: Path) -> list[int]:
    """Return the frames of a file of labels; its reader reports malformed lines."""
    words = (line.split()[:1] for line in path.read_bytes().splitlines())
    return [int(first[0]) for first in words if first and first[0].isdigit()]


def check_frames(frames: KittiFrames, sensors: Sequence[str]) -> None:
    """Read labels, calibration, poses and stamps, and look at the scans; raise `FormatError`."""
    reads: list[Callable[[], object]] = [
        frames.labels,
        frames.poses,
        frames.views,
        lambda: frames.stamps_s,
    ]
    for read in reads:
        read()
    if IMAGES in sensors:
        for number in frames.numbers:
            _size_of(frames.file(IMAGES, number))
    if SCANS in sensors:
        check_scan_files([frames.file(SCANS, number) for number in frames.numbers])


def read_scans(files: Sequence[Path], stamps_s: Sequence[float]) -> Iterator[LidarScan]:
    """Yield scans in KITTI's layout, without points of rays that had no return."""
    layout = layout_of([files[0]], SCAN_COLUMNS)
    for path, stamp_s in zip(files, stamps_s, strict=True):
        yield layout.read(path, stamp_s).scan


def loss_notes(files: Sequence[Path]) -> tuple[str, ...]:
    """Return which points of some scans, from the first to the last, have no use, in sentences.

    Damaged files are of no concern here: `check_scan_files` refuses them.
    """
    some = files[:: max(1, len(files) // SAMPLES)][:SAMPLES]
    lost = Counter[str]()
    with suppress(FormatError):
        layout = layout_of([files[0]], SCAN_COLUMNS)
        for path in some:
            lost += layout.read(path, 0.0).left_out
    scans = "the scan" if len(some) == 1 else f"{len(some)} scans"
    return tuple(
        f"Of {scans} looked at, {n} points are left out: {why}." for why, n in lost.items()
    )


def check_scan_files(files: Sequence[Path]) -> None:
    """Raise `FormatError` for a size that does not fit, or a first scan of another layout."""
    for path in files:
        size = path.stat().st_size
        if size % POINT_BYTES:
            raise FormatError(
                f"{path}: expected {POINTS}, {POINT_BYTES} bytes each, got {size} bytes"
            )
    columns = layout_of([files[0]], ()).columns
    if len(columns) != len(SCAN_COLUMNS):
        raise FormatError(f"{files[0]}: expected {POINTS}, got {len(columns)} numbers a point")


def _size_of(path: Path) -> ImageSize:
    """Return the size of an image from the head of its file."""
    from PIL import Image

    try:
        with Image.open(path) as opened:
            return ImageSize(*opened.size)
    except OSError as error:
        raise FormatError(f"{path}: expected a PNG image, got another file") from error
