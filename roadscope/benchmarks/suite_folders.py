"""The suite of a folder of KITTI's data: its sequences in place of scenarios and seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from roadscope.benchmarks.boards import RECORDED_BOARDS, Board
from roadscope.benchmarks.formats.kitti_scans import hint
from roadscope.benchmarks.formats.kitti_sequence import KittiFolder
from roadscope.benchmarks.formats.table import FormatError
from roadscope.benchmarks.recorded.kitti_drive import LIDAR_HEIGHT_M
from roadscope.benchmarks.recorded.recording import SequenceSettings
from roadscope.benchmarks.recorded.suite import KITTI, TRACKING, DataFolder, suite_of
from roadscope.benchmarks.suite import Suite


def kitti_suite(
    folder: Path | str,
    boards: Sequence[str] | None = None,
    *,
    lidar_height_m: float = LIDAR_HEIGHT_M,
    notice: Callable[[str], None] | None = None,
) -> Suite:
    """Return the suite of a folder; a missing folder or a wrong layout raises `FormatError`.

    boards: `tracking` and the like; None: those that the folder has complete data for.
    lidar_height_m: height of the LiDAR above the road.
    notice: called with a text for each board that is left out as its data are not complete.
    """
    place = DataFolder(Path(folder), lidar_height_m)
    if boards is None:
        return suite_of(KITTI, _complete_boards(place, notice))
    known = _kitti_boards()
    settings: dict[str, SequenceSettings] = {}
    for name in boards:
        if name in known:
            settings |= known[name].kitti_settings(place)
    return suite_of(KITTI, settings)


def _kitti_boards() -> dict[str, Board]:
    """Return boards of KITTI's data by the name of the simulated board for the same plug-ins.

    Where each class of objects has a board, one stands for all: it returns the settings of all.
    """
    boards = [board for board in RECORDED_BOARDS.values() if board.kitti_markers]
    return {board.simulated_board: board for board in boards}


def _complete_boards(
    place: DataFolder, notice: Callable[[str], None] | None
) -> dict[str, SequenceSettings]:
    """Return the settings of all boards that a folder has complete data for."""
    known = _kitti_boards()
    names = [name for name, board in known.items() if all(map(place.has, board.kitti_markers))]
    if not names:
        _check_has_labels(place.folder)
        # With labels alone, the board of trackers says what is missing.
        names = [TRACKING]
    settings: dict[str, SequenceSettings] = {}
    errors: dict[str, FormatError] = {}
    for name in names:
        try:
            settings |= known[name].kitti_settings(place)
        except FormatError as error:
            errors[name] = error
    if not settings:
        raise next(iter(errors.values()))
    for name, reason in errors.items():
        if notice is not None:
            notice(f"the board {name} is left out: {reason}")
    return settings


def _check_has_labels(folder: Path) -> None:
    """Raise `FormatError`, with what boards need, for a folder without labels of sequences."""
    try:
        KittiFolder.find(folder)
    except FormatError as error:
        where = hint(folder) if folder.is_dir() else ""
        raise FormatError(
            f"{error}; detectors need velodyne or image_2 beside label_2 (or label_02), odometries "
            f"sequences and poses{where}"
        ) from None
