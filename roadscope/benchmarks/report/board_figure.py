"""Draws all boards of a run: the headline metric and the time of each entry."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from roadscope.benchmarks.boards import Board, board_named
from roadscope.benchmarks.boards.board import Column
from roadscope.benchmarks.report.curves import save_figure, styled_figures
from roadscope.benchmarks.report.tables import (
    MOST_NAME_WIDTH,
    is_time,
    measured_columns,
    wrapped_name,
)
from roadscope.benchmarks.results import Results
from roadscope.core.palette import PAPER_COLOURS, PAPER_FAINT
from roadscope.core.text import one_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_INCHES, LINE_INCHES, AROUND_INCHES = 9.0, 0.19, 0.9
"""Width of the picture, height of one line of a name, and what title and axis of a board need."""
SPREAD = 30.0
"""An axis is logarithmic if its greatest value is so many times the least; chosen by hand."""


def draw_boards(results: Results, path: Path) -> None:
    """Write a picture of each board: its headline metric and its first time, with 95 % intervals.

    Entries are in rank order; marks follow and are hollow. The path's ending decides the format:
    svg, png or pdf.
    """
    boards = [board_named(name) for name in results.boards()]
    names = {
        board.name: [
            wrapped_name(one_line(entry), MOST_NAME_WIDTH) for entry in results.entries(board.name)
        ]
        for board in boards
    }
    heights = [
        AROUND_INCHES + LINE_INCHES * sum(1 + name.count("\n") for name in own)
        for own in names.values()
    ]
    with styled_figures() as new_figure:
        figure = new_figure(WIDTH_INCHES, sum(heights))
        panels = figure.subplots(
            len(boards), 2, squeeze=False, sharey="row", height_ratios=heights, width_ratios=(3, 2)
        )
        for board, places in zip(boards, panels, strict=True):
            columns = measured_columns(results, board)
            shown = [column for column in columns if column.metric == board.headline]
            shown += [column for column in columns if is_time(column)][:1]
            for place, column in zip(places, shown, strict=False):
                _draw_column(place, results, board, column)
            for place in places[len(shown) :]:
                place.set_axis_off()
            places[0].set_title(f"{board.name} board", loc="left")
            places[0].set_yticks(range(len(names[board.name])), names[board.name])
            places[0].set_ylim(len(names[board.name]) - 0.5, -0.5)
            for label in places[0].get_yticklabels():
                label.set_parse_math(False)
        save_figure(figure, path)


def _draw_column(place: Axes, results: Results, board: Board, column: Column) -> None:
    """Draw one metric of all entries that have it, one below the other."""
    values: list[float] = []
    better = ""
    for line, entry in enumerate(results.entries(board.name)):
        row = results.row(board.name, entry, column.metric)
        if row is None or row.value is None:
            continue
        values.append(row.value)
        better = row.better
        ranked = results.standing(board.name, entry).mark is None
        colour = PAPER_COLOURS[0] if ranked else PAPER_FAINT
        if row.low is not None and row.high is not None:
            place.plot([row.low, row.high], [line, line], color=colour, linewidth=1.2)
        face = colour if ranked else "white"
        place.plot(row.value, line, "o", color=colour, markerfacecolor=face, markersize=4.5)
    place.set_xlabel(f"{column.heading} ({better} is better)")
    if _is_spread(values):
        place.set_xscale("log")


def _is_spread(values: Sequence[float]) -> bool:
    """Return whether positive values need a logarithmic axis."""
    return bool(values) and min(values) > 0 and max(values) > SPREAD * min(values)
