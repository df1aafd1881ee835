"""What suites of recorded data are made of: the sequences of a folder and the entries of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from msgspec import Struct

from roadscope.benchmarks.formats.kitti_labels import DETECTED_TYPES, TYPE_NAMES, read_kitti_labels
from roadscope.benchmarks.formats.kitti_odometry import find_kitti_odometry
from roadscope.benchmarks.formats.kitti_scans import SCANS, find_kitti_frames
from roadscope.benchmarks.formats.kitti_sequence import (
    DETECTOR_PREFIX,
    KittiFolder,
    other_classes_remark,
)
from roadscope.benchmarks.formats.table import FormatError, visible
from roadscope.benchmarks.metrics.trajectory_errors import KITTI_M
from roadscope.benchmarks.recorded.kitti_drive import KittiDrive, KittiOdometryDrive
from roadscope.benchmarks.recorded.recording import RecordedSettings, Recording, SequenceSettings
from roadscope.benchmarks.suite import Names, Suite, SuiteError
from roadscope.core import Category
from roadscope.core.config import ConfigError, read_config

KITTI = "kitti"
TRACKING = "tracking"
"""The table of trackers in the file of a suite."""


class KittiSettings(SequenceSettings, frozen=True, kw_only=True):
    """The settings of a board that runs plug-ins on KITTI's scans and images.

    drives: the sequences, or the parts of the object data.
    remark: what a reader must know about frames and coordinates.
    lidar, camera: detectors whose detections fusions get.
    """

    drives: tuple[KittiDrive, ...] = ()
    lidar: Names = ()
    camera: Names = ()

    @property
    def seeds(self) -> Sequence[int]:
        """The numbers of its drives."""
        return [drive.seed for drive in self.drives]


class KittiOdometrySettings(SequenceSettings, frozen=True, kw_only=True):
    """The settings of the board of odometries.

    drives: the sequences. remark: what a reader must know about them.
    """

    drives: tuple[KittiOdometryDrive, ...] = ()

    @property
    def seeds(self) -> Sequence[int]:
        """The numbers of its drives."""
        return [drive.seed for drive in self.drives]


class DataFolder(NamedTuple):
    """A folder of KITTI's data. lidar_height_m: height of the LiDAR above the road."""

    folder: Path
    lidar_height_m: float

    def has(self, patterns: Sequence[str]) -> bool:
        """Return whether anything that fits a pattern is in it, in `training` or in `dataset`."""
        places = (self.folder, self.folder / "training", self.folder / "dataset")
        return any(visible(place, pattern) for place in places for pattern in patterns)


def kitti_tracking_settings(place: DataFolder) -> dict[str, SequenceSettings]:
    """Return the settings of the boards of trackers by their names."""
    files = KittiFolder.find(place.folder)
    detectors = files.detectors()
    if not detectors:
        files.choose_detector(None)  # It says which folders are expected.
    categories = _labelled_categories(files)
    recordings = tuple(
        Recording(str(files.root.resolve()), sequence, category.name.lower(), detector, number)
        for detector in detectors
        for category in categories
        for number, sequence in enumerate(files.sequences())
        if files.has_detections(sequence, category, detector)
    )
    if not recordings:
        # A malformed file may be the reason; its reader says so.
        for sequence in files.sequences():
            read_kitti_labels(files.labels(sequence))
        kinds = [TYPE_NAMES[DETECTED_TYPES[each]] for each in categories or DETECTED_TYPES]
        if not categories:
            raise FormatError(
                f"{files.root / 'label_02'}: expected labels of {', '.join(kinds)}, got none"
            )
        expected = " or ".join(f"{DETECTOR_PREFIX}NAME/{kind}/SEQ.txt" for kind in kinds)
        known = ", ".join(files.sequences()[:8])
        raise FormatError(
            f"{files.root}: expected {expected}, of a class that label_02 has, for a sequence of "
            f"it ({known}), got {_detection_files(files)}"
        )
    for sequence in dict.fromkeys(recording.sequence for recording in recordings):
        # Both raise `FormatError` for a missing file.
        files.calibration(sequence)
        files.poses(sequence)
    remarks = _remarks(files, recordings)
    return tracking_settings(KITTI, recordings, labelled=len(files.sequences()), remarks=remarks)


def kitti_object_settings(
    place: DataFolder, board: str, sensors: Sequence[str]
) -> dict[str, SequenceSettings]:
    """Return the settings by the name of the board, one for each class that has labels.

    board: the name of the board of simulated traffic that ranks the same plug-ins.
    sensors: whose data plug-ins get.
    """
    data = find_kitti_frames(place.folder, sensors)
    drives = tuple(
        KittiDrive(
            seed=number,
            files=frames,
            sensors=tuple(sensors),
            digest=frames.digest(sensors),
            lidar_height_m=place.lidar_height_m,
        )
        for number, frames in enumerate(data.frames)
    )
    labelled = {name for frames in data.frames for name in frames.type_names()}
    names = [TYPE_NAMES[kind] for kind in DETECTED_TYPES.values()]
    if not any(name.lower() in labelled for name in names):
        # A malformed file may be the reason; its reader says so.
        for drive in drives:
            drive.check()
        files = drives[0].files
        folder = files.label_file(files.numbers[0]).parent
        raise FormatError(f"{folder}: expected labels of {', '.join(names)}, got none")
    table = recorded_table(KITTI).of_board(board)
    settings = KittiSettings(
        entries=table.entries,
        lidar=table.lidar,
        camera=table.camera,
        drives=drives,
        remark=" ".join([_frames_in_words(drives, place, sensors), *data.notes]),
    )
    boards = [name.lower() for name in names if name.lower() in labelled]
    return {f"{KITTI} {board} {name}": settings for name in boards}


