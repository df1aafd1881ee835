"""Names of the files of boards in a folder: `leaderboard.*` is the latest, others have labels.

A folder may have results of several suites and boards: ranks on recorded data, for example, are
compared with those on simulated traffic in the same folder.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from roadscope.benchmarks.cache import FolderError

NAME = "leaderboard"
ENDINGS = ("json", "csv", "md", "tex")
PICTURE = "boards.svg"
"""The picture of headline metrics and times."""
CURVES = "drift.svg"
"""The picture of figures over the distance driven, if a board has some."""
REPLAY = "replay.json"
"""The worst moments of the entries."""


def file_names(label: str = "") -> dict[str, str]:
    """Return the name of each file of a board with this label, by its name without a label."""
    tail = f"-{label}" if label else ""
    names = [*(f"{NAME}.{ending}" for ending in ENDINGS), PICTURE, CURVES, REPLAY]
    return {name: f"{Path(name).stem}{tail}{Path(name).suffix}" for name in names}


def label_of(manifest: Mapping[str, Any]) -> str:
    """Return the label of a run for names of files: its suite, boards and calibration."""
    believed = Path(str(manifest.get("calibration", ""))).stem
    words = [str(manifest.get("suite", "")), *map(str, manifest.get("boards", ())), believed]
    return "-".join(re.sub(r"[^\w.]+", "-", word) for word in words if word)


def set_aside(folder: Path, label: str) -> None:
    """Rename the files of the latest board if its label is another one.

    label: of the board to be written; older files with this label are removed. A latest board that
    cannot be read will be overwritten.
    """
    before = _label_in(folder)
    if before and before != label:
        for name, labelled in file_names(before).items():
            (folder / labelled).unlink(missing_ok=True)
            if (folder / name).is_file():
                (folder / name).replace(folder / labelled)
    for labelled in file_names(label).values() if label else ():
        (folder / labelled).unlink(missing_ok=True)


def check_targets(folder: Path, label: str = "") -> None:
    """Raise `FolderError` if a folder has the name of a file that will be written.

    label: of the board to be written.
    """
    labels = {"", label, _label_in(folder)}
    names = [name for each in labels for name in file_names(each).values()]
    for name in dict.fromkeys(sorted(names)):
        if (folder / name).is_dir():
            raise FolderError(f"cannot write {folder / name}: it is a folder")


def earlier_boards(folder: Path) -> list[Path]:
    """Return the JSON files of boards with a label, which are not the latest."""
    return sorted(folder.glob(f"{NAME}-*.json"))


def _label_in(folder: Path) -> str:
    """Return the label of the latest board; empty if there is none or it cannot be read."""
    try:
        manifest = json.loads((folder / f"{NAME}.json").read_text("utf-8"))["manifest"]
        return label_of(manifest)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return ""
