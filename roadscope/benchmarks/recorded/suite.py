"""The suite `kitti`: sequences of a folder in place of scenarios and seeds."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from msgspec import Struct

from roadscope.benchmarks.formats.kitti_classes import said_of_others
from roadscope.benchmarks.formats.kitti_folder import DETECTIONS, KittiFolder
from roadscope.benchmarks.formats.kitti_objects import TYPE_NAMES, TYPE_OF, read_labels
from roadscope.benchmarks.formats.table import FormatError
from roadscope.benchmarks.recorded.recording import RecordedSettings, Recording
from roadscope.benchmarks.suite import Suite
from roadscope.core import Category
from roadscope.core.config import read_config

KITTI = "kitti"


def kitti_suite(folder: Path | str) -> Suite:
    """Return the suite of a folder; a missing folder or a wrong layout raises `FormatError`."""
    files = KittiFolder.find(folder)
    files.the_detector(files.detectors()[0] if files.detectors() else None)
    labelled = _labelled(files)
    recordings = tuple(
        Recording(str(files.root.resolve()), sequence, category.name.lower(), detector, number)
        for detector in files.detectors()
        for category in labelled
        for number, sequence in enumerate(files.sequences())
        if files.has_detections(sequence, category, detector)
    )
    if not labelled:
        for sequence in files.sequences():
            read_labels(files.labels(sequence))
        known = ", ".join(TYPE_NAMES[kind] for kind in TYPE_OF.values())
        raise FormatError(f"{files.root / 'label_02'}: expected labels of {known}, got none")
    if not recordings:
        known = ", ".join(files.sequences()[:8])
        raise FormatError(
            f"{files.root}: expected {DETECTIONS}NAME/Car/SEQ.txt for a sequence of label_02 "
            f"({known}), got {files.found()}"
        )
    return recorded_suite(KITTI, recordings, len(files.sequences()), _left_out(files, recordings))


def recorded_suite(
    name: str, recordings: Sequence[Recording], labelled: int, remarks: Sequence[str] = ()
) -> Suite:
    """Return the suite of recordings; its file `NAME.toml` says which trackers are compared.

    labelled: number of sequences that have labels.
    remarks: what a reader must know of the detections, before what the file says.
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
    """What a suite says of itself, whatever the folder."""

    name: str
    version: int
    summary: str
    remark: str
    tracking: RecordedEntries


def recorded_table(name: str) -> RecordedTable:
    """Read the file of a suite of recorded traffic: `kitti` or `mot`."""
    content = resources.files("roadscope.benchmarks").joinpath(f"suites/{name}.toml")
    return read_config(content.read_text(encoding="utf-8"), RecordedTable)


def _left_out(files: KittiFolder, recordings: Sequence[Recording]) -> list[str]:
    """Say of each detector and class which rows are left out, if any."""
    pairs = dict.fromkeys((r.detector, Category[r.category.upper()]) for r in recordings)
    texts = [said_of_others(files, category, detector) for detector, category in pairs]
    return [text for text in texts if text]


def _labelled(files: KittiFolder) -> list[Category]:
    """Return the classes that any label is of; who reads a file is told of its malformed lines."""
    paths = [files.labels(sequence) for sequence in files.sequences()]
    lines = (line.split() for path in paths for line in path.read_bytes().splitlines())
    names = {fields[2].lower() for fields in lines if len(fields) > 2}
    return [c for c, kind in TYPE_OF.items() if TYPE_NAMES[kind].lower().encode() in names]
