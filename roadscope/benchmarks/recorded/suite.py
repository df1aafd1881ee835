"""The suite `kitti`: the sequences of a folder in place of scenarios and seeds."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from msgspec import Struct

from roadscope.benchmarks.formats.kitti_labels import (
    DETECTED_TYPES,
    TYPE_NAMES,
    read_kitti_labels,
)
from roadscope.benchmarks.formats.kitti_sequence import (
    DETECTOR_PREFIX,
    KittiFolder,
    other_classes_remark,
)
from roadscope.benchmarks.formats.table import FormatError, visible
from roadscope.benchmarks.recorded.recording import RecordedSettings, Recording
from roadscope.benchmarks.suite import Suite
from roadscope.core import Category
from roadscope.core.config import read_config

KITTI = "kitti"


def kitti_suite(folder: Path | str) -> Suite:
    """Return the suite of a folder; a missing folder or a wrong layout raises `FormatError`."""
    files = KittiFolder.find(folder)
    files.choose_detector(files.detectors()[0] if files.detectors() else None)
    categories = _labelled_categories(files)
    recordings = tuple(
        Recording(str(files.root.resolve()), sequence, category.name.lower(), detector, number)
        for detector in files.detectors()
        for category in categories
        for number, sequence in enumerate(files.sequences())
        if files.has_detections(sequence, category, detector)
    )
    if not categories:
        # A malformed file may be the reason; its reader says so.
        for sequence in files.sequences():
            read_kitti_labels(files.labels(sequence))
        known = ", ".join(TYPE_NAMES[kind] for kind in DETECTED_TYPES.values())
        raise FormatError(f"{files.root / 'label_02'}: expected labels of {known}, got none")
    if not recordings:
        known = ", ".join(files.sequences()[:8])
        raise FormatError(
            f"{files.root}: expected {DETECTOR_PREFIX}NAME/Car/SEQ.txt for a sequence of label_02 "
            f"({known}), got {_detection_files(files)}"
        )
    remarks = _remarks(files, recordings)
    return recorded_suite(KITTI, recordings, labelled=len(files.sequences()), remarks=remarks)


def recorded_suite(
    name: str, recordings: Sequence[Recording], *, labelled: int, remarks: Sequence[str] = ()
) -> Suite:
    """Return the suite of recordings; its file `NAME.toml` lists the trackers that are compared.

    labelled: number of sequences that have labels.
    remarks: what a reader must know about the detections; it comes before the remark of the file.
    """
    table = recorded_table(name)
    settings = RecordedSettings(
        entries=table.tracking.entries,
        recordings=tuple(recordings),
        labelled=labelled,
        remark=" ".join([*remarks, table.remark]),
    )
    return Suite(
        name=table.name,
        version=table.version,
        summary=table.summary,
        scenarios=(name,),
        seeds=tuple(dict.fromkeys(r.seed for r in recordings)),
        rig=name,
        weathers=(Recording.weather,),
        boards=dict.fromkeys((r.board for r in recordings), settings),
        recorded=True,
    )


class RecordedEntries(Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[tracking]`."""

    entries: tuple[str, ...]


class RecordedTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The file of a suite of recorded data, which is the same for every folder."""

    name: str
    version: int
    summary: str
    remark: str
    tracking: RecordedEntries


def recorded_table(name: str) -> RecordedTable:
    """Read the file of a suite of recorded data: `kitti` or `mot`."""
    content = resources.files("roadscope.benchmarks").joinpath(f"suites/{name}.toml")
    return read_config(content.read_text(encoding="utf-8"), RecordedTable)


def _detection_files(files: KittiFolder) -> str:
    """Return the first files in folders of detections, wherever they are; `none` without any."""
    paths = [p for p in visible(files.root, f"{DETECTOR_PREFIX}*/**/*") if p.is_file()]
    return ", ".join(str(p.relative_to(files.root)) for p in paths[:3]) or "none"


def _remarks(files: KittiFolder, recordings: Sequence[Recording]) -> list[str]:
    """Return a sentence for each detector and class of which rows are left out."""
    pairs = dict.fromkeys((r.detector, Category[r.category.upper()]) for r in recordings)
    texts = [other_classes_remark(files, category, detector) for detector, category in pairs]
    return [text for text in texts if text]


def _labelled_categories(files: KittiFolder) -> list[Category]:
    """Return the classes that have labels; malformed lines are left to the reader of their file."""
    paths = [files.labels(sequence) for sequence in files.sequences()]
    lines = (line.split() for path in paths for line in path.read_bytes().splitlines())
    names = {fields[2].lower() for fields in lines if len(fields) > 2}
    return [c for c, kind in DETECTED_TYPES.items() if TYPE_NAMES[kind].lower().encode() in names]
