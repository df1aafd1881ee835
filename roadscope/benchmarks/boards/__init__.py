"""The leaderboards, one file each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from roadscope._lazy import lazy_names
from roadscope.benchmarks.boards.board import (
    CONDITIONS,
    Board,
    Breakdown,
    Column,
    JobOptions,
    Scores,
    call_cost,
    episodes,
    time_columns,
)
from roadscope.benchmarks.boards.camera import CameraBoard
from roadscope.benchmarks.boards.detection import DetectionBoard
from roadscope.benchmarks.boards.driving import DrivingBoard
from roadscope.benchmarks.boards.fusion import FusionBoard
from roadscope.benchmarks.boards.kitti_objects import KITTI_OBJECT_BOARDS
from roadscope.benchmarks.boards.kitti_odometry import KITTI_ODOMETRY_BOARD
from roadscope.benchmarks.boards.odometry import OdometryBoard
from roadscope.benchmarks.boards.recorded import KITTI_BOARDS, MOT_BOARDS
from roadscope.benchmarks.boards.tracking import TrackingBoard
from roadscope.benchmarks.kinds import KINDS, Kind
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
        DrivingBoard(),
    )
}
"""Boards of simulated traffic, by name: a new board needs a file and its line here."""
RECORDED_BOARDS: Mapping[str, Board] = {
    board.name: board
    for board in (*KITTI_BOARDS, *KITTI_OBJECT_BOARDS, KITTI_ODOMETRY_BOARD, *MOT_BOARDS)
}
"""Boards of recorded data, by name."""

__all__ = [
    "BOARDS",
    "CONDITIONS",
    "RECORDED_BOARDS",
    "Board",
    "Breakdown",
    "Column",
    "JobOptions",
    "Scores",
    "board_named",
    "boards_of",
    "call_cost",
    "chosen_boards",
    "episodes",
    "plugin_kinds",
    "time_columns",
]


def board_named(name: str) -> Board:
    """Return a board by its name, also one of recorded data; `SpecError` if there is none."""
    every = {**BOARDS, **RECORDED_BOARDS}
    if name not in every:
        raise SpecError(unknown("board", name, every))
    return every[name]


def plugin_kinds() -> dict[str, Kind]:
    """Return every kind of plug-in by its name, also those that a board brings."""
    return {**KINDS, **{board.kind.name: board.kind for board in BOARDS.values()}}


def boards_of(suite: Suite) -> list[Board]:
    """Return the boards that a suite has entries for; all if it has none at all."""
    boards = list((RECORDED_BOARDS if suite.recorded else BOARDS).values())
    return [board for board in boards if board.suite_entries(suite)] or boards


def chosen_boards(suite: Suite, names: Sequence[str] | None) -> list[Board]:
    """Return the boards with these names; None: those that the suite has entries for.

    On recorded data a name stands for all boards that rank plug-ins of the same kind.
    """
    if names is None:
        return boards_of(suite)
    for name in names:
        if name not in BOARDS:
            raise SpecError(unknown("board", name, BOARDS))
    chosen = [BOARDS[name] for name in names]
    if not suite.recorded:
        return chosen
    kinds = {board.kind for board in chosen}
    possible = boards_of(suite)
    if not kinds <= {board.kind for board in possible}:
        ranked = " and ".join(dict.fromkeys(board.kind.plural for board in possible))
        raise SpecError(f"suite {suite.title} is of recorded data: it is for {ranked} only")
    return [board for board in possible if board.kind in kinds]


_PARTS = {
    "camera": "CameraSettings",
    "detection": "detection_parts detection_scores",
    "driving": "DrivingSettings",
    "fusion": "FusionSettings",
    "odometry": "OdometrySettings",
    "tracking": "OFFLINE TrackingSettings track_node with_each_ego",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
