"""Boards that share a folder: `leaderboard.*` is the latest, others are kept under their own names.

A folder of results may serve several suites and boards; ranks on recorded data, say, are compared
with those on simulated traffic that were worked out in the same folder.
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
CURVES = "drift.svg"
"""The odometry board as a picture; beside the others where there is one."""


def file_names(label: str = "") -> dict[str, str]:
    """Return the names of a board's files by those of the latest; label: whose, if kept."""
    tail = f"-{label}" if label else ""
    names = [*(f"{NAME}.{ending}" for ending in ENDINGS), CURVES]
    return {name: f"{Path(name).stem}{tail}{Path(name).suffix}" for name in names}


def label_of(manifest: Mapping[str, Any]) -> str:
    """Name what a run was of, its suite, boards and calibration, as part of a file's name."""
    believed = Path(str(manifest.get("calibration", ""))).stem
    words = [str(manifest.get("suite", "")), *map(str, manifest.get("boards", ())), believed]
    return "-".join(re.sub(r"[^\w.]+", "-", word) for word in words if word)


def set_aside(folder: Path, label: str) -> None:
    """Rename the files of the latest board if it was of another suite, or of other boards.

    label: of the board to be written; what was kept of it before is removed, being older.
    A latest board that cannot be read will be overwritten.
    """
    before = _label_in(folder)
    if before and before != label:
        for name, kept in file_names(before).items():
            (folder / kept).unlink(missing_ok=True)
            if (folder / name).is_file():
                (folder / name).replace(folder / kept)
    for kept in file_names(label).values() if label else ():
        (folder / kept).unlink(missing_ok=True)


def check_targets(folder: Path, label: str = "") -> None:
    """Refuse a folder where a folder has the name of a file to be written, before anything runs.

    label: of the board to be written.
    """
    names = [name for of in {"", label, _label_in(folder)} for name in file_names(of).values()]
    for name in dict.fromkeys(sorted(names)):
        if (folder / name).is_dir():
            raise FolderError(f"cannot write {folder / name}: it is a folder")


def kept_boards(folder: Path) -> list[Path]:
    """Return the JSON files of boards kept beside the latest."""
    return sorted(folder.glob(f"{NAME}-*.json"))


def _label_in(folder: Path) -> str:
    """Return what the latest board is of; empty where none can be read."""
    try:
        manifest = json.loads((folder / f"{NAME}.json").read_text("utf-8"))["manifest"]
        return label_of(manifest)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return ""
