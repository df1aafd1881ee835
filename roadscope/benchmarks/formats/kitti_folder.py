"""Where the files of KITTI tracking data lie."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from roadscope.benchmarks.formats.kitti_objects import DETECTION_COLUMNS, TYPE_NAMES, TYPE_OF
from roadscope.benchmarks.formats.table import FormatError
from roadscope.core import Category
from roadscope.core.names import unknown

DETECTIONS = "det_"
SCORE_COLUMN = DETECTION_COLUMNS.index("score")
POSE_FOLDERS = ("ego_pose", "poses", "oxts")


@dataclass(frozen=True, slots=True)
class KittiFolder:
    """Where files lie; nothing is read yet.

    root: the folder that holds `label_02` and `calib`.
    """

    root: Path

    @staticmethod
    def find(folder: Path | str) -> KittiFolder:
        """Take a folder, or its `training`, that has labels; others are refused by name."""
        given = Path(folder)
        if not given.is_dir():
            raise FormatError(f"{given}: no such folder; expected one with label_02/SEQ.txt")
        for root in (given, given / "training"):
            if (root / "label_02").is_dir():
                found = KittiFolder(root)
                if not found.sequences():
                    raise FormatError(f"{root / 'label_02'}: expected SEQ.txt files, got none")
                return found
        seen = ", ".join(sorted(p.name for p in given.iterdir())[:8]) or "nothing"
        raise FormatError(
            f"{given}: expected label_02/SEQ.txt, calib/SEQ.txt, {DETECTIONS}NAME/Car/SEQ.txt and "
            f"ego_pose/SEQ.txt (or oxts/SEQ.txt), here or in training/; got {seen}"
        )

    def sequences(self) -> list[str]:
        """Return the names of all sequences that have labels."""
        return sorted(path.stem for path in (self.root / "label_02").glob("*.txt"))

    def detectors(self) -> list[str]:
        """Return the detectors whose detections are here."""
        folders = sorted(p for p in self.root.glob(f"{DETECTIONS}*") if p.is_dir())
        return [p.name.removeprefix(DETECTIONS) for p in folders]

    def found(self) -> str:
        """Name the first files of detections, wherever they lie; `none` where there are none."""
        paths = sorted(p for p in self.root.glob(f"{DETECTIONS}*/**/*") if p.is_file())
        return ", ".join(str(p.relative_to(self.root)) for p in paths[:3]) or "none"

    def labels(self, sequence: str) -> Path:
        """Return the labels of a sequence."""
        return self._needed("label_02", sequence)

    def calibration(self, sequence: str) -> Path:
        """Return the calibration of a sequence."""
        return self._needed("calib", sequence)

    def detections(self, sequence: str, category: Category, detector: str) -> Path:
        """Return the detections of one class in a sequence."""
        return self._needed(_class_folder(category, detector), sequence)

    def has_detections(self, sequence: str, category: Category, detector: str) -> bool:
        """Say whether the file of detections is there."""
        return self._path(_class_folder(category, detector), sequence).is_file()

    def poses(self, sequence: str) -> Path:
        """Return the poses of a sequence: from SLAM, from odometry, or the inertial unit's."""
        for name in POSE_FOLDERS:
            path = self.root / name / f"{sequence}.txt"
            if path.is_file():
                return path
        places = ", ".join(f"{name}/{sequence}.txt" for name in POSE_FOLDERS)
        raise FormatError(f"{self.root}: no poses of sequence {sequence}; expected one of {places}")

    def the_detector(self, name: str | None) -> str:
        """Return the detector named, or the only one."""
        known = self.detectors()
        if not known:
            raise FormatError(f"{self.root}: expected {DETECTIONS}NAME/Car/SEQ.txt, got no "
                              f"{DETECTIONS}NAME")  # fmt: skip
        if name is None and len(known) > 1:
            raise FormatError(f"{self.root}: several detectors, name one: {', '.join(known)}")
        if name is not None and name not in known:
            raise FormatError(f"{self.root}: {unknown('detector', name, known)}")
        return name or known[0]

    def scores_are_shares(self, detector: str) -> bool:
        """Say whether all scores in a detector's files, of all sequences and classes, are 0 to 1.

        One file may happen to have only such scores, so it is no matter of single files. Lines that
        cannot be read are passed over here; who reads their file is told.
        """
        for path in sorted(self.root.glob(f"{DETECTIONS}{detector}/*/*.txt")):
            for line in path.read_bytes().splitlines():
                try:
                    if not 0 <= float(line.split(b",")[SCORE_COLUMN]) <= 1:
                        return False
                except (ValueError, IndexError):
                    continue
        return True

    def _needed(self, folder: str, sequence: str) -> Path:
        path = self._path(folder, sequence)
        if not path.is_file():
            raise FormatError(f"{path}: missing; sequence {sequence} needs it")
        return path

    def _path(self, folder: str, sequence: str) -> Path:
        return self.root / folder / f"{sequence}.txt"


def _class_folder(category: Category, detector: str) -> str:
    return f"{DETECTIONS}{detector}/{TYPE_NAMES[TYPE_OF[category]]}"
