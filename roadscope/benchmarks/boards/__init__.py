"""The boards, one file each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from roadscope.benchmarks.boards.board import Board
from roadscope.benchmarks.boards.camera import CameraBoard
from roadscope.benchmarks.boards.detection import DetectionBoard
from roadscope.benchmarks.boards.fusion import FusionBoard
from roadscope.benchmarks.boards.odometry import OdometryBoard
from roadscope.benchmarks.boards.recorded import KITTI_BOARDS, MOT_BOARDS
from roadscope.benchmarks.boards.tracking import TrackingBoard
from roadscope.benchmarks.recorded.suite import RecordedSuite
from roadscope.benchmarks.suite import Suite
from roadscope.core import SpecError
from roadscope.core.names import unknown

BOARDS: Mapping[str, Board] = {
    board.name: board
    for board in (
        DetectionBoard(),
        TrackingBoard(),
        CameraBoard(),
        FusionBoard(),
        OdometryBoard(),
    )
}
"""Boards of simulated traffic, by name."""
_EVERY: Mapping[str, Board] = {
    board.name: board for board in (*BOARDS.values(), *KITTI_BOARDS, *MOT_BOARDS)
}

__all__ = ["BOARDS", "Board", "board_named", "boards_of", "chosen_boards"]


def board_named(name: str) -> Board:
    """Return a board, also of recorded data; `SpecError` says which there are."""
    if name not in _EVERY:
        raise SpecError(unknown("board", name, _EVERY))
    return _EVERY[name]


def boards_of(suite: Suite) -> list[Board]:
    """Return the boards that a suite has entries for."""
    if isinstance(suite, RecordedSuite):
        names = dict.fromkeys(recording.board for recording in suite.recordings)
        return [board_named(name) for name in names]
    return [board for board in BOARDS.values() if board.suite_entries(suite)] or [
        BOARDS["detection"],
        BOARDS["tracking"],
    ]


def chosen_boards(suite: Suite, names: Sequence[str] | None) -> list[Board]:
    """Return the boards that are asked for; None: those that the suite has entries for.

    On recorded data `tracking` stands for the boards of all classes.
    """
    if names is None:
        return boards_of(suite)
    for name in names:
        if name not in BOARDS:
            raise SpecError(unknown("board", name, BOARDS))
    if isinstance(suite, RecordedSuite):
        if list(names) != ["tracking"]:
            raise SpecError(f"suite {suite.title} has recorded detections: it is for trackers only")
        return boards_of(suite)
    return [BOARDS[name] for name in names]