def _frames_in_words(
    drives: Sequence[KittiDrive], place: DataFolder, sensors: Sequence[str]
) -> str:
    """Return how many frames there are, and in which frame of coordinates scans are."""
    frames = sum(len(drive.files.numbers) for drive in drives)
    by_sequence = drives[0].files.layout.by_sequence
    text = (
        f"{frames} frames of {len(drives)} sequences of KITTI's tracking data."
        if by_sequence
        else f"{frames} frames of KITTI's object data, each taken alone."
    )
    if SCANS not in sensors:
        return text
    return (
        f"{text} Detectors get scans as measured, with the LiDAR {place.lidar_height_m:g} m above "
        "the origin of the vehicle's frame, on a level road; calib brings boxes into the camera's."
    )


def kitti_odometry_settings(place: DataFolder, board: str) -> dict[str, SequenceSettings]:
    """Return the settings of the board of odometries by its name.

    board: the name of the board of odometries on simulated traffic.
    """
    data = find_kitti_odometry(place.folder)
    drives = [
        KittiOdometryDrive(seed=number, sequence=each, digest=each.digest())
        for number, each in enumerate(data.sequences)
    ]
    for drive in drives:
        drive.check()
    settings = KittiOdometrySettings(
        entries=recorded_table(KITTI).of_board(board).entries,
        drives=tuple(drives),
        remark=" ".join([_stretches_in_words(drives), *data.notes]),
    )
    return {f"{KITTI} {board}": settings}


def _stretches_in_words(drives: Sequence[KittiOdometryDrive]) -> str:
    """Return over which stretches drift is measured, and which sequences lack some."""
    text = (
        f"t_rel and r_rel are over stretches of {KITTI_M[0]:g} to {KITTI_M[-1]:g} m from every "
        "tenth frame, as KITTI has them."
    )
    lengths_m = {drive.sequence.name: drive.sequence.length_m() for drive in drives}
    for name, length_m in lengths_m.items():
        fitting = [each for each in KITTI_M if each < length_m]
        if not fitting:
            text += f" Sequence {name} is {length_m:.0f} m long, too short for any of these."
        elif len(fitting) < len(KITTI_M):
            text += f" Sequence {name} is {length_m:.0f} m long: up to {fitting[-1]:g} m."
    return text


def tracking_settings(
    name: str, recordings: Sequence[Recording], *, labelled: int, remarks: Sequence[str] = ()
) -> dict[str, SequenceSettings]:
    """Return the settings of the boards of recordings by the names of these boards.

    name: of the suite, whose file `NAME.toml` lists the trackers that are compared.
    labelled: number of sequences that have labels.
    remarks: what a reader must know about the detections; it comes before the remark of the file.
    """
    table = recorded_table(name)
    settings = RecordedSettings(
        entries=table.of_board(TRACKING).entries,
        recordings=tuple(recordings),
        labelled=labelled,
        remark=" ".join([*remarks, table.remark]),
    )
    return dict.fromkeys((r.board for r in recordings), settings)


def suite_of(name: str, boards: Mapping[str, SequenceSettings]) -> Suite:
    """Return the suite of recorded data with these settings of its boards."""
    table = recorded_table(name)
    seeds = dict.fromkeys(seed for settings in boards.values() for seed in settings.seeds)
    return Suite(
        name=table.name,
        version=table.version,
        summary=table.summary,
        scenarios=(name,),
        seeds=tuple(seeds),
        rig=name,
        weathers=(Recording.weather,),
        boards=boards,
        recorded=True,
    )


class BoardTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The table of a board. lidar, camera: detectors whose detections fusions get."""

    entries: Names
    lidar: Names = ()
    camera: Names = ()


class RecordedTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The file of a suite of recorded data, which is the same for every folder.

    boards: tables by the name of the board of simulated traffic with the same plug-ins.
    """

    name: str
    version: int
    summary: str
    remark: str
    boards: Mapping[str, BoardTable]

    def of_board(self, board: str) -> BoardTable:
        """Return the table of a board, which the file may lack: then it has no entries."""
        return self.boards.get(board, BoardTable(()))


def recorded_table(name: str) -> RecordedTable:
    """Read the file of a suite of recorded data: `kitti` or `mot`; errors name all problems."""
    file = resources.files("roadscope.benchmarks").joinpath(f"suites/{name}.toml")
    try:
        return read_config(file.read_text(encoding="utf-8"), RecordedTable)
    except ConfigError as error:
        raise SuiteError(f"{file}: {error}", error.problems) from error


def _detection_files(files: KittiFolder) -> str:
    """Return the first files in folders of detections, wherever they are; `none` without any."""
    paths = [p for p in visible(files.root, f"{DETECTOR_PREFIX}*/**/*") if p.is_file()]
    return ", ".join(str(p.relative_to(files.root)) for p in paths[:3]) or "none"


def _remarks(files: KittiFolder, recordings: Sequence[Recording]) -> list[str]:
    """Return a sentence for each detector and class some of whose detections are left out."""
    pairs = dict.fromkeys((r.detector, Category[r.category.upper()]) for r in recordings)
    texts = [other_classes_remark(files, category, detector) for detector, category in pairs]
    return [text for text in texts if text]


def _labelled_categories(files: KittiFolder) -> list[Category]:
    """Return the classes that have labels; malformed lines are left to the reader of their file."""
    paths = [files.labels(sequence) for sequence in files.sequences()]
    lines = (line.split() for path in paths for line in path.read_bytes().splitlines())
    names = {fields[2].lower() for fields in lines if len(fields) > 2}
    return [
        category
        for category, kind in DETECTED_TYPES.items()
        if TYPE_NAMES[kind].lower().encode() in names
    ]
